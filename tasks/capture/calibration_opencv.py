"""Calibrations as OpenCV users keep them: JSON or YAML, one file with all cameras or a folder with a file per camera.

    {"cameras": {"cam01": {"image_width", "image_height", "camera_matrix" [3, 3], "distortion_coefficients" [4, 5 or 8],
                           "R" [3, 3] or "rvec" [3], "T" or "tvec" [3]}, ...}, "unit": "m" | "mm", "up": "y" | "z"}

x_cam = R x + T as in `cv2.projectPoints`. OpenCV counts pixel centres as integers; 0.5 px is added on reading and taken off on writing.
Matrices may be nested lists, flat lists, or OpenCV's own {rows, cols, data}. Eight distortion coefficients are accepted where the last
three, the rational model's, are zero. Other keys are refused, since what they say would be lost, but for those of `IGNORED`.
"""

import difflib
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from tasks.capture.recording import camera_faults, nearest_rotations, up_faults, validate_name
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault, refuse
from tasks.geometry.rotations import matrix_from_axis_angle

UNITS = {"m": 1.0, "mm": 1e-3}
SHARED = ("unit", "up")
CAMERA = ("image_width", "image_height", "camera_matrix", "distortion_coefficients", "R", "rvec", "T", "tvec")
IGNORED = (  # what OpenCV's own programs write beside a lens: calibration, camera_calibration, calibrate_camera_charuco
    "calibration_time",
    "nframes",
    "nr_of_frames",
    "board_width",
    "board_height",
    "square_size",
    "marker_size",
    "aspectRatio",
    "fix_aspect_ratio",
    "flags",
    "fisheye_model",
    "avg_reprojection_error",
    "per_view_reprojection_errors",
    "extrinsic_parameters",
    "image_points",
    "grid_points",
)
MAX_BYTES = 4 << 20
REMEDY = "See the layout in the header of tasks/capture/calibration_opencv.py."


def read_opencv(path: Path) -> tuple[Cameras, str]:
    """The rig in metres, in the file's own world, and that world's vertical ("y" where the file says nothing). Raises BadInput."""
    path = Path(path)
    content = _gather(path) if path.is_dir() else _load(path)
    unit, up, entries = content.get("unit", "m"), content.get("up", "y"), content.get("cameras")
    faults = up_faults(up, str(path)) + _key_faults(content, ("cameras", *SHARED), str(path))
    if not isinstance(unit, str) or unit not in UNITS:
        faults.append(Fault(str(path), f"unit is {unit!r}", 'Write "m" or "mm".'))
    if not isinstance(entries, dict) or not entries:
        refuse([*faults, Fault(str(path), "holds no cameras", REMEDY)])
    rows = {}
    for name, entry in entries.items():
        faults += _key_faults(entry, CAMERA, f"{path}: {name}") if isinstance(entry, dict) else []
        try:
            rows[validate_name(name, str(path))] = _camera(entry)
        except BadInput as bad:
            faults += bad.faults
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            faults.append(Fault(f"{path}: {name}", f"cannot be understood ({type(error).__name__}: {error})", REMEDY))
    refuse(faults)
    K, R, t, size, distortion = (np.array(column) for column in zip(*rows.values(), strict=True))
    rig = Cameras(tuple(rows), K, R, t * UNITS[unit], size.astype(np.int32), distortion)
    refuse(camera_faults(rig, str(path)))
    return replace(rig, R=nearest_rotations(rig.R)), up


def write_opencv(path: Path, cameras: Cameras, *, up: str = "y") -> None:
    """All cameras in one JSON, in metres."""
    K = cameras.K.copy()
    K[:, :2, 2] -= 0.5
    entries = {
        name: {
            "image_width": int(cameras.size[k, 0]),
            "image_height": int(cameras.size[k, 1]),
            "camera_matrix": K[k].tolist(),
            "distortion_coefficients": cameras.distortion[k].tolist(),
            "R": cameras.R[k].tolist(),
            "T": cameras.t[k].tolist(),
        }
        for k, name in enumerate(cameras.names)
    }
    Path(path).write_text(json.dumps({"unit": "m", "up": up, "cameras": entries}, indent=1))


def _key_faults(given: dict, known: tuple[str, ...], where: str) -> list[Fault]:
    """A fault for every key that is neither known nor written by OpenCV's own programs."""
    faults = []
    for key in (k for k in given if k not in known and k not in IGNORED):
        near = difflib.get_close_matches(str(key).lower(), known, 1, 0.25)  # far enough to lead from `dist` to its coefficients
        remedy = (f"Did you mean {near[0]!r}? " if near else "") + f"Known here: {', '.join(known)}; leave others out."
        faults.append(Fault(where, f"has the key {key!r}, which is not known", remedy))
    return faults


def _camera(entry: dict) -> tuple:
    size = [int(entry["image_width"]), int(entry["image_height"])]
    if not (0 < size[0] <= 20_000 and 0 < size[1] <= 20_000):
        raise ValueError(f"{size[0]} x {size[1]} pixels")
    if entry.get("fisheye_model"):
        raise ValueError("fisheye_model is set, and fisheye lenses are not read")
    K = _numbers(entry["camera_matrix"], 9).reshape(3, 3)
    K[:2, 2] += 0.5
    if K[0, 1] or K[1, 0] or (K[2] != [0, 0, 1]).any():
        raise ValueError("camera_matrix must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    d = _numbers(entry.get("distortion_coefficients", [0] * 5))
    if len(d) not in (4, 5, 8) or d[5:].any():
        raise ValueError(f"{len(d)} distortion_coefficients, or a rational model")
    R = _numbers(entry["R"], 9).reshape(3, 3) if "R" in entry else matrix_from_axis_angle(_numbers(entry["rvec"], 3))
    return K, R, _numbers(entry["T"] if "T" in entry else entry["tvec"], 3), size, np.pad(d, (0, 5))[:5]


def _numbers(value: object, count: int | None = None) -> np.ndarray:
    array = np.asarray(value["data"] if isinstance(value, dict) else value, float).ravel()
    if not np.isfinite(array).all() or np.abs(array).max(initial=0) > 1e9 or (count is not None and len(array) != count):
        raise ValueError(f"{len(array)} numbers where {count or 'several'} finite ones are needed")
    return array.copy()


def _gather(folder: Path) -> dict:
    """A file per camera, named after it; unit and up may stand in any of them, and must agree."""
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in (".json", ".yml", ".yaml"))
    contents = {p.stem: _load(p) for p in files}
    shared = {k: sorted({str(c.pop(k)) for c in contents.values() if k in c}) for k in SHARED}
    refuse([Fault(str(folder), f"{k} differs between files: {v}", "Write the same in all.") for k, v in shared.items() if len(v) > 1])
    return {"cameras": contents} | {k: v[0] for k, v in shared.items() if v}


def _load(path: Path) -> dict:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"larger than {MAX_BYTES >> 20} MiB")
        text = path.read_text("utf-8")
        content = json.loads(text) if path.suffix.lower() == ".json" else yaml.load(re.sub(r"\A%YAML.*\n", "", text), _Loader)
        if not isinstance(content, dict):
            raise ValueError("it is no mapping")
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise BadInput([Fault(str(path), f"cannot be read ({error})", REMEDY)]) from None
    return content


class _Loader(yaml.SafeLoader):
    """The safe loader, which makes plain values only, without aliases (they are how YAML explodes) and with OpenCV's matrices."""

    def compose_node(self, parent: yaml.Node, index: object) -> yaml.Node:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases are not read")
        return super().compose_node(parent, index)


for _tag in ("opencv-matrix", "opencv-nd-matrix"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_tag}", lambda loader, node: loader.construct_mapping(node, deep=True))
