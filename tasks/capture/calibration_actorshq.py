"""calibration.csv of an ActorsHQ scale folder, read and written.

Camera-to-WORLD axis-angle (rx, ry, rz, radians) and the camera centre (tx, ty, tz, metres), camera axes right, down, forward; fx, px are
divided by the width and fy, py by the height, 0.5 being the middle of the picture, so pixel centres lie at half integers as in
`geometry.cameras`. No distortion. Source: synthesiaresearch/humanrf, actorshq/dataset/camera_data.py (Işık et al. 2023).
"""

import csv
import io
from collections import Counter
from pathlib import Path

import numpy as np

from tasks.capture.recording import camera_faults, validate_name
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault, refuse
from tasks.geometry.rotations import axis_angle_from_matrix, matrix_from_axis_angle

COLUMNS = ["name", "w", "h", "rx", "ry", "rz", "tx", "ty", "tz", "fx", "fy", "px", "py"]
MAX_BYTES = 64 << 20


def read_calibration_csv(path: Path) -> Cameras:
    """The rig of one scale folder. Raises BadInput with every fault of every row."""
    where, faults, rows = str(path), [], []
    for number, row in enumerate(read_csv(path, COLUMNS), 2):
        try:
            name, values = validate_name(row["name"], f"{where}, line {number}"), np.array([float(row[c]) for c in COLUMNS[1:]])
            if (
                not np.isfinite(values).all()
                or np.abs(values).max() > 1e6
                or (values[:2] != np.rint(values[:2])).any()
                or (values[:2] < 1).any()
            ):
                raise ValueError(f"{name} has values out of range")
            rows.append((name, values))
        except BadInput as bad:
            faults += bad.faults
        except (TypeError, ValueError) as error:
            faults.append(Fault(f"{where}, line {number}", str(error), f"Every row holds {','.join(COLUMNS)}, all finite numbers."))
    faults += [Fault(where, f"{n} occurs {c} times", "Keep one row per camera.") for n, c in Counter(n for n, _ in rows).items() if c > 1]
    if not rows and not faults:
        faults.append(Fault(where, "holds no camera", "Copy calibration.csv again."))
    refuse(faults)
    rig = _rig(tuple(n for n, _ in rows), np.array([v for _, v in rows]))
    refuse(camera_faults(rig, where))
    return rig


def write_calibration_csv(path: Path, cameras: Cameras) -> None:
    """The inverse of `read_calibration_csv`, without spaces, as ActorsHQ's own loader needs it. Raises BadInput for distorted cameras."""
    refuse(
        [
            Fault(n, "has distortion, which calibration.csv cannot hold", "Undistort the pictures first.")
            for n, d in zip(cameras.names, cameras.distortion, strict=True)
            if d.any()
        ]
    )
    w, h = cameras.size.T
    K = cameras.K
    lens = np.stack([K[:, 0, 0] / w, K[:, 1, 1] / h, K[:, 0, 2] / w, K[:, 1, 2] / h], 1)
    pose = np.concatenate([axis_angle_from_matrix(cameras.R.transpose(0, 2, 1)), cameras.centres()], 1)
    with Path(path).open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for k, name in enumerate(cameras.names):
            writer.writerow([name, w[k], h[k], *map(repr, pose[k].tolist()), *map(repr, lens[k].tolist())])


def read_csv(path: Path, columns: list[str]) -> list[dict[str, str]]:
    """Rows by column name; blanks around names and values are dropped, since ActorsHQ's README prints them."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"is larger than {MAX_BYTES >> 20} MiB")
        rows = list(csv.reader(io.StringIO(path.read_text("utf-8-sig")), skipinitialspace=True, strict=True))
    except (OSError, ValueError, csv.Error) as error:
        raise BadInput([Fault(str(path), f"cannot be read ({error})", "Copy the file again.")]) from None
    head = [c.strip() for c in rows[0]] if rows else []
    if head != columns:
        raise BadInput([Fault(str(path), f"has the header {','.join(head)[:200]!r}", f"Expected {','.join(columns)}.")])
    return [dict(zip(columns, [v.strip() for v in row] + [None] * len(columns), strict=False)) for row in rows[1:] if row]


def _rig(names: tuple[str, ...], values: np.ndarray) -> Cameras:
    size, r, C, f, p = values[:, :2], values[:, 2:5], values[:, 5:8], values[:, 8:10], values[:, 10:12]
    R = matrix_from_axis_angle(r).transpose(0, 2, 1)  # the file turns camera axes into world axes
    K = np.tile(np.eye(3), (len(names), 1, 1))
    K[:, 0, 0], K[:, 1, 1] = (f * size).T
    K[:, :2, 2] = p * size
    return Cameras(names, K, R, -np.einsum("kij,kj->ki", R, C), size.astype(np.int32), np.zeros((len(names), 5)))
