"""Which part of the dressed surface is skin: one welded mesh carries the body and its garments, with a part's name for every face."""

import unicodedata

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault

SKIN = "body"  # the part that is no garment


def part_faults(part: NDArray[np.str_], where: str) -> list[Fault]:
    """A fault for every name in part [F] that no part may have."""
    remedies = {name: _remedy(name) for name in np.unique(part).tolist()}
    return [Fault(where, f"it has a part {name!r}", remedy) for name, remedy in remedies.items() if remedy]


def _remedy(name: str) -> str:
    """Of a name that is `SKIN` but for upper and lower case: it would be simulated as cloth. Of one that cannot be a file's: what is kept of
    a garment is kept by its name. "" for all others; letters are those of any script, with the marks upon them."""
    if name.lower() == SKIN != name:
        return f"Rename it to {SKIN!r}: every part of another name is taken for a garment."
    if name in ("", ".", "..") or not all(c in "_-.: " or unicodedata.category(c)[0] in "LMN" for c in name):
        return "Rename it: a name holds letters (in UTF-8), digits, spaces and _ - . : and is neither '.' nor '..'."
    return ""


def skin_vertices(faces: NDArray[np.integer], part: NDArray[np.str_], vertex_count: int) -> NDArray[np.bool_]:
    """Vertices [V] of faces [F, 3] that lie on skin and on nothing else; part [F]."""
    skin, cloth = np.zeros(vertex_count, bool), np.zeros(vertex_count, bool)
    is_skin = np.asarray(part) == SKIN
    skin[faces[is_skin]], cloth[faces[~is_skin]] = True, True
    return skin & ~cloth
