"""An artifact appears whole, once, or not at all: under kill -9, in a race, on a full disk."""

import errno
import os
import pickle
import signal
import subprocess
import sys
import textwrap
from datetime import timedelta
from pathlib import Path

import pytest

from storage_schemas import artifact, durable
from storage_schemas.faults import BadName, DiskFull, Fault
from storage_schemas.keypoints import Keypoints
from storage_schemas.store import Store
from tests.storage_schemas.examples import key_of, keypoints, provenance

ROOT = Path(__file__).parents[2]
AT = {"actor": "anna", "sequence": "walk", "stage": "keypoints"}
PUBLISH = """
    import sys, time
    from pathlib import Path
    from storage_schemas import publication
    from storage_schemas.store import Store
    from tests.storage_schemas.examples import key_of, keypoints, provenance

    def publish(seed):
        return Store(sys.argv[1]).publish(
            keypoints(seed=seed), actor="anna", sequence="walk", stage="keypoints", key=key_of(0), provenance=provenance()
        )
"""


def start(program: str, *arguments) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(PUBLISH) + textwrap.dedent(program), *map(str, arguments)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def test_kill_9_while_writing_leaves_nothing_final_and_a_retry_publishes(tmp_path):
    stops_before_the_rename = """
        def wait_for_ever(aside):
            print(aside, flush=True)
            time.sleep(1000)

        publication.sync_tree = wait_for_ever
        publish(0)
    """
    store = Store(tmp_path)
    writer = start(stops_before_the_rename, tmp_path)
    aside = Path(writer.stdout.readline().strip())
    assert aside.is_dir()
    assert store.gc(older_than=timedelta(0), dry_run=False).left_overs == ()  # its writer lives
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    writer.stdout.close()
    writer.stdin.close()

    assert store.list() == []
    assert store.find(**AT, key=key_of(0)) is None
    ref = store.publish(keypoints(), **AT, key=key_of(0), provenance=provenance())
    assert store.open(ref, Keypoints) == keypoints()
    assert aside.is_dir()
    assert store.gc(older_than=timedelta(days=1), dry_run=False).left_overs == (aside.relative_to(tmp_path).as_posix(),)
    assert not aside.exists()
    assert list((aside.parent / ".lease").glob("*.json")) == []
    assert store.open(ref, Keypoints) == keypoints()


@pytest.mark.slow
def test_four_writers_publish_once(tmp_path):
    together = """
        print("ready", flush=True)
        sys.stdin.readline()
        print(publish(int(sys.argv[2])).digest)
    """
    Store(tmp_path)
    writers = [start(together, tmp_path, seed) for seed in range(4)]
    for writer in writers:
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        writer.stdin.write("go\n")
        writer.stdin.flush()
    digests = {writer.communicate()[0].strip() for writer in writers}
    assert [writer.returncode for writer in writers] == [0, 0, 0, 0]
    store = Store(tmp_path)
    (entry,) = store.list()
    assert digests == {entry.digest}  # the losers were told what the winner published
    assert store.open(store.find(**AT, key=key_of(0)), Keypoints) in [keypoints(seed=seed) for seed in range(4)]
    assert store.verify() == []
    assert list(tmp_path.rglob(".tmp-*")) == []


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 2 MB."""
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(tmp_path)], capture_output=True, check=False)
    if mounted.returncode:
        pytest.skip("only root can mount a small tmpfs; the monkeypatched twin of this test runs")
    yield tmp_path
    subprocess.run(["umount", str(tmp_path)], check=True)


def test_a_full_disk_publishes_nothing_and_leaves_nothing(small_disk):
    store = Store(small_disk)
    control = store.publish(keypoints(frames=10), **AT, key=key_of(1), provenance=provenance())
    before = sorted(small_disk.rglob("*"))
    with pytest.raises(DiskFull, match=r"no space left .* free space or run `physavatar artifacts gc`") as caught:
        store.publish(keypoints(frames=1500), **AT, key=key_of(0), provenance=provenance())  # 6 MB of noise
    assert caught.value.errno == errno.ENOSPC
    assert sorted(small_disk.rglob("*")) == before
    assert store.open(control, Keypoints) == keypoints(frames=10)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize("place", ["write_arrays", "write_file"])
def test_a_full_disk_is_explained_wherever_it_strikes(tmp_path, monkeypatch, place, code):
    def full(*_):
        raise OSError(code, os.strerror(code))

    store = Store(tmp_path)
    monkeypatch.setattr(artifact, place, full)
    with pytest.raises(DiskFull):
        store.publish(keypoints(), **AT, key=key_of(0), provenance=provenance())
    monkeypatch.undo()
    assert list(tmp_path.rglob(".tmp-*")) == []
    assert store.find(**AT, key=key_of(0)) is None


def test_faults_reach_the_process_that_asked():
    for fault in (DiskFull.at(Path("store"), 10**6), BadName(Fault("name", "is bad", "give another"))):
        received = pickle.loads(pickle.dumps(fault))
        assert (type(received), str(received), received.faults) == (type(fault), str(fault), fault.faults)


def test_another_error_stays_what_it_is_and_cleans_up(tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(artifact, "write_arrays", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Store(tmp_path).publish(keypoints(), **AT, key=key_of(0), provenance=provenance())
    assert list(tmp_path.rglob(".tmp-*")) == []


def test_a_folder_never_replaces_one_that_holds_something(tmp_path):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "who").write_text(name)
    assert not durable.rename_folder(tmp_path / "one", tmp_path / "other")
    assert (tmp_path / "other" / "who").read_text() == "other"
    assert durable.rename_folder(tmp_path / "one", tmp_path / "free")


def test_two_processes_that_need_the_same_key_compute_it_once(tmp_path):
    as_a_stage_does = """
        store = Store(sys.argv[1])
        at = dict(actor="anna", sequence="walk", stage="keypoints", key=key_of(0))
        print("ready", flush=True)
        sys.stdin.readline()
        with store.lease(**at, seconds=10, wait=30):
            if store.find(**at) is None:
                time.sleep(0.5)
                publish(0)
                print("computed")
    """
    Store(tmp_path)
    both = [start(as_a_stage_does, tmp_path) for _ in range(2)]
    for process in both:
        process.stdout.readline()
    for process in both:
        process.stdin.write("go\n")
        process.stdin.flush()
    assert sorted(process.communicate()[0] for process in both) == ["", "computed\n"]
    assert [process.returncode for process in both] == [0, 0]


def test_a_retired_artifact_is_computed_anew(tmp_path):
    store = Store(tmp_path)
    first = store.publish(keypoints(), **AT, key=key_of(0), provenance=provenance())
    store.retire(first)
    assert store.find(**AT, key=key_of(0)) is None
    assert store.publish(keypoints(), **AT, key=key_of(0), provenance=provenance()).digest == first.digest
    assert list(tmp_path.rglob(".tmp-*")) == []
