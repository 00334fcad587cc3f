"""Painted surfaces: woven cloth with a print, and the colours of the actor's skin, hair and face.

Cloth is a plain weave (two crossing threads per `THREAD`, each yarn of slightly different dye), a print of motifs scattered over a
regular grid, and slow variation from washing and wear. Pixels of a pattern run in metres, so threads keep their size on every panel.
All colours are linear albedos between 0.02 and 0.9.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

THREAD = 0.004  # [m] coarse yarns: finer ones would be below a pixel of every camera
DARKEST, BRIGHTEST = 0.02, 0.9


@dataclass(frozen=True)
class Design:
    """Linear colours [3] of the ground and of the prints, size [m] and spacing [m] of the motifs, contrast of the yarns."""

    ground: tuple[float, float, float]
    prints: tuple[tuple[float, float, float], ...]
    motif: float
    spacing: float
    yarn_contrast: float = 0.18


SKIRT = Design((0.055, 0.09, 0.24), ((0.75, 0.55, 0.18), (0.62, 0.68, 0.72), (0.52, 0.13, 0.12)), motif=0.020, spacing=0.062)
TOP = Design((0.62, 0.56, 0.44), ((0.45, 0.06, 0.08), (0.08, 0.24, 0.20), (0.12, 0.12, 0.20)), motif=0.014, spacing=0.044)


def woven(extent: Array, design: Design, *, width: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Texture [height, width, 3] of a pattern of `extent` = (u, v) m; row 0 is the top (largest v)."""
    step = extent[0] / width
    height = round(extent[1] / step)
    u, v = (np.arange(width) + 0.5) * step, (height - np.arange(height) - 0.5) * step
    colour = np.broadcast_to(np.array(design.ground), (height, width, 3)).copy()
    for centre, size, tint, petals, turn in _motifs(extent, design, rng):
        _stamp(colour, u, v, centre, size, tint, petals, turn)
    weave = _weave(u, v, rng)
    wear = noise((height, width), 0.12 / step, rng) * 0.08 + noise((height, width), 0.02 / step, rng) * 0.07
    return np.clip(colour * (1 + design.yarn_contrast * weave + wear)[..., None], DARKEST, BRIGHTEST).astype(np.float32)


def noise(shape: tuple[int, ...], scale: float, rng: np.random.Generator) -> Array:
    """Smooth noise of unit variance and correlation length `scale` px."""
    from scipy.ndimage import gaussian_filter, zoom

    shrink = max(1.0, scale / 3)
    coarse = gaussian_filter(rng.standard_normal([int(np.ceil(n / shrink)) + 8 for n in shape]), scale / shrink)
    fine = zoom(coarse, shrink, order=1)[tuple(slice(0, n) for n in shape)]
    return fine / fine.std()


def _motifs(extent: Array, design: Design, rng: np.random.Generator) -> list[tuple[Array, float, Array, int, float]]:
    grid = np.stack(
        np.meshgrid(np.arange(0, extent[0] + design.spacing, design.spacing), np.arange(0, extent[1] + design.spacing, design.spacing)), -1
    )
    grid[1::2, :, 0] += design.spacing / 2
    centres = grid.reshape(-1, 2) + rng.uniform(-0.2, 0.2, (grid.size // 2, 2)) * design.spacing
    tints = np.array(design.prints)[rng.integers(len(design.prints), size=len(centres))]
    return [
        (c, design.motif * rng.uniform(0.7, 1.2), t, int(rng.integers(3, 7)), rng.uniform(0, 2 * np.pi)) for c, t in zip(centres, tints)
    ]


def _stamp(colour: Array, u: Array, v: Array, centre: Array, size: float, tint: Array, petals: int, turn: float) -> None:
    """A flower r ≤ size (0.72 + 0.28 cos(petals θ)) with an open eye."""
    columns = slice(*np.searchsorted(u, [centre[0] - size, centre[0] + size]))
    rows = slice(*(len(v) - np.searchsorted(v[::-1], [centre[1] + size, centre[1] - size])))
    du, dv = np.meshgrid(u[columns] - centre[0], v[rows] - centre[1])
    r = np.hypot(du, dv) / size
    petal = (r < 0.72 + 0.28 * np.cos(petals * np.arctan2(dv, du) + turn)) & (r > 0.18)
    colour[rows, columns][petal] = tint


def _weave(u: Array, v: Array, rng: np.random.Generator) -> Array:
    """Height of the upper thread of a plain weave, times the dye of each yarn."""
    warp, weft = (rng.normal(0, 0.5, int(x.max() / THREAD) + 2) for x in (u, v))
    i, j = (u / THREAD).astype(int), (v / THREAD).astype(int)
    over = (i[None] + j[:, None]) % 2 == 0
    ridge_u, ridge_v = np.sin(np.pi * u / THREAD)[None] ** 2, np.sin(np.pi * v / THREAD)[:, None] ** 2
    return np.where(over, ridge_u + warp[i][None], ridge_v + weft[j][:, None]) - 0.5
