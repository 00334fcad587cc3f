"""Damaged and hostile files for every reader, each read in a child process with a limit on time and memory.

An ending is `refused` (BadInput or a fault of the store, that names something), `read` (the damage was harmless), or one that must not be:
another `exception`, a `crash`, a `hang`, or code that ran (`executed`). An artifact, whose every byte is promised, is `read` only if it
still is what it was.
"""

import json
import os
import pickle
import random
import resource
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from tasks.child_process import ChildFailed, ChildTimedOut, run_in_children
from tasks.geometry.faults import BadInput, Fault

LIMIT_S, MEMORY = 300.0, 8 << 30  # what the child imports counts: more than half a minute on a machine out of breath
PER_CHILD = 10


class Trap:
    """A pickle that leaves a file behind when it is opened."""

    def __init__(self, sprung: Path):
        self.sprung = sprung

    def __reduce__(self):
        return os.mkdir, (str(self.sprung),)


def _tracked(at: Path) -> Path:
    sheet = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.3, 0.0], [0.0, 0.3, 0.0]])
    np.savez(at / "track.npz", vertices=np.array([sheet] * 3), faces=np.array([[0, 1, 2], [0, 2, 3]]), fps=25.0)
    return at / "track.npz"


def _picture(at: Path) -> Path:
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8)).save(at / "a.jpg")
    return at / "a.jpg"


def _mask(at: Path) -> Path:
    Image.fromarray(np.full((40, 60), 255, np.uint8)).save(at / "a.png")
    return at / "a.png"


def _calibration(at: Path) -> Path:
    from tasks.capture.calibration_actorshq import write_calibration_csv
    from tests.geometry.test_cameras import ring

    write_calibration_csv(at / "calibration.csv", ring(4, distorted=False).scaled(0.1))
    return at / "calibration.csv"


def _opencv(at: Path) -> Path:
    from tasks.capture.calibration_opencv import write_opencv
    from tests.geometry.test_cameras import ring

    write_opencv(at / "calibration.json", ring(4, distorted=False).scaled(0.1))
    return at / "calibration.json"


def _template(at: Path) -> Path:
    from tasks.capture.template import Template, write_obj
    from tests.geometry.test_meshes import CUBE, CUBE_FACES

    write_obj(at / "t.obj", Template(CUBE, CUBE_FACES, np.zeros((0, 2)), CUBE_FACES[:0], np.full(12, "body")))
    return at / "t.obj"


def _keypoints(at: Path) -> Path:
    from tasks.keypoints.keypoint_files import COCO_PARTS

    frame = {name: [1.0, 2.0, 0.9] * count for name, count in COCO_PARTS}
    (at / "Cam001.json").write_text(json.dumps([frame] * 2))
    return at / "Cam001.json"


def _opencv_yaml(at: Path) -> Path:
    return _opencv(at).rename(at / "calibration.yaml")  # JSON is YAML


def _qualisys(at: Path) -> Path:
    turn = " ".join(f'r{i}{j}="{float(i == j)}"' for i in (1, 2, 3) for j in (1, 2, 3))
    lens = 'focalLengthU="50000" focalLengthV="50000" centerPointU="2048" centerPointV="1024"'
    camera = f"""<camera serial="c{{}}" viewrotation="0"><fov_video left="0" right="63" top="0" bottom="31"/>
<transform x="{{}}000" y="0" z="1000" {turn}/><intrinsic {lens} skew="0"/></camera>"""
    (at / "rig.qca.txt").write_text(
        "<calibration><cameras>" + "\n".join(camera.format(n, n) for n in range(3)) + "</cameras></calibration>"
    )
    return at / "rig.qca.txt"


def _ply(at: Path) -> Path:
    import trimesh

    from tests.geometry.test_meshes import CUBE, CUBE_FACES

    trimesh.Trimesh(CUBE, CUBE_FACES, process=False).export(at / "m.ply", encoding="binary")
    return at / "m.ply"


def _bvh(at: Path) -> Path:
    joint = "ROOT a\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation\n"
    tip = "End Site\n{\nOFFSET 0 1 0\n}\n}\n"
    motion = "MOTION\nFrames: 3\nFrame Time: 0.1\n" + "1 2 3 40 50 60\n" * 3
    (at / "a.bvh").write_text(f"HIERARCHY\n{joint}{tip}{motion}")
    return at / "a.bvh"


def _keypoint_array(at: Path) -> Path:
    np.savez(at / "keypoints.npz", keypoints=2 * np.ones((2, 1, 133, 3)))
    return at / "keypoints.npz"


def _body(at: Path) -> Path:
    from tasks.body.model import ARRAYS

    arrays = {name: np.zeros([2 if n is None else n for n in shape], np.float32) for name, shape in ARRAYS.items()}
    ids = {"vertex_ids": np.arange(2), "vertex_id_names": np.array(["nose", "reye"])}
    np.savez(at / "body.npz", **arrays | {"f": np.array([[0, 1, 1]] * 2), "shapedirs": np.zeros((2, 3, 20))} | ids)
    return at / "body.npz"


def _film(at: Path) -> Path:
    from tests.capture.test_calibrated_video import write_video

    write_video(at / "a.mp4", [np.full((48, 64, 3), 20 * n, np.uint8) for n in range(4)])
    return at / "a.mp4"


def _notes(at: Path) -> Path:
    from tests.capture.recordings import write_sequence

    return write_sequence(at) / "physavatar.json"


def _settings(at: Path) -> Path:
    (at / "physavatar.toml").write_text('store = "store"\n[body]\nhand_weight = 0.5\n[service.workers]\nvision = 2\n')
    return at / "physavatar.toml"


def _artifact(at: Path) -> Path:
    from storage_schemas.provenance import Provenance
    from storage_schemas.store import Store
    from tests.service.tiny import Tiny

    store = Store(at / "store")
    origin = Provenance(stage="capture", stage_version=1)
    tiny = Tiny(values=np.ones((2, 3), np.float32), seconds=0.0)
    ref = store.publish(tiny, actor="a", sequence="s", stage="capture", key="0" * 64, provenance=origin)
    return store.folder(ref) / "manifest.json"


def _read_track(path: Path) -> object:
    from tasks.capture.tracked_geometry import read_tracked_geometry

    return read_tracked_geometry(path)


def _read_picture(path: Path) -> object:
    from tasks.capture.images import read_rgb

    return read_rgb(path)


def _read_mask(path: Path) -> object:
    from tasks.capture.images import read_mask

    return read_mask(path)


def _read_calibration(path: Path) -> object:
    from tasks.capture.calibration_actorshq import read_calibration_csv

    return read_calibration_csv(path)


def _read_opencv(path: Path) -> object:
    from tasks.capture.calibration_opencv import read_opencv

    return read_opencv(path)


def _read_template(path: Path) -> object:
    from tasks.capture.template import read_template

    return read_template(path)


def _read_keypoints(path: Path) -> object:
    from tasks.keypoints.keypoint_files import read_keypoints

    return read_keypoints(path.parent, ("Cam001",))


def _read_qualisys(path: Path) -> object:
    from tasks.capture.calibration_qualisys import read_qualisys

    return read_qualisys(path)


def _read_mesh(path: Path) -> object:
    from tasks.capture.template import read_mesh

    return read_mesh(path)


def _read_bvh(path: Path) -> object:
    from tasks.capture.bvh import read_bvh

    return read_bvh(path)


def _read_keypoint_array(path: Path) -> object:
    from tasks.keypoints.keypoint_files import read_keypoints

    return read_keypoints(path, ("Cam001",))


def _read_body(path: Path) -> object:
    from tasks.body.model import BodyModel

    return BodyModel.load(path)


def _read_film(path: Path) -> object:
    from tasks.capture.video import Video

    film = Video(path)
    return [film.read(n) for n in range(film.frame_count)]


def _read_notes(path: Path) -> object:
    from tasks.capture.actorshq import read_actorshq

    return read_actorshq(path.parent / "4x")


def _read_settings(path: Path) -> object:
    from flows.config import load

    return load(file=path)


def _read_artifact(path: Path) -> object:
    from storage_schemas.reference import ArtifactRef
    from storage_schemas.store import Store
    from tests.service.tiny import Tiny

    store = Store(path.parents[4])
    found = store.find("a", "s", "capture", "0" * 64)
    if faults := store.verify():
        raise BadInput([Fault(fault.where, fault.what, fault.remedy) for fault in faults])
    return store.open(
        found or ArtifactRef(actor="a", sequence="s", stage="capture", key="0" * 64, store=str(store.root), digest="0" * 64), Tiny
    )


READERS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], object]]] = {
    "jpeg": (_picture, _read_picture),
    "png mask": (_mask, _read_mask),
    "calibration csv": (_calibration, _read_calibration),
    "calibration json": (_opencv, _read_opencv),
    "template obj": (_template, _read_template),
    "track npz": (_tracked, _read_track),
    "keypoint json": (_keypoints, _read_keypoints),
    "keypoint npz": (_keypoint_array, _read_keypoint_array),
    "calibration yaml": (_opencv_yaml, _read_opencv),
    "calibration xml": (_qualisys, _read_qualisys),
    "mesh ply": (_ply, _read_mesh),
    "motion bvh": (_bvh, _read_bvh),
    "body npz": (_body, _read_body),
    "video mp4": (_film, _read_film),
    "recording json": (_notes, _read_notes),
    "settings toml": (_settings, _read_settings),
    "artifact manifest": (_artifact, _read_artifact),
}


def endings(reader: str, count: int) -> Counter:
    """How reading `count` damaged files ended. Raises whatever the reader makes of a sound one."""
    make, read = READERS[reader]
    with tempfile.TemporaryDirectory() as at:
        read(make(Path(at)))
    found: Counter = Counter({"refused": 0, "read": 0})
    for start in range(0, count, PER_CHILD):
        seeds = tuple(range(start, min(count, start + PER_CHILD)))
        try:
            found.update(run_in_children(_read_damaged, [(reader, seeds)], limit_s=LIMIT_S)[0])
        except ChildTimedOut:
            found["hang"] += len(seeds)
        except ChildFailed:
            found["crash"] += len(seeds)
    return found


def _read_damaged(reader: str, seeds: tuple[int, ...], tell: object) -> list[str]:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    return [_ending(reader, seed) for seed in seeds]


def _ending(reader: str, seed: int) -> str:
    make, read = READERS[reader]
    with tempfile.TemporaryDirectory() as at:
        place, sprung = Path(at) / "files", Path(at) / "sprung"
        place.mkdir()
        path = make(place)
        damage(path, seed, sprung)
        ending = "read"
        try:
            read(path)
        except BadInput as bad:
            ending = "refused" if all(fault.what and fault.remedy for fault in bad.faults) else "fault without words"
        except Exception as error:  # noqa: BLE001  whatever else it is must be counted
            ending = f"exception {type(error).__name__}"
        return "executed" if sprung.exists() else ending


def damage(path: Path, seed: int, sprung: Path) -> None:
    """Damage a sound file; the same seed, the same damage."""
    chance = random.Random(seed)
    whole = path.read_bytes()
    kinds: tuple[Callable[[], bytes], ...] = (
        lambda: whole[: chance.randrange(len(whole))],
        lambda: _flipped(whole, chance, 1 + chance.randrange(20)),
        lambda: b"",
        lambda: pickle.dumps(Trap(sprung)),
        lambda: _numbers(whole, chance, (b"nan", b"inf", b"-1", b"1e309", b"99999999999999999999")),
        lambda: whole + chance.randbytes(1000),
        lambda: b"[" * 200_000,
        lambda: whole.replace(b"\n", b"\0"),
        lambda: _hostile_zip(chance, sprung),
        lambda: chance.randbytes(len(whole)),
    )
    path.write_bytes(kinds[seed % len(kinds)]())


def _flipped(whole: bytes, chance: random.Random, times: int) -> bytes:
    changed = bytearray(whole)
    for _ in range(times):
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _numbers(whole: bytes, chance: random.Random, instead: tuple[bytes, ...]) -> bytes:
    digits = [n for n, byte in enumerate(whole) if chr(byte).isdigit()]
    if not digits:
        return whole[::-1]
    at = chance.choice(digits)
    return whole[:at] + chance.choice(instead) + whole[at + 1 :]


def _hostile_zip(chance: random.Random, sprung: Path) -> bytes:
    """An NPZ whose member holds a pickle, or promises a petabyte; for other readers, a file of the wrong kind."""
    with tempfile.TemporaryDirectory() as at:
        target = Path(at) / "a.npz"
        if chance.random() < 0.5:
            np.savez(target, vertices=np.array([Trap(sprung)], dtype=object), allow_pickle=True)
        else:
            with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
                header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000, 125), }"
                archive.writestr("vertices.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
        return target.read_bytes()
