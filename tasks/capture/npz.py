"""Arrays of an NPZ file, read without trusting it.

No pickles; every member's header is compared with the bytes that the archive holds for it before anything is allocated, so a file that
promises a petabyte is refused, not attempted. Only numbers, booleans and strings.
"""

import zipfile
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from tasks.geometry.faults import BadInput, Fault

MAX_MEMBERS = 64
MAX_BYTES = 8 << 30  # of all arrays together, unpacked


def read_npz(path: Path) -> dict[str, np.ndarray]:
    """Every array of the file by name. Raises BadInput with a fault per unreadable member."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            total = sum(m.file_size for m in members)
            if len(members) > MAX_MEMBERS or total > MAX_BYTES or len({m.filename for m in members}) < len(members):
                raise ValueError(f"{len(members)} members of {total} bytes, or two of one name")
            arrays, faults = {}, []
            for member in members:
                try:
                    arrays[member.filename.removesuffix(".npy")] = _read_member(archive, member)
                except Exception as error:  # noqa: BLE001  numpy's header parser raises whatever a hostile header makes it
                    faults.append(_fault(path, f"{member.filename!r} cannot be read ({error})"))
    except (OSError, ValueError, RuntimeError, NotImplementedError, zipfile.BadZipFile) as error:
        raise BadInput([_fault(path, f"is no readable NPZ ({error})")]) from None
    if faults:
        raise BadInput(faults)
    return arrays


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    if not member.filename.endswith(".npy"):
        raise ValueError("is no .npy")
    with archive.open(member) as file:
        version = npy.read_magic(file)
        if version not in ((1, 0), (2, 0)):
            raise ValueError(f"has version {version}")
        shape, fortran, dtype = (npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0)(file)
        if dtype.kind not in "biufSU":
            raise ValueError(f"has type {dtype}; numbers, booleans and strings are read")
        count = int(np.prod([int(n) for n in shape], dtype=object)) if shape else 1
        if min(shape, default=0) < 0 or count * dtype.itemsize != member.file_size - file.tell():
            raise ValueError(f"promises {shape} of {dtype} but holds {member.file_size - file.tell()} bytes")
        content = file.read()
    flat = np.frombuffer(content, dtype, count)
    return flat.reshape(shape, order="F" if fortran else "C")


def _fault(path: Path, what: str) -> Fault:
    return Fault(str(path), what, "Write the file again with numpy.savez_compressed, without objects.")
