"""Two requests are one piece of work when, and only when, they ask for the same; and what travels to a worker means there what it meant here."""

from pathlib import Path

import pytest

from flows.config import load
from flows.dataset import Sequence, find_sequences
from flows.pipeline import AVATAR, STAGES
from flows.request import Request
from flows.service import actor, joining
from flows.service.campaign import dataset_work
from flows.service.deployed import SERVICE
from flows.service.dispatch import Work
from flows.service.hand_over import actor_work
from flows.service.settings import json_settings
from storage_schemas.store import Store
from tasks.keypoints.detector import BUNDLED
from tasks.stage import Fingerprint

PATHS = [
    f"{stage.name}.{name}"
    for stage in STAGES.values()
    for name, field in stage.parameters.model_fields.items()
    if any(isinstance(mark, Fingerprint) for mark in field.metadata)
]


@pytest.fixture
def project(tmp_path, monkeypatch):
    """project(name) → its folder, with a recording, as the working directory."""
    for name in ("CONFIG", "STORE", "DATA"):
        monkeypatch.delenv(f"PHYSAVATAR_{name}", raising=False)

    def enter(name: str) -> Path:
        (tmp_path / name / "data" / "ann" / "one").mkdir(parents=True, exist_ok=True)
        monkeypatch.chdir(tmp_path / name)
        return tmp_path / name

    return enter


def submitted(*flags: str) -> Work:
    """As `physavatar submit ann --service` asks for it."""
    settings = load([*flags, "capture.recording=data/ann/one"])
    return actor_work(Request("ann", "one", settings, AVATAR), Store(settings.store))


def of_dataset(data: Path) -> Work:
    """As the dataset flow asks for it."""
    settings = load(places={"data": data})
    (at,) = find_sequences(Path(settings.data))
    store = Store(settings.store)
    return actor_work(SERVICE.request(at, settings, store), store, "batch")


def group(settings) -> Work:
    """As its parent asks for one pool's part of it."""
    store = Store(settings.store)
    request = SERVICE.request(Sequence("ann", "one", Path("data/ann/one")), settings, store)
    return actor._work(request, store, "vision", {"capture": "same key"}, "single")


def helper(settings) -> Work:
    """As a group run asks for help."""
    request = SERVICE.request(Sequence("ann", "one", Path("data/ann/one")), settings, Store(settings.store))
    return joining._work(request, STAGES["cloth"], "same key", 0)


def test_the_same_names_in_two_projects_are_two_pieces_of_work(project):
    project("a")
    one, all_one, part_one, help_one = submitted(), dataset_work(load()), group(load()), helper(load())
    project("b")
    assert submitted().key != one.key
    assert dataset_work(load()).key != all_one.key
    assert group(load()).key != part_one.key
    assert helper(load()).key != help_one.key


@pytest.mark.parametrize("place", ["store", "data"])
def test_another_store_or_other_recordings_are_another_piece_of_work(project, place):
    project("a")
    assert submitted(f"{place}=elsewhere").key != submitted().key


def test_a_sequence_is_the_same_work_however_it_is_asked_for(project):
    folder = project("a")
    assert submitted().key == of_dataset(Path("data")).key == of_dataset(folder / "data").key
    assert submitted(f"store={folder / 'artifacts'}").key == submitted().key


def test_parts_that_agree_are_shared_by_requests_that_go_apart_later(project):
    project("a")
    assert group(load()).key == group(load(["cloth.density=400"])).key


def test_the_recording_is_absolute_on_its_way(project):
    folder = project("a")
    assert submitted().parameters["settings"]["capture"]["recording"] == str(folder / "data/ann/one")


@pytest.mark.parametrize("path", sorted(set(PATHS) - {"capture.recording"}))
def test_every_path_of_a_stage_is_absolute_on_its_way(project, path):
    folder = project("a")
    stage, name = path.split(".")
    one, all_of_them = submitted(f"{path}=own/file"), dataset_work(load([f"{path}=own/file"]))
    for work in (one, all_of_them):
        assert work.parameters["settings"][stage][name] == str(folder / "own/file")


def test_the_bundled_model_is_each_installation_s_own(project):
    project("a")
    sent = submitted().parameters["settings"]
    assert str(BUNDLED) not in str(sent)
    assert SERVICE.settings.model_validate(sent).keypoints.model == BUNDLED
    assert submitted(f"keypoints.model={BUNDLED}").key == submitted().key


def test_no_detector_at_all_is_not_the_bundled_one(project):
    project("a")
    settings = load(["capture.recording=data/ann/one"])
    without = settings.model_copy(update={"keypoints": settings.keypoints.model_copy(update={"model": None})})
    assert json_settings(without)["keypoints"]["model"] is None
