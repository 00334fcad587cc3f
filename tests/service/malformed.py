"""Damaged and hostile files for every reader, each read in a child process with a limit on time and memory.

An ending is `refused` (BadInput with a fault that names something), `read` (the damage was harmless), or one that must not be: another
`exception`, a `crash`, a `hang`, or code that ran (`executed`).
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
from tasks.geometry.faults import BadInput

LIMIT_S, MEMORY = 30.0, 8 << 30
PER_CHILD = 10


class Trap:
    """A pickle that leaves a file behind when it is opened."""

    def __init__(self, sprung: Path):
        self.sprung = sprung

    def __reduce__(self):
        return os.mkdir, (str(self.sprung),)


def _tracked(at: Path) -> Path:
    np.savez(at / "track.npz", vertices=np.zeros((3, 4, 3)), faces=np.array([[0, 1, 2], [0, 2, 3]]), fps=25.0)
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
    frames = [{"people": [{"keypoints": [1.0, 2.0, 0.9] * 133}]}] * 2
    (at / "Cam001.json").write_text(json.dumps(frames))
    return at / "Cam001.json"


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


READERS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], object]]] = {
    "jpeg": (_picture, _read_picture),
    "png mask": (_mask, _read_mask),
    "calibration csv": (_calibration, _read_calibration),
    "calibration json": (_opencv, _read_opencv),
    "template obj": (_template, _read_template),
    "track npz": (_tracked, _read_track),
    "keypoint json": (_keypoints, _read_keypoints),
}


def endings(reader: str, count: int) -> Counter:
    """How reading `count` damaged files ended."""
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
