"""What a pixel measures of the texture, and what it looks like.

A pixel averages 2 × 2 sub-samples; sub-sample s sees a point with irradiance A(s) (`radiosity.py`) and texels k with bilinear weights β:

    Î = ¼ Σ_s A(s) Σ_k β_k(s) ρ_k        for constant light L_a = 1

`View` holds the drawn sub-samples of one image. `shade` evaluates Î for a texture, `NormalEquations.add` accumulates MᵀM and Mᵀy of
the rows of all usable pixels. MᵀM couples texels at most `REACH` apart only, so it is kept as a half stencil and takes 540 bytes a texel
whatever the number of images. Pixels that reach further (a chart's seam, the outline of one part against another, surfaces
seen at a glance) are not used and are counted. Pixels in deep shadow are not used either.
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from tasks.appearance.atlas import texel_coordinates
from tasks.geometry.cameras import Cameras
from tasks.geometry.rasterise import rasterise

DEEP_SHADOW = 0.15  # [-] least irradiance of a sub-sample that is fitted: below, the error of A weighs more than what the pixel tells
REACH = 4  # [texel] farthest coupling: a pixel two texels wide, foreshortened to one half


@dataclass(frozen=True)
class View:
    """Sub-samples of one image, [2·height, 2·width]: face (−1 none), texel column and row, irradiance (channels last)."""

    face: NDArray[np.int32]
    texel: NDArray[np.float32]
    irradiance: NDArray[np.float32]


def draw(cameras: Cameras, camera: int, vertices: NDArray, faces: NDArray, A: NDArray, uv: NDArray, size: tuple[int, int]) -> View:
    """Sub-samples of a camera's image of (vertices [V, 3] m, faces [F, 3]) under irradiance A [node, 3].

    uv [F, 3, 2] at the corners; `size` of the texture (height, width).
    """
    K = cameras.K[camera] * np.array([[2.0], [2.0], [1.0]])
    drawn = rasterise(K, cameras.R[camera], cameras.t[camera], tuple(2 * cameras.size[camera]), vertices, faces)
    corner_nodes = faces + len(vertices) * _seen_from_behind(vertices, faces, cameras.centres()[camera])[:, None]
    texel, light = _interpolate(drawn.face, drawn.barycentric, texel_coordinates(uv, size).astype(np.float32), A[corner_nodes])
    return View(drawn.face, texel, light)


def shade(view: View, texture: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Î [height, width, 3], linear, and the share of each pixel that the mesh covers [height, width]; the background is black."""
    return _shade(view.face, view.texel, view.irradiance, np.ascontiguousarray(texture, np.float32))


def sees_only(view: View, texels: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels [height, width] covered by the mesh in full whose look-ups touch nothing but the given texels [h, w]."""
    white = View(view.face, view.texel, np.ones_like(view.irradiance))
    share, covered = shade(white, np.repeat(~texels[..., None], 3, -1).astype(np.float32))
    return (covered == 1) & (share[..., 0] == 0)


class NormalEquations:
    """MᵀM as a half stencil [h, w, REACH + 1, 2·REACH + 1, 3] (down, across + REACH), Mᵀy [h, w, 3], yᵀy; rows used and left out."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.MtM = np.zeros((*size, REACH + 1, 2 * REACH + 1, 3), np.float32)
        self.Mty = np.zeros((*size, 3), np.float32)
        self.used = self.left_out = 0

    def add(self, view: View, image: NDArray[np.float32], usable: NDArray[np.bool_]) -> None:
        """Adds the usable pixels [height, width] of an image [height, width, 3], linear."""
        used, left_out = _accumulate(view.face, view.texel, view.irradiance, image, usable, self.MtM, self.Mty)
        self.used += used
        self.left_out += left_out

    def diagonal(self) -> NDArray[np.float32]:
        """Diagonal of MᵀM [h, w, 3]: how much the images say about each texel."""
        return self.MtM[:, :, 0, REACH]

    def add_laplacian(self, chart: NDArray[np.int32], weight: float) -> None:
        """Adds weight · L, the graph Laplacian that joins neighbouring texels of the same chart [h, w] only."""
        for here, there, offset in ((np.s_[:-1], np.s_[1:], (1, REACH)), (np.s_[:, :-1], np.s_[:, 1:], (0, REACH + 1))):
            joined = weight * ((chart[here] == chart[there]) & (chart[here] >= 0))[..., None].astype(np.float32)
            self.diagonal()[here] += joined
            self.diagonal()[there] += joined
            self.MtM[here][:, :, *offset] -= joined

    def times(self, ρ: NDArray[np.float32]) -> NDArray[np.float32]:
        """(MᵀM) ρ [h, w, 3]."""
        return _stencil_times(self.MtM, np.ascontiguousarray(ρ, np.float32))


def _seen_from_behind(vertices: NDArray, faces: NDArray, centre: NDArray) -> NDArray[np.int32]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return (np.einsum("fc,fc->f", np.cross(b - a, c - a), centre - a) < 0).astype(np.int32)


@numba.njit(cache=True, nogil=True)
def _interpolate(face, barycentric, corner_texel, corner_light):
    height, width = face.shape
    texel, light = np.zeros((height, width, 2), np.float32), np.zeros((height, width, 3), np.float32)
    for i in range(height):
        for j in range(width):
            f = face[i, j]
            if f < 0:
                continue
            for k in range(3):
                b = barycentric[i, j, k]
                for c in range(2):
                    texel[i, j, c] += b * corner_texel[f, k, c]
                for c in range(3):
                    light[i, j, c] += b * corner_light[f, k, c]
    return texel, light


@numba.njit(cache=True, nogil=True)
def _bilinear(x, count):
    """First of the two texels and the weight of the second."""
    first = min(max(int(np.floor(x)), 0), count - 2)
    return first, min(max(x - first, 0.0), 1.0)


@numba.njit(cache=True, nogil=True)
def _shade(face, texel, light, texture):
    height, width = face.shape[0] // 2, face.shape[1] // 2
    image, covered = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
    for i in range(2 * height):
        for j in range(2 * width):
            if face[i, j] < 0:
                continue
            c0, fx = _bilinear(texel[i, j, 0], texture.shape[1])
            r0, fy = _bilinear(texel[i, j, 1], texture.shape[0])
            covered[i // 2, j // 2] += np.float32(0.25)
            for c in range(3):
                top = (1 - fx) * texture[r0, c0, c] + fx * texture[r0, c0 + 1, c]
                low = (1 - fx) * texture[r0 + 1, c0, c] + fx * texture[r0 + 1, c0 + 1, c]
                image[i // 2, j // 2, c] += 0.25 * light[i, j, c] * ((1 - fy) * top + fy * low)
    return image, covered


@numba.njit(cache=True, nogil=True)
def _accumulate(face, texel, light, image, usable, MtM, Mty):
    height, width, _ = image.shape
    rows, columns = Mty.shape[:2]
    block = np.zeros((REACH + 1, REACH + 1, 3))
    used, left_out = 0, 0
    for i in range(height):
        for j in range(width):
            if not usable[i, j]:
                continue
            r0, r1, c0, c1 = _footprint(face, texel, i, j, rows, columns)
            if r1 - r0 > REACH or c1 - c0 > REACH:
                left_out += 1
                continue
            if _darkest(light, i, j) < DEEP_SHADOW:
                continue
            used += 1
            block[: r1 - r0 + 1, : c1 - c0 + 1] = 0
            _fill_row(texel, light, i, j, r0, c0, rows, columns, block)
            _add_row(block, image[i, j], r0, c0, r1 - r0 + 1, c1 - c0 + 1, MtM, Mty)
    return used, left_out


@numba.njit(cache=True, nogil=True)
def _darkest(light, i, j):
    return min(light[2 * i, 2 * j].min(), light[2 * i, 2 * j + 1].min(), light[2 * i + 1, 2 * j].min(), light[2 * i + 1, 2 * j + 1].min())


@numba.njit(cache=True, nogil=True)
def _footprint(face, texel, i, j, rows, columns):
    """First and last texel row and column of a pixel; rows far beyond REACH when a sub-sample misses the mesh."""
    r0, r1, c0, c1 = rows, -1, columns, -1
    for s in range(4):
        y, x = 2 * i + s // 2, 2 * j + s % 2
        if face[y, x] < 0:
            return 0, 2 * REACH, 0, 0
        c, _ = _bilinear(texel[y, x, 0], columns)
        r, _ = _bilinear(texel[y, x, 1], rows)
        r0, r1, c0, c1 = min(r0, r), max(r1, r + 1), min(c0, c), max(c1, c + 1)
    return r0, r1, c0, c1


@numba.njit(cache=True, nogil=True)
def _fill_row(texel, light, i, j, r0, c0, rows, columns, block):
    """The row of M for pixel (i, j), as a block of texels from (r0, c0)."""
    for s in range(4):
        y, x = 2 * i + s // 2, 2 * j + s % 2
        c, fx = _bilinear(texel[y, x, 0], columns)
        r, fy = _bilinear(texel[y, x, 1], rows)
        for k in range(3):
            a = 0.25 * light[y, x, k]
            block[r - r0, c - c0, k] += a * (1 - fy) * (1 - fx)
            block[r - r0, c - c0 + 1, k] += a * (1 - fy) * fx
            block[r - r0 + 1, c - c0, k] += a * fy * (1 - fx)
            block[r - r0 + 1, c - c0 + 1, k] += a * fy * fx


@numba.njit(cache=True, nogil=True)
def _add_row(block, y, r0, c0, height, width, MtM, Mty):
    for p in range(height * width):
        pr, pc = p // width, p % width
        if block[pr, pc, 0] == 0 and block[pr, pc, 1] == 0 and block[pr, pc, 2] == 0:
            continue
        for k in range(3):
            Mty[r0 + pr, c0 + pc, k] += block[pr, pc, k] * y[k]
        for q in range(p, height * width):
            qr, qc = q // width, q % width
            for k in range(3):
                MtM[r0 + pr, c0 + pc, qr - pr, qc - pc + REACH, k] += block[pr, pc, k] * block[qr, qc, k]


@numba.njit(cache=True, nogil=True)
def _stencil_times(MtM, ρ):
    rows, columns, _ = ρ.shape
    out = np.zeros_like(ρ)
    for i in range(rows):
        for j in range(columns):
            if MtM[i, j, 0, REACH, 0] == 0 and MtM[i, j, 0, REACH, 1] == 0 and MtM[i, j, 0, REACH, 2] == 0:
                continue
            for k in range(3):
                out[i, j, k] += MtM[i, j, 0, REACH, k] * ρ[i, j, k]
            for down in range(min(REACH + 1, rows - i)):
                for across in range(-min(REACH, j) if down else 1, min(REACH + 1, columns - j)):
                    for k in range(3):
                        m = MtM[i, j, down, across + REACH, k]
                        out[i, j, k] += m * ρ[i + down, j + across, k]
                        out[i + down, j + across, k] += m * ρ[i, j, k]
    return out
