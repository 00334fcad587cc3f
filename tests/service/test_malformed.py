"""No reader crashes, hangs or executes anything, whatever it is given."""

import pytest

from tests.service.malformed import READERS, endings

COUNT = 10


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
def test_damaged_files_are_refused_in_words(reader):
    found = endings(reader, COUNT)
    assert found["refused"] + found["read"] == COUNT, found
    assert found["refused"] >= COUNT // 2, found
