"""The store on S3, against a real local server: the same promises as on a disk."""

import multiprocessing
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import boto3
import httpx
import numpy as np
import obstore
import pytest

from storage_schemas.faults import Corrupt, Leased
from storage_schemas.object_store import ObjectStore, open_store
from storage_schemas.provenance import Provenance
from storage_schemas.store import Store
from tests.service.tiny import CaptureParameters, Tiny, capture, recording

KEY = "ab" * 32
AT = {"actor": "ann", "sequence": "walk", "stage": "body", "key": KEY}


@pytest.fixture(scope="module")
def endpoint():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [str(Path(sys.executable).with_name("moto_server")), "-p", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    url = f"http://127.0.0.1:{port}"
    for _ in range(200):
        try:
            httpx.get(f"{url}/moto-api/", timeout=2.0)
            break
        except httpx.HTTPError:
            time.sleep(0.2)
    client = boto3.client("s3", endpoint_url=url, region_name="us-east-1", aws_access_key_id="a", aws_secret_access_key="b")
    client.create_bucket(Bucket="bucket")
    yield url
    server.terminate()
    server.wait()


@pytest.fixture
def place(endpoint, monkeypatch, request):
    """The URL of an empty store, and where machines of these tests find it."""
    for name, value in {
        "AWS_ACCESS_KEY_ID": "a",
        "AWS_SECRET_ACCESS_KEY": "b",
        "AWS_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ALLOW_HTTP": "true",
    }.items():
        monkeypatch.setenv(name, value)
    return f"s3://bucket/{abs(hash(request.node.name))}"


def machine(place: str, tmp_path: Path, name: str = "one") -> ObjectStore:
    return ObjectStore(place, cache=tmp_path / name)


def record(value: float = 1.0) -> Tiny:
    return Tiny(values=np.full((4, 3), value, np.float32), seconds=0.0)


def publish(store: Store, value: float = 1.0):
    return store.publish(record(value), **AT, provenance=Provenance(stage="body", stage_version=1))


def objects(store: ObjectStore) -> list[str]:
    return [meta["path"] for meta in store._objects("")]


def test_what_one_machine_publishes_another_finds_and_opens(place, tmp_path):
    one, two = machine(place, tmp_path), machine(place, tmp_path, "two")
    assert two.find(**AT) is None
    ref = publish(one)
    one.set_latest(ref)
    assert two.find(**AT) == ref == two.latest("ann", "walk", "body")
    assert two.open(ref, Tiny) == record()
    assert two.provenance(ref).stage == "body"
    assert [entry.digest for entry in two.list()] == [ref.digest]
    assert two.verify() == []


def test_the_digest_is_that_of_a_disk(place, tmp_path):
    assert publish(machine(place, tmp_path)).digest == publish(Store(tmp_path / "disk")).digest


def test_the_second_writer_takes_the_first_ones(place, tmp_path):
    first = publish(machine(place, tmp_path), 1.0)
    second = publish(machine(place, tmp_path, "two"), 2.0)
    assert second == first
    assert machine(place, tmp_path, "three").open(second, Tiny) == record(1.0)


def test_without_its_manifest_an_upload_is_nothing(place, tmp_path, monkeypatch):
    store = machine(place, tmp_path)
    monkeypatch.setattr(store, "_put_manifest", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        publish(store)
    assert objects(store) != []
    assert machine(place, tmp_path, "two").find(**AT) is None
    assert publish(machine(place, tmp_path, "two")) is not None


@pytest.mark.parametrize("harm", ["delete", "cut", "flip"])
def test_a_damaged_object_is_refused_and_healed(place, tmp_path, harm):
    ref = publish(machine(place, tmp_path))
    store = machine(place, tmp_path, "two")
    victim = next(path for path in objects(store) if "/c." in path)
    whole = bytes(obstore.get(store.objects, victim).bytes())
    match harm:
        case "delete":
            obstore.delete(store.objects, victim)
        case "cut":
            obstore.put(store.objects, victim, whole[:-1])
        case "flip":
            obstore.put(store.objects, victim, whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(Corrupt):
        store.open(ref, Tiny)
    assert store.verify() != []
    assert (store.find(**AT) is None) == (harm != "flip")
    if harm == "flip":
        store.retire(ref)
    assert publish(store).digest == ref.digest
    assert store.verify() == []
    assert machine(place, tmp_path, "three").open(ref, Tiny) == record()


def interleaved(monkeypatch, store: ObjectStore, happens) -> None:
    """Before `store` fetches its first object something `happens`, once."""
    read, left = store._read, [happens]

    def interrupted(name):
        if left and not name.endswith("manifest.json"):
            left.pop()()
        return read(name)

    monkeypatch.setattr(store, "_read", interrupted)


def test_who_fetches_later_leaves_the_copy_that_others_read(place, tmp_path, monkeypatch):
    ref = publish(machine(place, tmp_path, "elsewhere"))
    first, second = machine(place, tmp_path), machine(place, tmp_path)
    copies = []
    interleaved(monkeypatch, second, lambda: copies.append(first.folder(ref).stat().st_ino))
    copies.append(second.folder(ref).stat().st_ino)
    assert copies[0] == copies[1]
    assert first.verify() == []
    copies.append(first.folder(ref).stat().st_ino)
    assert copies[0] == copies[2]
    assert list(first.folder(ref).parent.glob(".tmp-*")) == []


@pytest.mark.parametrize(
    "harm",
    [lambda chunk: chunk.unlink(), lambda chunk: chunk.write_bytes(b""), lambda chunk: shutil.rmtree(chunk.parents[2])],
    ids=["missing", "empty", "nearly all gone"],
)
def test_a_damaged_copy_is_fetched_again(place, tmp_path, harm):
    store = machine(place, tmp_path)
    ref = publish(store)
    harm(next(store.folder(ref).rglob("c.*")))
    assert store.open(ref, Tiny) == record()


def test_another_artifact_under_the_same_key_replaces_the_copy(place, tmp_path):
    here, elsewhere = machine(place, tmp_path), machine(place, tmp_path, "elsewhere")
    old = publish(here, 1.0)
    assert here.open(old, Tiny) == record(1.0)
    elsewhere.retire(old)
    new = publish(elsewhere, 2.0)
    assert here.open(new, Tiny) == record(2.0)
    with pytest.raises(Corrupt, match="the reference says"):
        here.open(old, Tiny)


def test_a_lease_is_held_once_and_falls_free_when_it_expires(place, tmp_path):
    at = tuple(AT.values())
    one, two = machine(place, tmp_path), machine(place, tmp_path, "two")
    with one.lease(*at, seconds=60.0), pytest.raises(Leased, match="is computing this"), two.lease(*at):
        pass
    with two.lease(*at, seconds=0.3) as lease:
        lease._stop.set()  # its heart stops, as when its process is killed
        with one.lease(*at, wait=10.0):
            pass


def test_a_lease_is_kept_alive(place, tmp_path):
    at = tuple(AT.values())
    with machine(place, tmp_path).lease(*at, seconds=1.0):
        time.sleep(2.5)
        with pytest.raises(Leased), machine(place, tmp_path, "two").lease(*at):
            pass


def _publish_apart(place: str, cache: Path, value: float, gate) -> None:
    gate.wait()
    publish(ObjectStore(place, cache=cache), value)


@pytest.mark.slow  # four interpreters
def test_four_writers_at_once_leave_one_whole_artifact(place, tmp_path):
    context = multiprocessing.get_context("spawn")
    gate = context.Barrier(4)
    writers = [context.Process(target=_publish_apart, args=(place, tmp_path / f"w{n}", float(n), gate)) for n in range(4)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    store = machine(place, tmp_path)
    assert len(store.list()) == 1
    assert store.verify() == []


def test_a_url_opens_an_object_store_and_a_path_a_folder(place, tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_CACHE", str(tmp_path))
    assert isinstance(open_store(place), ObjectStore)
    assert type(open_store(tmp_path / "folder")) is Store


def test_a_stage_runs_on_it_and_is_found_by_the_next(place, tmp_path):
    recording(tmp_path / "data", "ann", "walk")
    parameters = CaptureParameters(recording=tmp_path / "data/ann/walk")
    first = capture.run(machine(place, tmp_path), "ann", "walk", {}, parameters)
    again = capture.run(machine(place, tmp_path, "two"), "ann", "walk", {}, parameters)
    assert not first.cached and again.cached
    assert first.ref == again.ref
