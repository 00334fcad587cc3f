"""Threads that ask for computations: order, context, and who waits for whom."""

import threading
import time
from contextvars import ContextVar
from pathlib import Path

import pytest

from tasks.side_by_side import side_by_side
from tasks.stage import _sealed_from_truth

SAID = ContextVar("said", default="nothing")


def test_calls_meet_and_answers_keep_their_order():
    both = threading.Barrier(2, timeout=20)

    def late(n):
        both.wait()
        time.sleep(0.2 * (n == 0))
        return n, SAID.get()

    token = SAID.set("here")
    assert side_by_side(late, range(4), 2) == [(n, "here") for n in range(4)]
    SAID.reset(token)


def test_one_at_a_time_is_the_callers_own_thread():
    assert side_by_side(lambda _: threading.current_thread(), range(2), 1) == [threading.current_thread()] * 2


def test_a_stage_s_threads_may_not_open_the_truth_either(tmp_path):
    file = tmp_path / "demo.truth" / "body.npz"
    file.parent.mkdir()
    file.write_text("the truth")
    for at_once in (1, 2):
        with _sealed_from_truth(), pytest.raises(PermissionError, match="truth it is judged by"):
            side_by_side(Path.read_text, [file, file], at_once)


def test_where_one_fails_nobody_waits_for_the_other_and_no_more_begin():
    free, begun = threading.Event(), []

    def one(n):
        begun.append(n)
        if n == 0:
            raise ValueError("no")
        free.wait(20)

    start = time.monotonic()
    with pytest.raises(ValueError, match="no"):
        side_by_side(one, range(20), 2)
    assert time.monotonic() - start < 10 and len(begun) < 4
    free.set()
