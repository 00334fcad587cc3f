"""The demo body and a studio that renders it, built once per machine and test run."""

import os
from pathlib import Path

import pytest

from tasks.body.anny_body import build_demo_body
from tasks.body.model import BodyModel
from tasks.keypoints.renders import Studio


@pytest.fixture(scope="session")
def body() -> BodyModel:
    pytest.importorskip("anny", reason="the demo body needs the anny package")
    cache = Path(os.environ.get("PHYSAVATAR_CACHE", Path.home() / ".cache/physavatar"))
    return BodyModel.load(build_demo_body(cache))


@pytest.fixture
def studio(body: BodyModel) -> Studio:
    return Studio(body, shapes=10, expressions=10)
