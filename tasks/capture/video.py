"""Frames of one video file by number.

FFmpeg through OpenCV. Reading on is one `grab` per frame; going back, or far ahead, seeks, and starts again from the first frame when the
seek did not land. Only mp4/mov, Matroska/WebM and AVI are opened: FFmpeg would follow the network addresses inside a playlist that merely
calls itself .mp4.
"""

import threading
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import BadInput, Fault

MAX_PIXELS = 80_000_000
FAR = 64  # frames ahead beyond which a seek is cheaper than decoding on


class Video:
    """An open video: `size` (width, height) px, `fps`, `frame_count` as the container states it, `read(number)`. Raises BadInput."""

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._lock = threading.Lock()
        self._open()
        self.size = tuple(int(self._capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        self.fps = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.frame_count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if not (0 < self.size[0] * self.size[1] <= MAX_PIXELS and 0 < self.frame_count < 10_000_000 and 0 < self.fps < 10_000):
            raise self._bad(f"states {self.size[0]} x {self.size[1]} pixels, {self.frame_count} frames, {self.fps:.4g} frames per second")

    def read(self, number: int) -> NDArray[np.uint8]:
        """Frame `number` (0-based), RGB [height, width, 3]. Raises BadInput where it cannot be decoded."""
        with self._lock:
            if not self._next <= number <= self._next + FAR:
                self._seek(number)
            while self._next <= number:
                if not self._capture.grab():
                    raise self._bad(f"frame {number} cannot be decoded (it ends after {self._next} frames)")
                self._next += 1
            ok, picture = self._capture.retrieve()
        if not ok:
            raise self._bad(f"frame {number} cannot be decoded")
        return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)

    def __reduce__(self) -> tuple:
        return (Video, (self.path,))

    def _open(self) -> None:
        try:
            with self.path.open("rb") as file:
                start = file.read(12)
        except OSError as error:
            raise self._bad(f"cannot be opened ({error.strerror})") from None
        if not (start[4:8] == b"ftyp" or start[:4] == b"\x1aE\xdf\xa3" or (start[:4] == b"RIFF" and start[8:] == b"AVI ")):
            raise self._bad("is no mp4, Matroska or AVI file")
        self._capture = cv2.VideoCapture(str(self.path.absolute()), cv2.CAP_FFMPEG)
        self._next = 0
        if not self._capture.isOpened():
            raise self._bad("cannot be opened as a video")

    def _seek(self, number: int) -> None:
        self._capture.set(cv2.CAP_PROP_POS_FRAMES, number)
        if int(self._capture.get(cv2.CAP_PROP_POS_FRAMES)) == number:
            self._next = number
        else:
            self._capture.release()
            self._open()

    def _bad(self, what: str) -> BadInput:
        return BadInput([Fault(str(self.path), what, "Export the video again, for example `ffmpeg -i IN -c:v libx264 -crf 12 OUT.mp4`.")])
