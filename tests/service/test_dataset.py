"""Planning a dataset against the store: finished, new, changed and refused, without a server."""

import asyncio
import json
import os
from pathlib import Path

import httpx
import pytest

from flows import cli_dataset
from flows.dataset import DatasetParameters, counts, find_sequences, mark_finished, plan_dataset
from flows.endings import OK, STAGE_FAILED
from flows.service import campaign, dispatch, server
from flows.service.campaign import Campaign, over_quota, run_campaign
from flows.service.dispatch import WorkFailed
from storage_schemas.faults import DiskFull
from storage_schemas.object_store import ObjectStore
from storage_schemas.store import Store
from tests.service import tiny
from tests.service.finished import finished_sequences


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("TINY_STORE", str(tmp_path / "store"))
    monkeypatch.setenv("TINY_DATA", str(tmp_path / "data"))
    for actor, sequence in (("ann", "one"), ("ann", "two"), ("bob", "one")):
        tiny.recording(tmp_path / "data", actor, sequence, "0.0")
    return tmp_path


def request_of(at, settings=None):
    settings = settings or tiny.load()
    return tiny.SERVICE.request(at, settings, Store(settings.store))


def compute(at, store=None, settings=None) -> None:
    request, store = request_of(at, settings), store or Store(tiny.load().store)

    def bring(stage, inputs, done):
        return stage.run(store, at.actor, at.sequence, inputs, request.parameters(stage, done, store), recording=at.recording).ref

    mark_finished(request, store, request.line.walk("cloth", bring))


def standings(settings=None) -> dict[str, str]:
    found = plan_dataset(find_sequences(tiny.load().data), lambda at: request_of(at, settings), Store(tiny.load().store))
    return {f"{s.actor}/{s.sequence}": s.state for s in found}


def first():
    return next(find_sequences(tiny.load().data))


def test_sequences_are_found_and_truths_are_not(place):
    (place / "data" / "ann.truth" / "one").mkdir(parents=True)
    (place / "data" / ".hidden" / "one").mkdir(parents=True)
    assert [(s.actor, s.sequence) for s in find_sequences(place / "data")] == [("ann", "one"), ("ann", "two"), ("bob", "one")]
    assert list(find_sequences(place / "nowhere")) == []


def test_what_is_computed_is_finished_with_and_without_its_mark(place):
    compute(first())
    assert standings() == {"ann/one": "finished", "ann/two": "new", "bob/one": "new"}
    for mark in (place / "store/.finished").rglob("*.json"):
        mark.unlink()
    assert standings()["ann/one"] == "finished"
    assert list((place / "store/.finished").rglob("*.json")) != []


HARMS = {
    "no manifest": lambda artifact: (artifact / "manifest.json").unlink(),
    "another manifest": lambda artifact: (artifact / "manifest.json").write_text("{}"),
    "no chunk": lambda artifact: next(artifact.rglob("c.*")).unlink(),
    "a cut chunk": lambda artifact: next(artifact.rglob("c.*")).write_bytes(b""),
}


@pytest.mark.parametrize("harm", sorted(HARMS))
def test_a_mark_does_not_hide_a_damaged_artifact_and_it_is_made_again(place, harm, monkeypatch):
    compute(first())
    HARMS[harm](next((place / "store/ann/one/cloth").iterdir()))
    assert standings()["ann/one"] == "changed"
    assert run(monkeypatch, sound).counts() == {"completed": 3}
    assert standings()["ann/one"] == "finished"
    assert Store(place / "store").verify() == []


@pytest.mark.parametrize("lost", ["manifest.json", "c.*"])
def test_what_a_bucket_lost_is_not_finished_though_it_is_here(place, lost):
    (place / "bucket").mkdir()
    store = ObjectStore(f"file://{place}/bucket", cache=place / "here")
    compute(first(), store)
    for entry in store.list():
        store.folder(entry.address)

    def state() -> str:
        return next(plan_dataset([first()], lambda at: tiny.SERVICE.request(at, tiny.load(), store), store)).state

    assert state() == "finished"
    next((place / "bucket/ann/one/cloth").rglob(lost)).unlink()
    assert state() == "changed"


def test_a_changed_recording_or_setting_is_changed(place):
    compute(first())
    settings = tiny.load().model_copy(update={"cloth": tiny.ClothParameters(scale=2.0)})
    assert standings(settings)["ann/one"] == "changed"
    text = place / "data/ann/one/text"
    text.write_text(text.read_text() + " again")
    assert standings()["ann/one"] == "changed"
    assert counts(plan_dataset([first()], request_of, Store(tiny.load().store))) == {"changed": 1}


def test_a_model_that_was_replaced_in_its_place_is_changed(place):
    model = place / "model.npz"
    model.write_bytes(b"old")
    settings = tiny.load().model_copy(update={"cloth": tiny.ClothParameters(model=model)})
    compute(first(), settings=settings)
    assert standings(settings)["ann/one"] == "finished"
    model.write_bytes(b"new")
    assert standings(settings)["ann/one"] == "changed"


def test_a_name_that_could_leave_its_folder_is_refused_and_others_go_on(place):
    (place / "data" / "-rf").mkdir()
    (place / "data" / "-rf" / "one").mkdir()
    found = standings()
    assert found["-rf/one"] == "refused"
    assert found["ann/one"] == "new"


def run(monkeypatch, dispatched, **wishes) -> Campaign:
    """A campaign whose dispatch is `dispatched(work)`, in this process."""

    async def dispatch(work):
        return await dispatched(work)

    async def unseen(*_, **__):
        await asyncio.sleep(0)

    monkeypatch.setattr(campaign, "dispatch", dispatch)
    monkeypatch.setattr(campaign, "_keep_shown", unseen)
    monkeypatch.setattr(campaign, "_show", unseen)
    settings = tiny.load()
    settings = settings.model_copy(update={"dataset": settings.dataset.model_copy(update=wishes)})
    return asyncio.run(run_campaign(tiny.SERVICE, settings, find_sequences(settings.data)))


async def sound(work) -> None:
    compute(next(s for s in find_sequences(tiny.load().data) if f"{s.actor} {s.sequence}" == work.name))


def test_only_what_is_left_is_submitted_and_no_more_than_in_flight(place, monkeypatch):
    compute(first())
    under_way, most, asked = 0, 0, []

    async def counted(work):
        nonlocal under_way, most
        under_way += 1
        most = max(most, under_way)
        asked.append(work.name)
        await asyncio.sleep(0.05)
        await sound(work)
        under_way -= 1

    ended = run(monkeypatch, counted, in_flight=1)
    assert sorted(asked) == ["ann two", "bob one"]
    assert most == 1
    assert ended.counts() == {"completed": 2, "finished": 1}
    assert run(monkeypatch, counted).counts() == {"finished": 3}


def test_it_goes_on_past_a_failure_and_ends_failed(place, monkeypatch):
    async def ann_one_fails(work):
        if work.name == "ann one":
            raise WorkFailed("ann one: cloth: no memory")
        await sound(work)

    with pytest.raises(WorkFailed, match=r"1 of 3 sequences failed; the first: ann one: ann one: cloth: no memory"):
        run(monkeypatch, ann_one_fails)
    assert kept(place)["state"] == "failed"
    assert kept(place)["counts"] == {"completed": 2, "failed": 1}


def kept(place: Path) -> dict:
    """The campaign as it lies on disk."""
    return json.loads(next((place / "store/.datasets").glob("*.json")).read_text())


def nothing_of_ann_one(monkeypatch, name: str, error: Exception) -> None:
    """`campaign.name` raises it for ann one, for the others nothing changes."""
    original = getattr(campaign, name)

    def trouble(request, *arguments):
        if request.actor == "ann" and request.sequence == "one":
            raise error
        return original(request, *arguments)

    monkeypatch.setattr(campaign, name, trouble)


@pytest.mark.parametrize("step", ["_gpu_seconds", "actor_work"])
@pytest.mark.parametrize("error", [ValueError("provenance.json: not JSON"), FileNotFoundError("gone"), httpx.ConnectError("away")])
def test_whatever_befalls_one_sequence_the_others_go_on(place, monkeypatch, step, error):
    nothing_of_ann_one(monkeypatch, step, error)
    with pytest.raises(WorkFailed, match=f"1 of 3 sequences failed; the first: ann one: {type(error).__name__}: {error}"):
        run(monkeypatch, sound)
    assert kept(place)["state"] == "failed"
    assert kept(place)["counts"] == {"completed": 2, "failed": 1}


def test_a_recording_that_cannot_be_looked_at_does_not_end_the_plan(place, monkeypatch):
    def look(sequences, request_of, store):
        for at in sequences:
            if at.sequence == "two":
                raise PermissionError(at.recording)
            yield from plan_dataset([at], request_of, store)

    monkeypatch.setattr(campaign, "plan_dataset", look)
    assert run(monkeypatch, sound).counts() == {"completed": 3}


def test_a_run_that_is_ended_does_not_stay_running(place, monkeypatch):
    async def ended(work):
        raise asyncio.CancelledError

    with pytest.raises(asyncio.CancelledError):
        run(monkeypatch, ended)
    assert kept(place)["state"] == "interrupted"


@pytest.fixture
def waited(place, monkeypatch):
    """waited(dispatched) → exit code of `dataset submit --wait` while another campaign of this store is under way."""
    Campaign(place / "store").write()
    monkeypatch.setenv("PHYSAVATAR_DATA", str(place / "data"))
    monkeypatch.setattr(server, "speak_to_server", lambda service: None)

    def go(dispatched, store: str = "store") -> int:
        monkeypatch.setattr(dispatch, "dispatch", dispatched)
        return cli_dataset.submit(store=place / store, wait=True, json_=True)

    return go


@pytest.mark.parametrize("store", ["store", "without any campaign"])
def test_a_dataset_that_was_refused_or_failed_is_no_success(waited, capsys, store):
    async def refused(work):
        raise WorkFailed("dataset data: Cancelled: concurrency limit reached")

    assert waited(refused, store) == STAGE_FAILED
    assert "concurrency limit reached" in capsys.readouterr().err.replace("\n", " ")


def test_a_dataset_that_went_through_is_shown(waited, capsys):
    async def done(work):
        return None

    assert waited(done) == OK
    assert json.loads(capsys.readouterr().out)["state"] == "running"


def test_over_quota_nothing_more_is_submitted(place, monkeypatch):
    ended = run(monkeypatch, sound, keep_free_gb=1e9)
    assert ended.counts() == {"over quota": 3}
    assert ended.state == "over quota"


def test_quotas_say_what_is_used(place):
    store = Store(tiny.load().store)
    assert over_quota(Campaign(Path(os.environ["TINY_STORE"]), gpu_seconds=7200.0), DatasetParameters(gpu_hours=2.0), store) is not None
    assert over_quota(Campaign(store.root, gpu_seconds=7199.0), DatasetParameters(gpu_hours=2.0, keep_free_gb=0.0), store) is None
    compute(first())
    assert "store holds" in over_quota(Campaign(store.root), DatasetParameters(store_gb=1e-9, keep_free_gb=0.0), store)


def test_every_stage_of_the_avatar_has_an_archived_stand_in_to_plan_over(tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_CACHE", str(tmp_path / "cache"))
    service, settings = finished_sequences(tmp_path, 3)
    store = Store(settings.store)
    found = plan_dataset(find_sequences(settings.data), lambda at: service.request(at, settings, store), store)
    assert counts(found) == {"finished": 3}


@pytest.mark.parametrize("times", [2, 9])
def test_a_full_disk_under_a_new_store_is_waited_out_for_a_while(place, monkeypatch, times):
    tried = []

    def found(location):
        tried.append(location)
        if len(tried) <= times:
            raise DiskFull.at(place, 0)
        return Store(location)

    monkeypatch.setattr(campaign, "open_store", found)
    monkeypatch.setattr(campaign, "FULL_DISK_PAUSES_S", (0.0, 0.0, 0.0))
    if times == 2:
        assert set(run(monkeypatch, sound).counts()) == {"completed"}
    else:
        with pytest.raises(DiskFull):
            run(monkeypatch, sound)
    assert len(tried) == min(times, 3) + 1
