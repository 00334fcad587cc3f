"""One process at a time; a dead owner's lease is free at once, a silent one's when it expires."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from storage_schemas.faults import Leased
from storage_schemas.lease import Held, Owner, hold, is_live, read_lease

HOLDS_FOR_EVER = """
import sys, time
from pathlib import Path
from storage_schemas.lease import hold
with hold(Path(sys.argv[1]), seconds=600):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def path(tmp_path):
    return tmp_path / ".lease" / "key.json"


def write(path, *, expires: float, **owner):
    path.parent.mkdir(exist_ok=True)
    held = Held(owner=Owner.this_process().model_copy(update=owner), expires=expires)
    path.write_text(held.model_dump_json())


def test_a_held_lease_excludes_and_a_released_one_does_not(path):
    with hold(path, seconds=10):
        assert is_live(path)
        with pytest.raises(Leased, match=rf"process {os.getpid()} on .* is computing this .lease runs \d+ s more"), hold(path, seconds=10):
            pass
    assert not path.exists()
    with hold(path, seconds=10):
        assert is_live(path)


def test_waiting_gets_the_lease_when_it_falls_free(path):
    first = hold(path, seconds=10)
    first.__enter__()
    threading.Timer(0.5, first.__exit__, (None, None, None)).start()
    began = time.monotonic()
    with hold(path, seconds=10, wait=20):
        assert 0.4 < time.monotonic() - began < 10


def test_a_heartbeat_extends_the_lease(path):
    with hold(path, seconds=2):
        first = read_lease(path).expires
        until = time.monotonic() + 60
        while read_lease(path).expires < first + 2 and time.monotonic() < until:
            time.sleep(0.1)
        assert read_lease(path).expires >= first + 2
        assert is_live(path)


def test_an_expired_lease_of_a_stranger_is_free_and_a_running_one_is_not(path):
    write(path, expires=time.time() + 60, machine="another", pid=1)
    with pytest.raises(Leased), hold(path, seconds=1):
        pass
    write(path, expires=time.time() - 1, machine="another", pid=1)
    with hold(path, seconds=1):
        assert read_lease(path).owner.pid == os.getpid()


def test_a_killed_owner_frees_its_lease_at_once(path):
    owner = subprocess.Popen([sys.executable, "-c", HOLDS_FOR_EVER, str(path)], stdout=subprocess.PIPE, text=True)
    assert owner.stdout.readline() == "held\n"
    with pytest.raises(Leased), hold(path, seconds=1):
        pass
    owner.send_signal(signal.SIGKILL)
    owner.wait()
    owner.stdout.close()
    with hold(path, seconds=1):
        pass


def test_a_process_number_that_was_given_away_is_not_the_owner(path):
    write(path, expires=time.time() + 600, started=1)
    assert not is_live(path)
    write(path, expires=time.time() + 600)
    assert is_live(path)  # the control: the same owner with its true start


def test_an_owner_whose_name_is_no_utf8_is_asked_like_any_other(path):
    named = "import time; open('/proc/self/comm', 'wb').write(b'caf\\xe9'); print(flush=True); time.sleep(5)"
    with subprocess.Popen([sys.executable, "-c", named], stdout=subprocess.PIPE) as owner:
        owner.stdout.readline()
        write(path, expires=time.time() + 600, pid=owner.pid)
        assert not is_live(path)  # it started later than the lease says: another process by now
        owner.kill()


def test_a_lease_taken_over_is_left_alone(path):
    with hold(path, seconds=0.4) as lease:
        for _ in range(50):  # the heartbeat may be about to write
            write(path, expires=time.time() + 600, machine="another")
            lease._heart.join(1)
            if not lease._heart.is_alive():
                break
        assert not lease._heart.is_alive()
    assert read_lease(path).owner.machine == "another"


def test_a_damaged_lease_is_free(path):
    path.parent.mkdir()
    path.write_text(json.dumps({"owner": "?"}))
    with hold(path, seconds=30):
        assert is_live(path)


def test_of_many_that_find_a_stale_lease_one_takes_it(path):
    """Threads race as processes do: each opens the lock anew, and an flock belongs to the opening."""
    write(path, expires=time.time() - 1, machine="another")
    together, over, taken = threading.Barrier(8), threading.Barrier(8), []

    def take():
        together.wait()
        try:
            with hold(path, seconds=30):
                taken.append(threading.get_ident())
                over.wait()
        except Leased:
            over.wait()

    racers = [threading.Thread(target=take) for _ in range(8)]
    for racer in racers:
        racer.start()
    for racer in racers:
        racer.join()
    assert len(taken) == 1
