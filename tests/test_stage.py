"""A stage runs once per key, from any number of processes; the truth is closed to it; keys follow content, not place."""

from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from prefect.cache_policies import NO_CACHE

from storage_schemas.skinning import Skinning
from storage_schemas.store import Store
from tasks.stage import Job, ModelFile, Parameters, stage

RAN = "ran"


class SkinParameters(Parameters):
    count: int = 4
    model: ModelFile = None
    peek: Path | None = None
    log: Path | None = None
    odd: tuple[str, ...] = ()


@stage("skinning", version=1, pool="tracking")
def skin(job: Job, parameters: SkinParameters) -> Skinning:
    if parameters.peek:
        parameters.peek.read_text()
    if parameters.log:
        with parameters.log.open("a") as log:
            log.write(f"{RAN}\n")
    for said in parameters.odd:
        job.warn(said)
    weights = np.zeros((parameters.count, 55), np.float32)
    weights[:, 0] = 1
    return Skinning(weights=weights, matched=np.ones(parameters.count, bool), rest_vertices=np.zeros((parameters.count, 3), np.float32))


def run(root: Path, **parameters):
    return skin.run(Store(root), "ann", "one", {}, SkinParameters(**parameters))


def test_the_second_run_finds_what_the_first_published(tmp_path):
    log = tmp_path / "log"
    first, second = (run(tmp_path / "store", log=log) for _ in range(2))
    assert (first.cached, second.cached) == (False, True)
    assert first.ref == second.ref
    assert log.read_text() == f"{RAN}\n"
    assert run(tmp_path / "store", log=log, count=5).cached is False  # negative control: another parameter is another artifact


@pytest.mark.parametrize("odd", [(), ("two suns", "no shadow")])
def test_what_a_stage_warns_of_is_told_and_kept_in_its_provenance(tmp_path, odd):
    store, told = Store(tmp_path / "store"), []
    ended = skin.run(store, "ann", "one", {}, SkinParameters(odd=odd), warn=told.append)
    assert store.provenance(ended.ref).reasons == tuple(told) == odd


def _run_in_process(root, log, queue):
    queue.put(run(root, log=log).ref.key)


def test_two_submits_of_one_key_compute_once(tmp_path):
    context = get_context("spawn")
    queue = context.Queue()
    Store(tmp_path / "store")
    both = [context.Process(target=_run_in_process, args=(tmp_path / "store", tmp_path / "log", queue)) for _ in range(2)]
    for process in both:
        process.start()
    assert queue.get(timeout=60) == queue.get(timeout=60)
    for process in both:
        process.join()
    assert (tmp_path / "log").read_text() == f"{RAN}\n"


def test_prefect_shows_as_cached_what_the_store_had_for_this_actor_and_asks_no_cache_of_its_own(tmp_path):
    """Two actors with the same recording have the same key: a record under it would name the artifact of whoever came last."""
    task = skin.as_task(Store(tmp_path / "store"))
    ended = [task.fn(actor, "one", {}, SkinParameters().model_dump(mode="json")) for actor in ("ann", "bob", "ann", "bob")]
    assert [state.name for state in ended] == ["Completed", "Completed", "Cached", "Cached"]
    assert [state.result()["ref"]["actor"] for state in ended] == ["ann", "bob", "ann", "bob"]
    assert task.cache_policy == NO_CACHE and not task.persist_result


def test_a_model_file_enters_the_key_by_content(tmp_path):
    one, same, other = (tmp_path / name for name in ("one.npz", "same.npz", "other.npz"))
    one.write_bytes(b"weights"), same.write_bytes(b"weights"), other.write_bytes(b"others")
    keys = [skin.key({}, SkinParameters(model=path)) for path in (one, same, other)]
    assert keys[0] == keys[1] != keys[2]


@pytest.mark.parametrize("empty", ["", " "])
def test_an_empty_path_is_a_setting_left_out_not_the_current_directory(empty):
    assert SkinParameters(model=empty).model is None
    assert skin.key({}, SkinParameters(model=empty)) == skin.key({}, SkinParameters())
    assert SkinParameters(model=".").model == Path()  # the control: said, it is meant


def test_a_stage_cannot_open_the_truth(tmp_path):
    sealed = tmp_path / "demo.truth" / "answer.txt"
    sealed.parent.mkdir()
    sealed.write_text("42")
    assert sealed.read_text() == "42"  # the scorer can
    with pytest.raises(PermissionError, match="may not open the truth"):
        run(tmp_path / "store", peek=sealed)
    plain = tmp_path / "plain.txt"
    plain.write_text("42")
    assert not run(tmp_path / "store", peek=plain).cached


def test_unknown_parameters_are_refused():
    with pytest.raises(ValueError, match="counts"):
        SkinParameters(counts=3)
