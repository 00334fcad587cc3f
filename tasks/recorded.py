"""A recording as the later stages meet it: the cameras of the capture artifact and its pictures, each checked against its digest."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage_schemas.capture import Capture
from storage_schemas.tree import sha256_of
from tasks.capture.recording import Recording
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault


def cameras_of(capture: Capture) -> Cameras:
    """The rig of a capture artifact."""
    return Cameras(tuple(capture.camera_names), capture.K, capture.R, capture.t, capture.size, capture.distortion)


def recorded(capture: Capture, root: Path) -> Recording:
    """The recording below `root`; raises BadInput, when a picture is read, if it is not the one that was captured."""
    return _Checked(
        root=root,
        cameras=cameras_of(capture),
        frames=capture.frame_numbers.astype(np.int64),
        fps=capture.fps,
        up=capture.up,
        rgb=tuple(capture.rgb),
        mask=None if capture.mask is None else tuple(capture.mask),
        template=None if capture.template is None else _same(root, capture.template, capture.sha256),
        mass_kg=capture.mass_kg,
        _sha256=dict(capture.sha256),
    )


class _Checked(Recording):
    def __init__(self, *, _sha256: dict[str, str], **fields: object) -> None:
        super().__init__(**fields)
        object.__setattr__(self, "_sha256", _sha256)
        object.__setattr__(self, "_known", set())

    def read_rgb(self, camera_index: int, frame_index: int) -> NDArray[np.uint8]:
        return self._after_check("rgb", camera_index, frame_index, super().read_rgb)

    def read_mask(self, camera_index: int, frame_index: int) -> NDArray[np.bool_]:
        return self._after_check("mask", camera_index, frame_index, super().read_mask)

    def _after_check(self, kind: str, camera: int, frame: int, read: Callable) -> NDArray:
        if getattr(self, kind) is not None:
            file, _ = self.path(camera, frame, kind=kind)
            if file not in self._known:
                _same(self.root, file, self._sha256)
                self._known.add(file)
        return read(camera, frame)


def _same(root: Path, file: str, sha256: dict[str, str]) -> Path:
    path = root / file
    try:
        found = sha256_of(path)
    except OSError as error:
        raise BadInput(
            [Fault(str(path), f"it cannot be read ({error.strerror})", "Restore the recording, or point `data` at it.")]
        ) from None
    if found != sha256[file]:
        raise BadInput(
            [Fault(str(path), "it has changed since the recording was captured", "Submit again: the new recording gets new artifacts.")]
        )
    return path
