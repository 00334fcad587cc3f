"""What is opened is what was published, or an error says which file is not; never zeros."""

import contextlib
import shutil

import numpy as np
import pytest
import zarr.storage
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from storage_schemas import manifest
from storage_schemas.faults import BadName, BadRecord, Corrupt, NewerFormat
from storage_schemas.fields import array
from storage_schemas.keypoints import Keypoints
from storage_schemas.record import Record
from storage_schemas.reference import Address, ArtifactRef
from storage_schemas.report import Report
from storage_schemas.store import Store
from storage_schemas.tree import files_below
from tests.storage_schemas.examples import examples, key_of, keypoints, provenance

AT = {"actor": "anna", "sequence": "walk", "stage": "keypoints"}


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "store")


def put(store: Store, record: Record, number: int = 0, **inputs) -> ArtifactRef:
    return store.publish(record, **AT, key=key_of(number), provenance=provenance(**inputs))


@pytest.mark.parametrize("schema", sorted(examples()))
def test_every_record_comes_back_equal(store, schema):
    record = examples()[schema]
    assert store.open(put(store, record), type(record)) == record
    assert store.verify() == []


@given(frames=st.integers(0, 70), start=st.integers(0, 70), stop=st.integers(0, 70))
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_part_of_the_frames_is_that_part(store, frames, start, stop):
    record = keypoints(frames=frames, seed=frames)
    ref = put(store, record, frames)
    part = store.open(ref, Keypoints, frames=slice(start, stop))
    assert np.array_equal(part.score, record.score[start:stop])
    assert part.camera_names == record.camera_names


class Walk(Record, name="walk", version=1):
    x: np.ndarray = array("frame 3", "float64", "m")


@pytest.mark.parametrize("frames", [1, 29, 30, 31, 299, 300, 301, 601])
def test_nothing_is_lost_at_the_edges_of_chunks_and_shards(store, frames):
    record = Walk(x=np.random.default_rng(frames).normal(size=(frames, 3)))
    ref = put(store, record)
    assert store.open(ref, Walk) == record
    assert np.array_equal(store.open(ref, Walk, frames=slice(frames - 2, frames)).x, record.x[frames - 2 : frames])


def test_an_empty_axis_is_kept(store):
    class Loose(Record, name="loose", version=1):
        vertices: np.ndarray = array("vertex 3", "float32", "m")
        colour: np.ndarray | None = array("vertex 3", "float32", "1", default=None)

    record = Loose(vertices=np.zeros((0, 3), "float32"))
    assert store.open(put(store, record), Loose) == record


def test_the_digest_depends_on_the_content_alone(tmp_path):
    one, other = Store(tmp_path / "one"), Store(tmp_path / "other")
    here, there = put(one, keypoints()), put(other, keypoints(), 1, earlier=put(other, keypoints(seed=1), 2))
    assert here.digest == there.digest != put(one, keypoints(seed=1), 3).digest


def test_who_comes_second_gets_the_first(store):
    first = put(store, keypoints(seed=1))
    assert put(store, keypoints(seed=2)) == first
    assert store.open(first, Keypoints) == keypoints(seed=1)


def test_a_reference_is_small_json_and_survives_it(store):
    ref = put(store, keypoints())
    assert ArtifactRef.model_validate_json(ref.model_dump_json()) == ref
    assert store.find(**AT, key=ref.key) == ref
    assert store.find(**AT, key=key_of(9)) is None


def chunk(folder, name="keypoints"):
    return min((folder / "data.zarr" / name).glob("c.*"))


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


DAMAGES = {
    "missing": lambda path: path.unlink(),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "grown": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "flipped": flip,
}
VICTIMS = {
    "sharded": lambda folder: chunk(folder),
    "metadata": lambda folder: folder / "data.zarr" / "score" / "zarr.json",
    "manifest": lambda folder: folder / "manifest.json",
}


@pytest.mark.parametrize("damage", sorted(DAMAGES))
@pytest.mark.parametrize("victim", sorted(VICTIMS))
def test_damage_is_refused(store, damage, victim):
    ref = put(store, keypoints(frames=40))
    assert store.open(ref, Keypoints) == keypoints(frames=40)  # the control
    path = VICTIMS[victim](store.folder(ref))
    DAMAGES[damage](path)
    with pytest.raises(Corrupt) as caught:
        store.open(ref, Keypoints)
    assert str(path.relative_to(store.root)).split("/c.")[0] in str(caught.value)
    assert store.verify(ref)


@pytest.mark.parametrize("damage", sorted(DAMAGES))
def test_damage_to_a_plain_array_and_to_a_file_is_refused(store, damage):
    for number, (schema, victim) in enumerate(
        {"skinning": lambda f: chunk(f, "weights"), "report": lambda f: f / "files" / "plot.png"}.items()
    ):
        record = examples()[schema]
        ref = put(store, record, number)
        DAMAGES[damage](victim(store.folder(ref)))
        with pytest.raises(Corrupt):
            store.open(ref, type(record))


def test_a_shard_is_guarded_wherever_it_is_flipped(store):
    """zarr guards only a shard's index by itself; without crc32c inside, most of these flips would be read as data."""
    ref = put(store, keypoints(frames=2))
    path = chunk(store.folder(ref), "boxes")
    content = path.read_bytes()
    for at in range(0, len(content), 5):
        path.write_bytes(content[:at] + bytes([content[at] ^ 16]) + content[at + 1 :])
        with pytest.raises(Corrupt):
            store.open(ref, Keypoints)
    path.write_bytes(content)
    assert store.open(ref, Keypoints) == keypoints(frames=2)


def test_an_all_zero_array_is_on_the_disk(store):
    """A chunk of zeros that is not written could not be told from one that was lost."""
    blank = keypoints().model_copy(update={"score": np.zeros((3, 2, 133), "float32")})
    assert chunk(store.folder(put(store, blank)), "score").stat().st_size > 0


def test_an_added_file_is_refused(store):
    ref = put(store, keypoints())
    (store.folder(ref) / "data.zarr" / "score" / "c.7.0.0").write_bytes(b"")
    with pytest.raises(Corrupt, match="is not in the manifest"):
        store.open(ref, Keypoints)


def test_another_artifact_in_the_place_of_this_one_is_refused(store):
    mine, other = put(store, keypoints(seed=1)), put(store, keypoints(seed=2), 1)
    shutil.rmtree(store.folder(mine))
    shutil.copytree(store.folder(other), store.folder(mine))
    with pytest.raises(Corrupt, match="the reference says"):
        store.open(mine, Keypoints)


class Reading:
    """How zarr reads: before its read number `at` something `happens`, and after it something `follows`."""

    def __init__(self, monkeypatch):
        self.read = zarr.storage.LocalStore.get
        self.expect(0)
        monkeypatch.setattr(zarr.storage.LocalStore, "get", self._get())

    def expect(self, at, happens=lambda: None, follows=lambda: None):
        self.count, self.at, self.happens, self.follows = 0, at, happens, follows

    def _get(self):
        async def get(store, *arguments, **more):
            self.count += 1
            due = self.count == self.at
            if due:
                self.happens()
            found = await self.read(store, *arguments, **more)
            if due:
                self.follows()
            return found

        return get


@pytest.fixture
def reading(monkeypatch):
    return Reading(monkeypatch)


def reads_of(reading, store, ref, schema) -> range:
    reading.expect(0)
    store.open(ref, schema)
    return range(1, reading.count + 1)


@pytest.mark.parametrize("schema", ["keypoints", "cloth", "report"])
def test_what_vanishes_while_it_is_read_is_refused(store, reading, schema):
    """zarr reads a chunk that is gone as zeros, and forgets an array that is gone."""
    record = examples()[schema]
    ref = put(store, record)
    for at in reversed(reads_of(reading, store, ref, type(record))):
        reading.expect(at, lambda: store.retire(ref))
        with pytest.raises(Corrupt):
            store.open(ref, type(record))
        assert put(store, record) == ref


def test_what_is_replaced_while_it_is_read_is_refused(store, reading, tmp_path):
    """A computation that does not come to the same bits twice, done again: each array is sound, together they are nobody's."""
    ref = put(store, keypoints(seed=1))
    elsewhere = Store(tmp_path / "elsewhere")
    other = elsewhere.folder(put(elsewhere, keypoints(seed=2)))
    for at in reversed(reads_of(reading, store, ref, Keypoints)):
        reading.expect(at, lambda: (store.retire(ref), shutil.copytree(other, store.folder(ref))))
        with pytest.raises(Corrupt):
            store.open(ref, Keypoints)
        store.retire(ref)
        assert put(store, keypoints(seed=1)) == ref


def test_what_is_being_removed_is_not_found(store, monkeypatch):
    ref = put(store, keypoints())

    def files_that_go(folder):
        listed = list(files_below(folder))
        store.retire(ref)
        return listed

    monkeypatch.setattr(manifest, "files_below", files_that_go)
    assert store.find(**AT, key=ref.key) is None


def test_what_is_away_for_a_moment_of_its_reading_is_refused_or_whole(store, reading):
    """As when somebody mends it: the folder is as published before and after, and was not in between."""
    record = keypoints()
    ref = put(store, record)
    folder, away = store.folder(ref), store.root / "away"
    for at in reversed(reads_of(reading, store, ref, Keypoints)):
        reading.expect(at, lambda: folder.rename(away), lambda: away.rename(folder))
        with contextlib.suppress(Corrupt):
            assert store.open(ref, Keypoints) == record


@pytest.mark.parametrize(
    "harm",
    [
        lambda file: file.unlink(),
        lambda file: file.write_bytes(file.read_bytes()[:-1]),
        lambda file: file.write_bytes(file.read_bytes() + b"0"),
        lambda file: file.with_name("added").write_bytes(b""),
    ],
    ids=["missing", "shorter", "longer", "added"],
)
def test_a_damaged_artifact_is_not_found_and_is_replaced(store, harm):
    ref = put(store, keypoints())
    harm(chunk(store.folder(ref)))
    assert store.find(**AT, key=ref.key) is None
    assert put(store, keypoints()) == ref
    assert store.open(ref, Keypoints) == keypoints()
    assert [path.name for path in store.folder(ref).parent.glob(".tmp-*")] == []


def test_verify_reads_every_byte_and_follows_the_inputs(store):
    ref = put(store, keypoints(seed=1))
    derived = put(store, keypoints(seed=2), 1, earlier=ref)
    flip(chunk(store.folder(derived)))
    assert ["has another SHA-256" in str(fault) for fault in store.verify(derived)] == [True]
    shutil.rmtree(store.folder(ref))
    assert any("its input 'earlier'" in str(fault) for fault in store.verify())


class Newer(Record, name="keypoints", version=2):
    points: np.ndarray = array("frame camera 133 2", "float32", "px")

    @classmethod
    def migrate(cls, version, fields):
        return {"points": fields["keypoints"]}


class Changed(Record, name="keypoints", version=1):
    keypoints: np.ndarray = array("frame camera 133 2", "float32", "m")
    score: np.ndarray = array("frame camera 133", "float32", "1")
    boxes: np.ndarray = array("frame camera 4", "float32", "px")
    camera_names: tuple[str, ...]
    detector: str
    detector_sha256: str


class Smaller(Record, name="keypoints", version=1):
    keypoints: np.ndarray = array("frame camera 133 2", "float32", "px")


def test_an_older_schema_version_is_migrated_and_a_newer_one_refused(store):
    assert np.array_equal(store.open(put(store, keypoints()), Newer).points, keypoints().keypoints)
    newer = put(store, Newer(points=keypoints().keypoints), 1)
    with pytest.raises(NewerFormat, match=r"keypoints version 2 was written by a newer physavatar; this one reads up to 1.*upgrade"):
        store.open(newer, Keypoints)


def test_a_schema_that_changed_without_a_new_version_is_refused(store):
    ref = put(store, keypoints())
    with pytest.raises(Corrupt, match=r"Changed\.keypoints: is stored as \[frame camera 133 2, float32, px\]"):
        store.open(ref, Changed)
    with pytest.raises(BadRecord, match=r"Smaller\.score: is not a field"):
        store.open(ref, Smaller)
    with pytest.raises(Corrupt, match="holds schema 'keypoints' version 1, not 'report'"):
        store.open(ref, Report)


def test_a_newer_store_and_a_folder_that_is_none_are_refused(tmp_path):
    Store(tmp_path / "store")
    (tmp_path / "store" / "STORE_VERSION").write_text('{"format": 99}')
    with pytest.raises(NewerFormat, match="format 99; this physavatar reads and writes up to 1; upgrade"):
        Store(tmp_path / "store")
    (tmp_path / "store" / "STORE_VERSION").write_text("?")
    with pytest.raises(Corrupt, match="does not say which format"):
        Store(tmp_path / "store")
    with pytest.raises(Corrupt, match="no store"):
        Store(tmp_path)


def test_who_only_looks_founds_nothing(tmp_path):
    looked = Store(tmp_path / "new", founds=False)
    assert not looked.is_founded() and not looked.root.exists()
    assert looked.list() == [] and looked.latest(**AT) is None and looked.find(**AT, key=key_of(0)) is None
    (tmp_path / "notes.txt").touch()
    with pytest.raises(Corrupt, match="no store"):
        Store(tmp_path, founds=False)
    Store(looked.root)
    assert looked.is_founded() and Store(looked.root, founds=False).is_founded()


@pytest.mark.parametrize("name", ["..", ".", "", "a/b", "/etc", ".latest.json", "a\0b", "-rf", "x" * 101, "é", "a\n"])
def test_names_stay_in_their_folder(store, name):
    for part in ("actor", "sequence", "stage"):
        with pytest.raises(BadName, match="is not a name"):
            store.find(**(AT | {part: name}), key=key_of(0))
    with pytest.raises(BadName, match="is not a SHA-256"):
        store.find(**AT, key=name)


def test_good_names_are_names():
    assert str(Address(actor="_all", sequence="Sequence1", stage="cloth.fit-2", key=key_of(0))) == f"_all/Sequence1/cloth.fit-2/{key_of(0)}"


def test_latest_moves_and_the_listing_tells_sizes(store):
    assert store.latest(**AT) is None
    refs = [put(store, keypoints(seed=seed), seed) for seed in range(2)]
    for ref in refs:
        store.set_latest(ref)
        assert store.latest(**AT) == ref
    entries = store.list("anna")
    assert {entry.digest for entry in entries} == {ref.digest for ref in refs}
    assert all(entry.schema_name == "keypoints" and entry.bytes > 1000 for entry in entries)
    assert store.list("bert") == []


def test_the_listing_shows_damaged_artifacts(store):
    ref = put(store, keypoints())
    (store.folder(ref) / "manifest.json").unlink()
    assert [(entry.address, entry.digest) for entry in store.list()] == [(ref.address, None)]


def test_the_checkpoint_lasts_until_publication(store):
    folder = store.checkpoint_dir(**AT, key=key_of(0))
    (folder / "frame_0001.npz").write_bytes(b"x")
    assert list(store.checkpoint_dir(**AT, key=key_of(0)).iterdir())
    put(store, keypoints())
    assert not folder.exists()


def test_provenance_is_kept(store):
    first = put(store, keypoints())
    kept = store.provenance(put(store, keypoints(seed=1), 1, earlier=first))
    assert kept.inputs == {"earlier": first}
    assert kept.parameters == {"step": 0.01}
    assert {"python", "numpy", "zarr"} <= kept.versions.keys()
