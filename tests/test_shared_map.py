"""Items shared by processes: each computed once, none lost with whoever held it."""

import os
import shutil
import signal
import time
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from storage_schemas.fields import array
from storage_schemas.record import Record
from storage_schemas.store import Store
from tasks.shared_map import SharedMap, Superseded
from tasks.stage import Job, Parameters, stage

ITEMS = 8


def noted(log: str, seconds: float, number: int) -> float:
    with Path(log).open("a") as file:
        file.write(f"{number} {os.getpid()}\n")
    time.sleep(seconds)
    return number**0.5


def share(folder: str, log: str, seconds: float, answer=None) -> None:
    found = SharedMap(Path(folder), map, 1)(partial(noted, log, seconds), range(ITEMS))
    if answer is not None:
        answer.put(found)


@pytest.fixture
def place(tmp_path):
    (tmp_path / "shared").mkdir()
    return str(tmp_path / "shared"), str(tmp_path / "log")


def lines(log: str) -> list[list[str]]:
    return [line.split() for line in Path(log).read_text().splitlines()]


def started(place: tuple[str, str], seconds: float, answer=None):
    process = get_context("spawn").Process(target=share, args=(*place, seconds, answer))
    process.start()
    return process


def test_alone_it_is_a_map(place):
    assert SharedMap(Path(place[0]), map, 2)(partial(noted, place[1], 0.0), range(ITEMS)) == [n**0.5 for n in range(ITEMS)]
    assert len(lines(place[1])) == ITEMS
    SharedMap(Path(place[0]), map, 2)(partial(noted, place[1], 0.0), range(ITEMS))
    assert len(lines(place[1])) == ITEMS  # what is there is not computed again


def test_two_processes_compute_each_item_once_and_know_all(place):
    answer = get_context("spawn").Queue()
    pair = [started(place, 1.0, answer) for _ in range(2)]
    found = [answer.get(timeout=120) for _ in pair]
    for process in pair:
        process.join()
    assert found == [[n**0.5 for n in range(ITEMS)]] * 2
    assert sorted(int(n) for n, _ in lines(place[1])) == list(range(ITEMS))
    assert len({pid for _, pid in lines(place[1])}) == 2


def test_what_a_killed_process_held_is_computed_by_another(place):
    doomed = started(place, 60.0)
    while not Path(place[1]).exists():
        time.sleep(0.05)
    os.kill(doomed.pid, signal.SIGKILL)
    doomed.join()
    SharedMap(Path(place[0]), lambda function, items: [1.0 for _ in items], 1)(partial(noted, place[1], 60.0), [0])
    assert len(list(Path(place[0]).glob("*.npz"))) == 1


def test_a_result_torn_by_a_power_failure_is_computed_again(place):
    run = SharedMap(Path(place[0]), map, 1)
    run(partial(noted, place[1], 0.0), [4])
    (file,) = Path(place[0]).glob("*.npz")
    file.write_bytes(b"")
    assert run(partial(noted, place[1], 0.0), [4]) == [2.0]


def test_whoever_is_late_is_told(place):
    shutil.rmtree(place[0])
    with pytest.raises(Superseded):
        share(*place, 0.0)


def test_whoever_still_computes_when_it_is_over_is_told(place):
    def slow(function, items):
        shutil.rmtree(place[0])
        return map(function, items)

    with pytest.raises(Superseded):
        SharedMap(Path(place[0]), slow, 1)(partial(noted, place[1], 0.0), [1])


class Roots(Record, name="roots", version=1):
    values: np.ndarray = array("item", "float32", "1")


class Wide(Parameters):
    log: str


@stage("wide", version=1, pool="simulation", timeout_s=60, spreads=True)
def wide(job: Job, parameters: Wide) -> Roots:
    begun = job.checkpoint / "begun"
    start = float(begun.read_text()) if begun.exists() else 0.0
    begun.write_text("5.0")  # what a killed run goes on from, and helpers of the next must begin from too
    found = job.spread(map, 1)(partial(noted, parameters.log, 0.5), [start + n for n in range(ITEMS)])
    return Roots(values=np.array(found, np.float32))


def help_out(root: str, log: str) -> None:
    wide.help(Store(root), "ann", "one", {}, Wide(log=log), None)


def test_a_helper_goes_the_same_way_and_publishes_nothing(tmp_path):
    store, parameters = Store(tmp_path / "store"), Wide(log=str(tmp_path / "log"))
    key = wide.key({}, parameters)
    checkpoint = store.checkpoint_dir("ann", "one", "wide", key)
    (checkpoint / "begun").write_text("3.0")
    helper = get_context("spawn").Process(target=_help_once_open, args=(str(tmp_path / "store"), str(tmp_path / "log"), str(checkpoint)))
    helper.start()
    outcome = wide.run(store, "ann", "one", {}, parameters, shared=True)
    helper.join()
    assert helper.exitcode == 0
    assert store.open(outcome.ref, Roots).values.tolist() == pytest.approx([(3 + n) ** 0.5 for n in range(ITEMS)])
    assert sorted(float(n) for n, _ in lines(parameters.log)) == [3.0 + n for n in range(ITEMS)]
    assert len({pid for _, pid in lines(parameters.log)}) == 2
    assert not checkpoint.exists()


def _help_once_open(root: str, log: str, checkpoint: str) -> None:
    while not Path(checkpoint, "shared").exists():
        time.sleep(0.02)
    help_out(root, log)


def test_help_that_is_not_asked_for_ends_at_once(tmp_path):
    help_out(str(tmp_path / "store"), str(tmp_path / "log"))
    assert not (tmp_path / "log").exists()
