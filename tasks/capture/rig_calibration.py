"""What a calibration of the rig returns, and how its free world is fixed: scale, vertical, origin.

Pictures alone fix a rig up to a similarity. The scale comes from one distance the user knows; the vertical from a board on the floor or,
without one, from the mean of the cameras' own up directions, which is right to the extent that nobody rolled them and their tilts cancel
(a ring).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import Fault, refuse
from tasks.geometry.rotations import rotation_between

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigCalibration:
    """The rig in metres, y up; `residual_px` [camera] rms reprojection error and `observations` [camera] the number of points behind it."""

    cameras: Cameras
    residual_px: Array
    observations: NDArray[np.int64]


def moved(cameras: Cameras, R: Array, t: Array, *, scale: float = 1.0) -> Cameras:
    """The same rig in the world x' = scale (R x + t): R_cam' = R_cam Rᵀ, t_cam' = scale (t_cam − R_cam Rᵀ t)."""
    turned = cameras.R @ R.T
    return replace(cameras, R=turned, t=scale * (cameras.t - turned @ t))


def levelled(cameras: Cameras) -> Cameras:
    """The rig with the mean of the cameras' up directions as y and the point nearest to all optical axes as origin."""
    up = -cameras.R[:, 1].mean(axis=0)
    axes, C = cameras.R[:, 2], cameras.centres()
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # projects onto the plane across each optical axis
    focus = np.linalg.lstsq(across.sum(0), np.einsum("kij,kj->i", across, C), rcond=None)[0]
    R = rotation_between(up, np.array([0.0, 1, 0]))
    return moved(cameras, R, -R @ focus)


def baseline_faults(baseline: tuple[str, str, float], names: Sequence[str]) -> list[Fault]:
    """What is wrong with two cameras and the metres between them, where these are the cameras."""
    a, b, metres = baseline
    remedy = f"Name two of {', '.join(names)} and the distance of their lenses in metres, 0.01 to 100."
    faults = [Fault("baseline", f"there is no camera {n!r}", remedy) for n in dict.fromkeys((a, b)) if n not in names]
    if a == b or not 0.01 < metres < 100:
        faults.append(Fault("baseline", f"is {baseline}", remedy))
    return faults


def scaled_to(cameras: Cameras, baseline: tuple[str, str, float]) -> Cameras:
    """The rig scaled so that the centres of two named cameras lie the given number of metres apart. Raises BadInput."""
    refuse(baseline_faults(baseline, cameras.names))
    a, b, metres = baseline
    C = cameras.centres()
    return moved(cameras, np.eye(3), np.zeros(3), scale=metres / np.linalg.norm(C[cameras.names.index(a)] - C[cameras.names.index(b)]))
