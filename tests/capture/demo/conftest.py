"""The demo body, built once per machine, and a small plan around it."""

import os
from pathlib import Path

import pytest

from tasks.body.anny_body import build_demo_body
from tasks.body.model import BodyModel
from tasks.capture.demo.plan import Plan, Request, make_plan


@pytest.fixture(scope="session")
def cache() -> Path:
    return Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser()


@pytest.fixture(scope="session")
def body_model(cache) -> BodyModel:
    return BodyModel.load(build_demo_body(cache))


@pytest.fixture(scope="session")
def plan(body_model) -> Plan:
    return make_plan(Request(cameras=3, frames=12, size=256, spp=4), body_model)
