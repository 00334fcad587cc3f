"""Garment motion from anybody's tracker: one NPZ, or a folder of OBJ/PLY with a file per frame.

    vertices [T, V, 3] m, faces [F, 3], fps, collider_vertices [T, C, 3], collider_faces, boundary [B], rest_vertices [V, 3], up "y" or "z",
    mass_kg, observed [T, V], noise_m scalar, [V] or [T, V], noise_cov [T, V, 3, 3] m², uv [V, 2] m (u weft, v warp), zone [V], rest_flat,
    base (JSON), clamp_force [T] N, markers [T, M, 3] with marker_faces [M], marker_barycentric [M, 3]

A vertex that was not seen is NaN or `observed` = false. A blind file, whose garment is NaN after the first frames, is legal: collider and
boundary must then be there for all frames. Everything is turned to y up on the way in. A key that nobody knows is refused when it looks
like a misspelt one, and warned about otherwise. With markers and rest_vertices, vertices may be absent.
"""

import difflib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.capture.hang_checks import hang_warnings
from tasks.capture.npz import read_npz
from tasks.capture.recording import Y_UP, up_faults
from tasks.capture.template import read_mesh
from tasks.capture.tracked_geometry_checks import KEYS, tracked_faults
from tasks.geometry.faults import BadInput, Fault, refuse

Array = NDArray[np.float64]


@dataclass(frozen=True)
class TrackedGeometry:
    """One recording of a garment in metres, y up; T frames, V vertices, F faces, C collider vertices, B boundary vertices, M markers.

    `vertices` is NaN where unknown; what is not `observed` is not known either, but for driven vertices (`cloth/known_vertices.py`).
    `noise_m` is broadcast to [T, V].
    """

    vertices: Array
    faces: NDArray[np.int32]
    fps: float
    observed: NDArray[np.bool_]
    boundary: NDArray[np.int32]
    collider_vertices: Array | None = None
    collider_faces: NDArray[np.int32] | None = None
    rest_vertices: Array | None = None
    up: str = "y"
    mass_kg: float | None = None
    noise_m: Array | None = None
    noise_cov: Array | None = None
    uv: Array | None = None
    zone: NDArray[np.str_] | None = None
    rest_flat: bool = False
    base: dict[str, object] = field(default_factory=dict)
    clamp_force: Array | None = None
    markers: Array | None = None
    marker_faces: NDArray[np.int32] | None = None
    marker_barycentric: Array | None = None
    warnings: tuple[str, ...] = ()


def read_tracked_geometry(path: Path, *, fps: float | None = None, up: str | None = None) -> TrackedGeometry:
    """An NPZ file, or a folder of meshes for which `fps` must be given. `up` overrides the file's.

    Raises BadInput with every fault.
    """
    path = Path(path)
    arrays = _read_folder(path, fps) if path.is_dir() else read_npz(path)
    if fps is not None:
        arrays["fps"] = np.asarray(fps)
    if up is not None:
        arrays["up"] = np.asarray(up)
    return tracked_geometry(arrays, name=str(path))


def tracked_geometry(arrays: dict[str, np.ndarray], *, name: str) -> TrackedGeometry:
    """The recording that these arrays, under the keys above, describe; `name` stands in messages. Raises BadInput with every fault."""
    faults, warnings = _key_faults(arrays, name)
    faults += tracked_faults(arrays, name)
    up = str(arrays.get("up", "y"))
    refuse([*faults, *up_faults(up, f"{name}: up")])
    warnings += hang_warnings(arrays, name)
    a = arrays
    T, V = _frames_and_vertices(a)
    vertices = _float(a["vertices"]) if "vertices" in a else np.full((T, V, 3), np.nan)
    seen = np.isfinite(vertices).all(2)
    optional = {
        k: _float(a[k]) for k in ("collider_vertices", "rest_vertices", "uv", "clamp_force", "markers", "marker_barycentric") if k in a
    }
    optional |= {k: a[k].astype(np.int32) for k in ("collider_faces", "marker_faces") if k in a}
    track = TrackedGeometry(
        vertices=np.where(seen[..., None], vertices, np.nan),
        faces=a["faces"].astype(np.int32),
        fps=float(a["fps"]),
        observed=a["observed"].astype(bool) if "observed" in a else seen,
        boundary=a["boundary"].astype(np.int32) if "boundary" in a else np.zeros(0, np.int32),
        mass_kg=float(a["mass_kg"]) if "mass_kg" in a else None,
        noise_m=np.broadcast_to(_float(a["noise_m"]), (T, V)) if "noise_m" in a else None,
        noise_cov=_float(a["noise_cov"]) if "noise_cov" in a else None,
        zone=a["zone"].astype(np.str_) if "zone" in a else None,
        rest_flat=bool(a.get("rest_flat", False)),
        base=json.loads(str(a["base"])) if "base" in a else {},
        warnings=tuple(warnings),
        **optional,
    )
    return _turned(track, up)


def write_tracked_geometry(path: Path, track: TrackedGeometry) -> None:
    """The inverse of `read_tracked_geometry` for a recording that is y up."""
    arrays = {k: getattr(track, k) for k in KEYS if getattr(track, k) is not None}
    arrays["base"] = json.dumps(track.base)
    np.savez_compressed(path, **arrays)


def _frames_and_vertices(a: dict[str, np.ndarray]) -> tuple[int, int]:
    return a["vertices"].shape[:2] if "vertices" in a else (len(a["markers"]), len(a["rest_vertices"]))


def _turned(track: TrackedGeometry, up: str) -> TrackedGeometry:
    """The same recording with y up; a rest shape that lies flat is turned too, since its plane carries no meaning."""
    Q = Y_UP[up]
    turn = {
        k: getattr(track, k) @ Q.T for k in ("vertices", "collider_vertices", "rest_vertices", "markers") if getattr(track, k) is not None
    }
    if track.noise_cov is not None:
        turn["noise_cov"] = Q @ track.noise_cov @ Q.T
    return replace(track, **turn, up="y") if up != "y" else track


def _key_faults(arrays: dict[str, np.ndarray], name: str) -> tuple[list[Fault], list[str]]:
    faults, warnings = [], []
    for key in arrays:
        if key not in KEYS:
            close = difflib.get_close_matches(key, KEYS, 1, 0.75)
            if close:
                faults.append(Fault(name, f"has the key {key!r}, which is not known", f"Did you mean {close[0]!r}? Otherwise rename it."))
            else:
                warnings.append(f"{name}: the key {key!r} is not known and not used.")
    return faults, warnings


def _read_folder(folder: Path, fps: float | None) -> dict[str, np.ndarray]:
    """Meshes in the order of the last number in their names, all with the faces of the first."""
    files = sorted((p for p in folder.iterdir() if p.suffix.lower() in (".obj", ".ply")), key=_last_number)
    refuse([] if files else [Fault(str(folder), "holds no .obj or .ply", "Give one mesh per frame.")])
    refuse([] if fps is not None else [Fault(str(folder), "says nothing about time", "Give fps, the number of meshes per second.")])
    return _stack(files)


def _stack(files: Sequence[Path]) -> dict[str, np.ndarray]:
    faults, vertices, first = [], [], None
    for file in files:
        try:
            mesh = read_mesh(file)
        except BadInput as bad:
            faults += bad.faults
            continue
        first = first or mesh
        if mesh.vertices.shape != first.vertices.shape or not np.array_equal(mesh.faces, first.faces):
            faults.append(
                Fault(str(file), f"has other faces or vertices than {files[0].name}", "A track keeps one mesh; register the scans first.")
            )
        vertices.append(mesh.vertices)
    numbers = [_last_number(f)[0] for f in files]
    if sorted(set(numbers)) != list(range(min(numbers), min(numbers) + len(files))):
        faults.append(
            Fault(
                str(files[0].parent),
                f"has {len(files)} meshes numbered {min(numbers)} to {max(numbers)}",
                "Number the frames without gaps.",
            )
        )
    refuse(faults)
    return {"vertices": np.stack(vertices), "faces": first.faces}


def _last_number(path: Path) -> tuple[int, str]:
    digits = re.findall(r"[0-9]{1,12}", path.stem)
    return (int(digits[-1]) if digits else -1, path.name)


def _float(array: np.ndarray) -> Array:
    return np.asarray(array, np.float64)
