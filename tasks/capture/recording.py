"""What every reader of recordings returns: cameras, frames, and where each picture lies.

World y up: readers that meet another vertical turn the cameras, and `up` keeps the axis of the files so that geometry stored beside them
can be turned alike (`Y_UP`, `read_template`). Pictures stay on disk; `read_rgb` and `read_mask` fetch one at a time. A camera's pictures
are a file per frame, whose name holds the frame number, or one video.
"""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.capture import images
from tasks.capture.template import Template, read_template
from tasks.capture.video import Video
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault, refuse

Y_UP = {  # rotations that take the files' vertical to y
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}


@dataclass(frozen=True)
class Recording:
    """One sequence. `frames` [frame] are the numbers in the files, evenly spaced, and `fps` [1/s] is the rate of just these frames;
    `rgb` and `mask` hold per camera a path relative to `root`, with `{frame:06d}` for a file per frame and without for a video; `mask` is
    None where nobody segmented the recording."""

    root: Path
    cameras: Cameras
    frames: NDArray[np.int64]
    fps: float
    up: str
    rgb: tuple[str, ...]
    mask: tuple[str, ...] | None = None
    template: Path | None = None
    mass_kg: float | None = None
    warnings: tuple[str, ...] = ()
    _videos: dict[str, Video] = field(default_factory=dict, repr=False, compare=False)

    def path(self, camera_index: int, frame_index: int, *, kind: str = "rgb") -> tuple[str, int | None]:
        """The file relative to root and, for a video, the number of the frame within it; `kind` is "rgb" or "mask"."""
        pattern, frame = getattr(self, kind)[camera_index], int(self.frames[frame_index])
        return (pattern.format(frame=frame), None) if "{frame" in pattern else (pattern, frame)

    def read_rgb(self, camera_index: int, frame_index: int) -> NDArray[np.uint8]:
        """The picture [height, width, 3], RGB. Raises BadInput."""
        file, number = self.path(camera_index, frame_index)
        if number is None:
            return images.read_rgb(self.root / file)
        if file not in self._videos:
            self._videos[file] = Video(self.root / file)
        return self._videos[file].read(number)

    def read_mask(self, camera_index: int, frame_index: int) -> NDArray[np.bool_]:
        """The mask of the actor [height, width]. Raises BadInput, also where the recording has no masks."""
        if self.mask is None:
            raise BadInput(
                [Fault(str(self.root), "the recording has no masks", "Segment the actor and store masks, or use a stage without masks.")]
            )
        return images.read_mask(self.root / self.path(camera_index, frame_index, kind="mask")[0])

    def read_template(self) -> Template:
        """The surface of the actor at the first frame, turned to y up. Raises BadInput, also where there is none."""
        if self.template is None:
            raise BadInput(
                [Fault(str(self.root), "the recording has no template", "Store the first frame's surface as template/template.obj.")]
            )
        template = read_template(self.template)
        return replace(template, vertices=template.vertices @ Y_UP[self.up].T)


def to_y_up(cameras: Cameras, up: str) -> Cameras:
    """The same rig in a world turned so that `up` ("y" or "z") becomes y: x_cam = R x + t = (R Qᵀ)(Q x) + t."""
    return replace(cameras, R=cameras.R @ Y_UP[up].T)


def up_faults(up: object, where: str) -> list[Fault]:
    """A fault unless `up` names a vertical that is understood."""
    return [] if up in ("y", "z") else [Fault(where, f"up is {up!r}", 'The vertical axis is "y" or "z".')]


def camera_faults(cameras: Cameras, where: str) -> list[Fault]:
    """Not a rotation, not finite, an impossible lens or an absurd unit; every camera is looked at."""
    faults = []
    for k, name in enumerate(cameras.names):
        numbers = np.concatenate([np.ravel(a[k]) for a in (cameras.K, cameras.R, cameras.t, cameras.distortion)])
        if not np.isfinite(numbers).all():
            faults.append(Fault(where, f"{name} has values that are not finite", "Calibrate the camera again or leave it out."))
            continue
        faults += _lens_faults(cameras, k, where)
        bend = np.abs(cameras.R[k] @ cameras.R[k].T - np.eye(3)).max()
        if bend > 1e-3 or np.linalg.det(cameras.R[k]) < 0:
            faults.append(Fault(where, f"{name}: R is no rotation (|RRᵀ - 1| = {bend:.2g})", "Give a rotation matrix with determinant +1."))
    return faults or _unit_faults(cameras, where)


def nearest_rotations(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """U Vᵀ of R = U Σ Vᵀ, the rotations nearest to R [camera, 3, 3] that `camera_faults` has passed (det R > 0), in the Frobenius norm:
    calibrations are written with 4 to 6 digits. Source: Higham 1986, Computing the polar decomposition, SIAM J. Sci. Stat. Comput. 7."""
    U, _, Vt = np.linalg.svd(R)
    return U @ Vt


def validate_name(name: str, where: str) -> str:
    """`name` if it can stand as one folder of a path, such as an actor's or a camera's. Raises BadInput."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.\-]{0,63}", name):
        remedy = "Names hold letters, digits, dot, dash and underscore, and begin with a letter or digit."
        refuse([Fault(where, f"{name!r} is no name", remedy)])
    return name


def _lens_faults(cameras: Cameras, k: int, where: str) -> list[Fault]:
    (w, h), K, name = cameras.size[k], cameras.K[k], cameras.names[k]
    faults = []
    if not (0 < w <= 20_000 and 0 < h <= 20_000):
        faults.append(Fault(where, f"{name} has {w} x {h} pixels", "Give its picture size in pixels."))
    elif not (0.1 < K[0, 0] / w < 100 and 0.1 < K[1, 1] / h < 100):
        faults.append(
            Fault(where, f"{name} has focal lengths {K[0, 0]:.4g}, {K[1, 1]:.4g} px for {w} x {h} pixels", "Check the unit of the lens.")
        )
    elif not (-1 < K[0, 2] / w < 2 and -1 < K[1, 2] / h < 2):
        faults.append(Fault(where, f"{name} has its principal point at {K[0, 2]:.4g}, {K[1, 2]:.4g} px", "Check the unit of the lens."))
    return faults


def _unit_faults(cameras: Cameras, where: str) -> list[Fault]:
    if len(cameras) < 2:
        return []
    C = cameras.centres()
    radius = float(np.median(np.linalg.norm(C - C.mean(0), axis=1)))
    if 0.2 < radius < 50:
        return []
    return [Fault(where, f"the cameras stand {radius:.4g} m from their middle", "Positions must be in metres; rescale the calibration.")]
