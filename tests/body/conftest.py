"""The demo body, built once and kept where the service keeps it, and actors seen by rings of cameras."""

import os
from pathlib import Path

import pytest

from tasks.body.anny_body import build_demo_body
from tasks.body.model import BodyModel

pytest.importorskip("anny", reason="the demo body needs the package `anny`")


@pytest.fixture(scope="session")
def body_path() -> Path:
    return build_demo_body(Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser())


@pytest.fixture(scope="session")
def model(body_path: Path) -> BodyModel:
    return BodyModel.load(body_path)
