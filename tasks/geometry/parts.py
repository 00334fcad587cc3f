"""Which part of the dressed surface is skin: one welded mesh carries the body and its garments, with a part's name for every face."""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault

SKIN = "body"  # the part that is no garment


def part_faults(part: NDArray[np.str_], where: str) -> list[Fault]:
    """A fault for every name in part [F] that is `SKIN` but for upper and lower case: it would be simulated as cloth."""
    remedy = f"Rename it to {SKIN!r}: every part of another name is taken for a garment."
    return [Fault(where, f"it has a part {name!r}", remedy) for name in np.unique(part).tolist() if name.lower() == SKIN != name]


def skin_vertices(faces: NDArray[np.integer], part: NDArray[np.str_], vertex_count: int) -> NDArray[np.bool_]:
    """Vertices [V] of faces [F, 3] that lie on skin and on nothing else; part [F]."""
    skin, cloth = np.zeros(vertex_count, bool), np.zeros(vertex_count, bool)
    is_skin = np.asarray(part) == SKIN
    skin[faces[is_skin]], cloth[faces[~is_skin]] = True, True
    return skin & ~cloth
