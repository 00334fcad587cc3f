"""Capture: what a recording consists of. The images stay where they are; this names them, with their SHA-256.

* World: metres, y up. `up` MUST be the axis that pointed up in the recording before it was turned, as in "y" or "-z".
* Cameras: OpenCV axes, x_cam = R x + t, `R` MUST be a rotation. `K` is in pixels with the centre of the first pixel at
  (0.5, 0.5). `distortion` is k1, k2, p1, p2, k3. `size` is width, height.
* `frame_numbers` MUST increase; readers take evenly spaced ones only. Index along `frame` elsewhere means position in this list.
* `fps` is the rate of these frames, in 1/s: of every second frame, half the rate at which the cameras ran.
* `rgb` and, where the recording has masks, `mask` give per camera a path below the recording's folder, with `/`, and with
  `{frame:06d}` where every frame is a file of its own, without where the camera has a video. Where that folder lies is
  not kept: a recording that moves keeps its artifacts.
* `sha256` MUST hold the digest of every file meant, by its path; a file that differs later is not the recording.
* `template` is the path of the surface at the first frame, if there is one; `mass_kg` the weight of the garments, if anybody weighed them.
* `warnings` are what the reader found odd and went on with.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from string import Formatter

import numpy as np

from storage_schemas.faults import Fault
from storage_schemas.fields import array, names
from storage_schemas.record import Record

ORTHONORMAL_TO = 1e-4  # calibrations are written with 5 to 6 digits


class Capture(Record, name="capture", version=1):
    """The calibrated cameras and the images of one recording."""

    K: np.ndarray = array("camera 3 3", "float64", "px")
    R: np.ndarray = array("camera 3 3", "float64", "1")
    t: np.ndarray = array("camera 3", "float64", "m")
    distortion: np.ndarray = array("camera 5", "float64", "1")
    size: np.ndarray = array("camera 2", "int32", "px")
    frame_numbers: np.ndarray = array("frame", "int32", "1")
    camera_names: tuple[str, ...] = names("camera")
    fps: float
    up: str
    rgb: tuple[str, ...]
    mask: tuple[str, ...] | None = None
    sha256: dict[str, str]
    template: str | None = None
    mass_kg: float | None = None
    warnings: tuple[str, ...] = ()

    def faults(self) -> list[Fault]:
        """Rotations, frame numbers, rates and the files' cameras and frames."""
        found = []
        tilt = np.abs(self.R @ np.swapaxes(self.R, -1, -2) - np.eye(3)).max(axis=(1, 2), initial=0)
        for camera in np.flatnonzero((tilt > ORTHONORMAL_TO) | (np.linalg.det(self.R) < 0)):
            found.append(self.fault("R", f"of camera {self.camera_names[camera]} is no rotation", "check the calibration"))
        if (np.diff(self.frame_numbers) <= 0).any():
            found.append(self.fault("frame_numbers", "do not increase", "sort them and drop doubles"))
        if self.fps <= 0:
            found.append(self.fault("fps", f"is {self.fps}", "give frames per second"))
        if self.up.removeprefix("-") not in {"x", "y", "z"}:
            found.append(self.fault("up", f"is {self.up!r}", "give x, y or z, with '-' if it points down"))
        if self.mass_kg is not None and self.mass_kg <= 0:
            found.append(self.fault("mass_kg", f"is {self.mass_kg}", "give the garments' weight, or None"))
        return found + self._file_faults()

    def _file_faults(self) -> list[Fault]:
        found = [fault for field in ("rgb", "mask") for fault in self._pattern_faults(field, getattr(self, field))]
        if found:
            return found
        missing = sorted(set(self.paths()) - self.sha256.keys())
        if missing:
            found.append(self.fault("sha256", f"lacks {len(missing)} files, the first is {missing[0]}", "give the digest of every file"))
        return found

    def _pattern_faults(self, field: str, patterns: tuple[str, ...] | None) -> list[Fault]:
        if patterns is None:
            return []
        found = []
        if len(patterns) != len(self.camera_names):
            what = f"has {len(patterns)} paths for {len(self.camera_names)} cameras"
            found.append(self.fault(field, what, "give one path per camera"))
        for pattern in patterns:
            if PurePosixPath(pattern).is_absolute() or ".." in PurePosixPath(pattern).parts:
                found.append(self.fault(field, f"{pattern!r} leaves the recording", "give a path below the recording's folder"))
            if {name for _, name, _, _ in Formatter().parse(pattern)} - {"frame", None}:
                what = f"{pattern!r} has a place for something other than the frame"
                found.append(self.fault(field, what, "write {frame} with its format and nothing else in braces"))
        return found

    def paths(self) -> list[str]:
        """Every file of the recording that is meant, each once."""
        patterns = [*self.rgb, *(self.mask or ())]
        files = {pattern.format(frame=int(number)) for pattern in patterns for number in self.frame_numbers}
        return sorted(files | ({self.template} if self.template else set()))
