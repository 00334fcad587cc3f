"""One picture or mask from disk, decoded defensively.

JPEG and PNG only, read with Pillow: OpenCV's decoder returns a JPEG that was cut short as a picture padded with grey and turns pictures by
their EXIF flag, both in silence. `picture_fault` looks at the header, the size and the end of a file (a few hundred bytes) and decodes only
where these leave doubt; `deep` decodes every pixel, and tells masks that are stored otherwise than 0 to 255 in channel 0. Damage inside a
complete JPEG stays invisible to any decoder.
"""

import struct
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tasks.geometry.faults import BadInput, Fault

MAX_BYTES = 256 << 20
MAX_PIXELS = 80_000_000  # six times ActorsHQ's 12 MP, and below the size at which Pillow warns of a decompression bomb
MASK_THRESHOLD = 127  # a mask's channel 0 is coverage × 255
MASK_MODES = ("L", "1", "RGB", "RGBA")
MASK_REMEDY = "Store masks of one channel: 255 on the actor, 0 elsewhere."
EMPTY_MASK_PIXELS_PER_BYTE = 300  # an all-black PNG packs about 1000 pixels into a byte, a silhouette at most about 200


class PictureHeader(NamedTuple):
    """What the first bytes say: width, height [px] and "JPEG" or "PNG"."""

    width: int
    height: int
    kind: str


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """The picture [height, width, 3], RGB, as stored (no EXIF turn). Raises BadInput."""
    return np.asarray(_decode(path, ("RGB", "L", "RGBA")).convert("RGB"))


def read_mask(path: Path) -> NDArray[np.bool_]:
    """The mask [height, width]: true where channel 0 exceeds half. Raises BadInput."""
    return _coverage(_decode(path, MASK_MODES)) > MASK_THRESHOLD


def read_header(path: Path) -> PictureHeader:
    """Size and kind from the header alone. Raises BadInput."""
    try:
        with path.open("rb") as file:
            header = _header(file)
    except (OSError, ValueError, struct.error) as error:
        raise BadInput([_fault(path, f"is no readable JPEG or PNG ({error})")]) from None
    if not 0 < header.width * header.height <= MAX_PIXELS:
        raise BadInput([_fault(path, f"claims {header.width} x {header.height} pixels; at most {MAX_PIXELS} are read")])
    return header


def picture_fault(path: Path, size: tuple[int, int], *, mask: bool = False, deep: bool = False) -> Fault | None:
    """The first thing wrong with a file that should hold `size` (width, height) pixels, or None."""
    try:
        header = read_header(path)
        if (header.width, header.height) != tuple(size):
            found, expected = f"{header.width} x {header.height}", f"{size[0]} x {size[1]}"
            return Fault(
                str(path), f"is {found} pixels where the calibration says {expected}", "Use the pictures and the calibration of one scale."
            )
        if deep or not _ends_well(path, header.kind) or (mask and _looks_empty(path, size)):
            if mask:
                return _mask_fault(path)
            read_rgb(path)
    except BadInput as bad:
        return bad.faults[0]
    return None


def _coverage(picture: Image.Image) -> NDArray[np.uint8]:
    """Channel 0 of a mask [height, width], 0 to 255."""
    return np.asarray(picture.convert("L") if picture.mode == "1" else picture.getchannel(0))


def _mask_fault(path: Path) -> Fault | None:
    """Why no actor can be seen in a mask: alpha alone tells one, numbers that are not 0 to 255, or nobody. Raises BadInput."""
    picture = _decode(path, MASK_MODES)
    coverage = _coverage(picture)
    actor = coverage > MASK_THRESHOLD
    if picture.mode == "RGBA" and actor.all() == actor.any() and np.ptp(picture.getchannel("A")):
        return Fault(str(path), "is a mask with its silhouette in the alpha channel alone, where channel 0 is read", MASK_REMEDY)
    if actor.any():
        return None
    if coverage.any():
        what = f"is a mask with {coverage.max()} as the largest value in channel 0; masks are 0 to 255, above {MASK_THRESHOLD} is the actor"
        return Fault(str(path), what, MASK_REMEDY)
    return Fault(str(path), "is an empty mask", "Segment the frame again, or leave the frame or the camera out.")


def _decode(path: Path, modes: tuple[str, ...]) -> Image.Image:
    read_header(path)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
            if len(content) > MAX_BYTES:
                raise ValueError(f"larger than {MAX_BYTES >> 20} MiB")
            file.seek(0)
            picture = Image.open(file, formats=("JPEG", "PNG"))
            picture.load()
    except Exception as error:  # noqa: BLE001  decoders raise whatever a hostile file makes them
        raise BadInput([_fault(path, f"cannot be decoded ({error})")]) from None
    if picture.mode not in modes:
        raise BadInput([_fault(path, f"has pixel type {picture.mode}, expected one of {', '.join(modes)}")])
    return picture


def _fault(path: Path, what: str) -> Fault:
    return Fault(str(path), what, "Export the frame again as 8-bit JPEG or PNG.")


def _header(file: BinaryIO) -> PictureHeader:
    start = file.read(26)
    if start[:8] == b"\x89PNG\r\n\x1a\n" and start[12:16] == b"IHDR":
        return PictureHeader(*struct.unpack(">II", start[16:24]), "PNG")
    if start[:2] == b"\xff\xd8":
        return _jpeg_header(file)
    raise ValueError("neither signature is there")


def _jpeg_header(file: BinaryIO) -> PictureHeader:
    """Walks the segments to the start-of-frame marker (ITU-T T.81, B.2.2)."""
    file.seek(2)
    for _ in range(1000):
        mark, code = struct.unpack(">BB", file.read(2))
        if mark != 0xFF:
            raise ValueError("a JPEG segment does not begin with 0xFF")
        if code == 0xFF:  # fill byte
            file.seek(-1, 1)
            continue
        (length,) = struct.unpack(">H", file.read(2))
        if 0xC0 <= code <= 0xCF and code not in (0xC4, 0xC8, 0xCC):
            _, height, width = struct.unpack(">BHH", file.read(5))
            return PictureHeader(width, height, "JPEG")
        if code == 0xDA or length < 2:
            break
        file.seek(length - 2, 1)
    raise ValueError("the JPEG has no frame header")


def _ends_well(path: Path, kind: str) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 64))
        tail = file.read().rstrip(b"\0\r\n ")
    return tail.endswith(b"\xff\xd9") if kind == "JPEG" else b"IEND" in tail[-8:]


def _looks_empty(path: Path, size: tuple[int, int]) -> bool:
    return path.stat().st_size < 1024 + size[0] * size[1] / EMPTY_MASK_PIXELS_PER_BYTE
