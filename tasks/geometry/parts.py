"""Which part of the dressed surface is skin: one welded mesh carries the body and its garments, with a part's name for every face."""

import numpy as np
from numpy.typing import NDArray

SKIN = "body"  # the part that is no garment


def skin_vertices(faces: NDArray[np.integer], part: NDArray[np.str_], vertex_count: int) -> NDArray[np.bool_]:
    """Vertices [V] of faces [F, 3] that lie on skin and on nothing else; part [F]."""
    skin, cloth = np.zeros(vertex_count, bool), np.zeros(vertex_count, bool)
    is_skin = np.asarray(part) == SKIN
    skin[faces[is_skin]], cloth[faces[~is_skin]] = True, True
    return skin & ~cloth
