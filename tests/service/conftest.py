"""One service for all short tests of this folder."""

import pytest

from tests.service.place import service


@pytest.fixture(scope="package")
def running(tmp_path_factory):
    place = tmp_path_factory.mktemp("service")
    with service(place) as supervisor:
        yield place, supervisor
