"""Qualisys camera calibration (`.qca.txt`, XML).

    f = focalLength / 64 px      c = centerPoint / 64 px + 0.5 px − (left, top) px of fov_video      (U right, V down)
    R = diag(1, −1, −1) R_file      t = −R C, C = (x, y, z) in mm
    distortion k1 k2 p1 p2 k3 = radialDistortion1 2, tangentalDistortion1 2, radialDistortion3 (OpenCV's polynomial)

The factors were established on public footage by triangulation (five other axis conventions are off by ten times as much). The sensor
runs from 0 to 64 × the last pixel's number, so the file counts pixel centres as integers and 0.5 px is added here. The centre point counts
from the whole sensor, the picture begins at left, top of fov_video (perfanalytics/pose2sim reads it so too); the public footage has 0, 0.
The world stays as in the file: z up. A camera whose view is rotated or whose pixels are skewed is refused.
"""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np

from tasks.capture.recording import camera_faults, nearest_rotations, validate_name
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault, refuse

SUBPIXELS = 64
MAX_BYTES = 16 << 20
LENS = ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV")
DISTORTION = ("radialDistortion1", "radialDistortion2", "tangentalDistortion1", "tangentalDistortion2", "radialDistortion3")


def read_qualisys(path: Path) -> Cameras:
    """The rig, in metres and z up, named by the cameras' serials. Raises BadInput with every fault of every camera."""
    rows, faults = [], []
    for number, camera in enumerate(_parse(path).iter("camera"), 1):
        where = f"{path}, camera {number}"
        try:
            rows.append(_camera(camera, where))
        except BadInput as bad:
            faults += bad.faults
        except (ValueError, KeyError, AttributeError) as error:
            faults.append(Fault(where, f"lacks a number or cannot be read ({error})", "Export the calibration again from QTM."))
    names = [row[0] for row in rows]
    faults += [
        Fault(str(path), f"{n} occurs twice", "Keep one entry per camera.") for n in sorted({n for n in names if names.count(n) > 1})
    ]
    refuse(faults if rows or faults else [Fault(str(path), "holds no camera", "Export the calibration again from QTM.")])
    K, R, C, size, distortion = (np.array(column) for column in list(zip(*rows, strict=True))[1:])
    rig = Cameras(tuple(names), K, R, _shift(R, C), size.astype(np.int32), distortion)
    refuse(camera_faults(rig, str(path)))
    R = nearest_rotations(R)
    return replace(rig, R=R, t=_shift(R, C))


def _shift(R: np.ndarray, C: np.ndarray) -> np.ndarray:
    """t = −R C [camera, 3] m."""
    return -np.einsum("kij,kj->ki", R, C)


def _parse(path: Path) -> ET.Element:
    try:
        content = Path(path).read_bytes()
        if len(content) > MAX_BYTES or b"<!" in content.replace(b"<!--", b""):  # no entities: they are how XML explodes
            raise ValueError("too large, or with a document type of its own")
        return ET.fromstring(content)
    except (OSError, ValueError, LookupError, ET.ParseError) as error:
        raise BadInput([Fault(str(path), f"is no readable XML ({error})", "Export the calibration again from QTM.")]) from None


def _camera(camera: ET.Element, where: str) -> tuple:
    name = validate_name(camera.attrib["serial"], where)
    pose, lens, view = (camera.find(tag).attrib for tag in ("transform", "intrinsic", "fov_video"))
    if float(camera.get("viewrotation", 0)) or float(lens.get("skew", 0)):
        refuse(
            [
                Fault(
                    where,
                    f"viewrotation {camera.get('viewrotation')}, skew {lens.get('skew')}",
                    "Only upright views without skew are read.",
                )
            ]
        )
    fu, fv, cu, cv = (_number(lens[k]) / SUBPIXELS for k in LENS)
    left, top = _number(view["left"]), _number(view["top"])
    K = np.array([[fu, 0, cu + 0.5 - left], [0, fv, cv + 0.5 - top], [0, 0, 1]])
    R = np.diag([1.0, -1, -1]) @ np.array([[_number(pose[f"r{i}{j}"]) for j in (1, 2, 3)] for i in (1, 2, 3)])
    C = np.array([_number(pose[axis]) for axis in "xyz"]) / 1000
    size = [int(view["right"]) - int(view["left"]) + 1, int(view["bottom"]) - int(view["top"]) + 1]
    if not (0 < size[0] <= 20_000 and 0 < size[1] <= 20_000):
        raise ValueError(f"{size[0]} x {size[1]} pixels")
    return name, K, R, C, size, [_number(lens.get(k, "0")) for k in DISTORTION]


def _number(text: str) -> float:
    value = float(text)
    if not abs(value) < 1e9:
        raise ValueError(f"{text[:40]!r} is no number of a camera")
    return value
