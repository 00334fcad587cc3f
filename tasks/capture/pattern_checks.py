"""What can be wrong with a sewing pattern: places uv [V, 2] m of a garment's vertices in the plane.

Each face must have an area there, point the same way as the rest of its piece, and be about as large as on the body: cloth stretches by a
few per cent, so edges that differ by more than a factor of two are in another unit, or the pattern of another garment. A piece may be
mirrored as a whole.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault
from tasks.geometry.meshes import components, edges

Array = NDArray[np.float64]

SLIVER = 1e-4  # area over the square of the longest edge
FACTOR = 2.0


def pattern_faults(uv: Array, faces: NDArray[np.int64], surface: Array | None, name: str) -> list[Fault]:
    """Of faces [F, 3] and their surface [V, 3] m at rest or as worn (None where it is not known)."""
    area, longest = _signed_areas(uv, faces)
    flat, faults = np.abs(area) <= SLIVER * longest**2, []
    if flat.any():
        what = f"{flat.sum()} faces have no area in the pattern, the first is face {np.flatnonzero(flat)[0]}"
        faults.append(Fault(f"{name}: uv", what, "Lay them out, or leave uv away: the rest shape is then the surface as it is."))
    flipped = _flipped(area, faces, len(uv)) & ~flat
    if flipped.any():
        what = f"{flipped.sum()} faces are flipped against the rest of their piece, the first is face {np.flatnonzero(flipped)[0]}"
        remedy = "Unfold them; where the pattern is cut, cut the mesh too: a vertex has one place in it."
        faults.append(Fault(f"{name}: uv", what, remedy))
    if surface is not None and not faults:
        e = edges(faces)
        in_pattern, worn = (np.linalg.norm(x[e[:, 0]] - x[e[:, 1]], axis=1) for x in (uv, surface))
        ratio = float(np.median(in_pattern / worn))
        if not 1 / FACTOR <= ratio <= FACTOR:
            what = f"its edges are {ratio:.3g} times as long as those of the garment"
            faults.append(Fault(f"{name}: uv", what, "Give the pattern in metres, not in texture coordinates."))
    return faults


def _signed_areas(uv: Array, faces: NDArray[np.int64]) -> tuple[Array, Array]:
    """Signed areas [F] m² and longest edges [F] m."""
    a, b, c = (uv[faces[:, k]] for k in range(3))
    u, v = b - a, c - a
    longest = np.max([np.linalg.norm(d, axis=1) for d in (u, v, c - b)], axis=0)
    return (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2, longest


def _flipped(area: Array, faces: NDArray[np.int64], vertex_count: int) -> NDArray[np.bool_]:
    """Faces [F] that point against most of the area of their piece."""
    piece = components(faces, vertex_count)[faces[:, 0]]
    way = np.sign(np.bincount(piece, area))
    return np.sign(area) * way[piece] < 0
