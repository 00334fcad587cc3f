"""A sweep removes what nobody counts on, and nothing else."""

import os
import shutil
import time
from datetime import timedelta

import pytest

from storage_schemas import sweep
from storage_schemas.faults import Corrupt
from storage_schemas.layout import new_aside
from storage_schemas.store import Store
from tests.storage_schemas.examples import key_of, keypoints, provenance

AT = {"actor": "anna", "sequence": "walk"}
DAY = timedelta(days=1)


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path)


def put(store, number, *, days_old=10.0, stage="keypoints", **inputs):
    ref = store.publish(keypoints(frames=1, seed=number), **AT, stage=stage, key=key_of(number), provenance=provenance(**inputs))
    age(store.folder(ref) / "manifest.json", days_old)
    return ref


def age(path, days):
    then = time.time() - days * 86400
    os.utime(path, (then, then))


def left(store):
    return {entry.address for entry in store.list()}


def test_latest_pins_the_young_and_all_their_inputs_stay(store):
    source = put(store, 0)
    middle = put(store, 1, stage="body", source=source)
    latest = put(store, 2, stage="tracking", middle=middle)
    pinned_input, young_input = put(store, 3), put(store, 4)
    pinned, young = put(store, 5, source=pinned_input), put(store, 6, days_old=0, source=young_input)
    old = put(store, 7)
    user_of_old = put(store, 8, source=old)
    store.set_latest(latest)
    store.pin(pinned, "figure 3 of the paper")

    swept = store.gc(older_than=DAY, dry_run=False)
    assert set(swept.artifacts) == {str(old.address), str(user_of_old.address)}
    assert left(store) == {ref.address for ref in (source, middle, latest, pinned_input, pinned, young_input, young)}
    assert store.verify() == []
    store.unpin(pinned)
    assert set(store.gc(older_than=DAY, dry_run=False).artifacts) == {str(pinned.address), str(pinned_input.address)}


def test_a_dry_run_says_the_same_and_removes_nothing(store):
    put(store, 0)
    before = left(store)
    said = store.gc(older_than=DAY, dry_run=True)
    assert left(store) == before
    assert said.bytes > 1000
    assert store.gc(older_than=DAY, dry_run=False) == said
    assert left(store) == set()


@pytest.fixture
def vanishing(monkeypatch):
    """A folder of this name is gone once it is listed: published or removed by another process meanwhile."""

    def of(name: str) -> None:
        gone: list = []

        def scandir(path):
            if str(path).endswith(f"/{name}") and not gone:
                gone.append(path)
                shutil.rmtree(path)
            return listed(path)

        listed = os.scandir
        monkeypatch.setattr(os, "scandir", scandir)

    return of


def test_a_checkpoint_that_is_published_while_the_store_is_walked_stops_nothing(store, vanishing):
    old = put(store, 0)
    going = store.checkpoint_dir(**AT, stage="keypoints", key=key_of(1)) / "going"
    going.mkdir()
    vanishing("going")
    assert store.gc(older_than=DAY, dry_run=False).artifacts == (str(old.address),)
    assert not going.exists()


@pytest.mark.parametrize("size", [Store.size, lambda store: sum(entry.bytes for entry in store.list())])
def test_an_artifact_that_goes_while_it_is_counted_has_no_size(store, vanishing, size):
    put(store, 0)
    alone, going = store.size(), put(store, 1)
    assert store.size() > alone
    vanishing(going.key)
    assert size(store) == alone


def test_an_artifact_that_another_sweeps_first_is_left_to_them(store, monkeypatch):
    ref = put(store, 0)
    monkeypatch.setattr(sweep, "new_aside", lambda stage, purpose: (shutil.rmtree(store.folder(ref)), new_aside(stage, purpose))[1])
    assert store.gc(older_than=DAY, dry_run=False).artifacts == (str(ref.address),)
    assert left(store) == set()


def test_asking_for_an_artifact_makes_it_young(store):
    ref = put(store, 0)
    assert store.find(**AT, stage="keypoints", key=ref.key) == ref
    assert store.gc(older_than=DAY, dry_run=False).artifacts == ()


def test_unreadable_provenance_of_what_is_kept_stops_the_sweep(store):
    kept, old = put(store, 0), put(store, 1)
    store.set_latest(kept)
    (store.folder(kept) / "provenance.json").write_text("{")
    with pytest.raises(Corrupt, match=r"provenance\.json"):
        store.gc(older_than=DAY, dry_run=False)
    assert left(store) == {kept.address, old.address}


def test_a_damaged_pointer_stops_the_sweep_and_a_damaged_pin_still_pins(store):
    ref = put(store, 0)
    store.pin(ref, "why")
    (pin,) = store.root.rglob(".pins/*.json")
    pin.write_text("{")
    assert store.gc(older_than=DAY, dry_run=False).artifacts == ()
    store.set_latest(ref)
    (store.folder(ref).parent / ".latest.json").write_text("{")
    with pytest.raises(Corrupt, match="is no pointer"):
        store.gc(older_than=DAY, dry_run=False)


def test_folders_aside_go_when_their_writer_is_dead_and_checkpoints_when_old(store):
    ref = put(store, 0, days_old=0)
    stage = store.folder(ref).parent
    orphan = stage / ".tmp-orphan"
    orphan.mkdir()
    checkpoint = store.checkpoint_dir(**AT, stage="keypoints", key=key_of(1))
    busy = store.checkpoint_dir(**AT, stage="keypoints", key=key_of(2))
    fresh = store.checkpoint_dir(**AT, stage="keypoints", key=key_of(3))
    for folder in (checkpoint, busy):
        age(folder, 10)
    with store.lease(**AT, stage="keypoints", key=key_of(2)):
        swept = store.gc(older_than=DAY, dry_run=False)
    assert {path.rsplit("/", 1)[1] for path in swept.left_overs} == {".tmp-orphan", checkpoint.name}
    assert [folder.exists() for folder in (orphan, checkpoint, busy, fresh)] == [False, False, True, True]
