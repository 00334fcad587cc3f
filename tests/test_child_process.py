"""Children give results, tell of progress, die in time, and never outlive their parent."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tasks.child_process import ChildFailed, ChildTimedOut, Pool, run_in_children


def square(x, tell):
    tell(f"squaring {x}")
    return x * x


def stubborn(_, tell):
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    tell(os.getpid())
    time.sleep(60)


def sleeper(_, tell):
    tell(os.getpid())
    time.sleep(60)


def refuses(_, tell):
    raise ValueError("no")


def dies(_, tell):
    os.kill(os.getpid(), 9)


def living(group: int) -> list[int]:
    """Processes of a group that are more than zombies."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, its_group = stat.read_text().rpartition(") ")[2].split()[:3]
        except OSError:
            continue
        if int(its_group) == group and state != "Z":
            found.append(int(stat.parent.name))
    return found


def wait_until_gone(group: int) -> list[int]:
    for _ in range(50):
        if not living(group):
            break
        time.sleep(0.1)
    return living(group)


def test_results_in_order_with_messages():
    heard = []
    assert run_in_children(square, [(1,), (2,), (3,)], limit_s=60, on_message=lambda i, m: heard.append((i, m))) == [1, 4, 9]
    assert sorted(heard) == [(0, "squaring 1"), (1, "squaring 2"), (2, "squaring 3")]


def test_no_child_is_started_late():
    """The first is under way when the time comes, and is not cut short."""
    begin_by = time.monotonic() + 0.1
    assert run_in_children(square, [(1,), (2,), (3,)], limit_s=60, at_once=1, begin_by=begin_by) == [1, None, None]


def test_a_child_past_its_limit_is_killed_with_all_its_own():
    pids = []
    with pytest.raises(ChildTimedOut, match="still running after 3 s"):
        run_in_children(stubborn, [(0,)], limit_s=3, on_message=lambda i, pid: pids.append(pid))
    assert not wait_until_gone(pids[0])


def test_failures_say_how():
    with pytest.raises(ValueError, match="no"):
        run_in_children(refuses, [(0,)], limit_s=60)
    with pytest.raises(ChildFailed, match="SIGKILL"):
        run_in_children(dies, [(0,)], limit_s=60)


def test_a_child_dies_with_its_parent():
    code = (
        "from tests.test_child_process import sleeper\nfrom tasks.child_process import run_in_children\n"
        "run_in_children(sleeper, [(0,)], limit_s=60, on_message=lambda i, pid: print(pid, flush=True))"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    pid = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert not wait_until_gone(pid)


def cubed(x):
    return x**3


def dies_once(path):
    if not Path(path).exists():
        Path(path).write_text("was here")
        os.kill(os.getpid(), 9)
    return "alive"


def test_a_pool_keeps_order_and_begins_again_what_was_killed(tmp_path):
    with Pool(limit_s=60) as pool:
        assert pool.map(cubed, range(5)) == [0, 1, 8, 27, 64]
        assert pool.map(dies_once, [str(tmp_path / "mark")]) == ["alive"]
        assert len(pool.reasons) == 1 and "killed" in pool.reasons[0]


def test_a_process_that_dies_between_two_computations_is_replaced():
    """The executor knows of the death long before it is asked again, and refuses then."""
    with Pool(limit_s=60, at_once=1) as pool:
        [(_, pid)] = pool.map(worked, [1])
        os.kill(pid, signal.SIGKILL)
        time.sleep(0.5)
        [(_, other)] = pool.map(worked, [2])
        assert other != pid and len(pool.reasons) == 1


def dies_once_beside_another(path):
    """The first is killed while the second, which notes every time it is begun, is under way."""
    if path.endswith("doomed"):
        while not Path(path).with_name("steady").exists():
            time.sleep(0.01)
        return dies_once(path)
    with Path(path).open("a") as file:
        file.write("begun\n")
    time.sleep(1)
    return Path(path).read_text()


def test_what_is_killed_takes_no_other_with_it(tmp_path):
    with Pool(limit_s=60) as pool:
        found = pool.map(dies_once_beside_another, [str(tmp_path / name) for name in ("doomed", "steady")])
    assert found == ["alive", "begun\n"]
    assert len(pool.reasons) == 1 and pool.reasons[0].startswith("computation 1 of 2: killed")


def worked(n):
    time.sleep(0.2)
    return n, os.getpid()


def test_threads_that_share_a_pool_share_its_processes():
    with Pool(limit_s=60, at_once=2) as pool, ThreadPoolExecutor(3) as threads:
        found = list(threads.map(lambda n: pool.map(worked, range(n)), (2, 3, 4)))
    assert [[n for n, _ in each] for each in found] == [[0, 1], [0, 1, 2], [0, 1, 2, 3]]
    assert len({pid for each in found for _, pid in each}) == 2


def test_a_pool_that_is_interrupted_does_not_wait():
    code = (
        "import signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"  # ignored where tests run in the background
        "from tasks.child_process import Pool\nfrom tests.test_child_process import begun_and_slow\n"
        "with Pool(limit_s=60) as pool:\n    pool.map(begun_and_slow, [50, 50, 50])"
    )
    began = time.monotonic()
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    children = [int(parent.stdout.readline()) for _ in range(2)]
    parent.send_signal(signal.SIGINT)
    assert parent.wait(timeout=20) != 0 and time.monotonic() - began < 40
    parent.stdout.close()
    assert not any(living(child) for child in children)


def begun_and_slow(seconds):
    os.setsid()  # so that it is told by its own group
    os.write(1, f"{os.getpid()}\n".encode())
    time.sleep(seconds)


def test_a_pool_gives_up_on_what_is_too_slow():
    with Pool(limit_s=0.5, attempts=1) as pool, pytest.raises(ChildTimedOut, match="still running"):
        pool.map(time.sleep, [30])
