"""What the driven nodes really did: a tracked boundary without the tracker's noise.

Driven nodes are stiff: a millimetre of noise at 30 frames per second is an acceleration of several metres per second squared that the cloth
must follow, and strain on the edges between them. On a skirt of 650 vertices 1 mm of noise at the waist moved the rest by 10–25 mm within
eight frames.

A border moves almost rigidly with the body. Its motion is split into the rigid motion of all nodes (Kabsch 1976, averaged over them), the
mean shape, and what remains, of which only the principal components are kept that noise alone would not make: white noise σ on a T × 3B
matrix has no singular value above about σ(√T + √(3B)) (Geman 1980).

What is left of the noise after that still makes cloth look stiff: on a skirt of 392 vertices in its true fabric 0.36 mm at the waist asked
for 0.4 more of log κ_b. Two parts of it can be told from motion. The mean shape errs by σ/√T in all frames alike, as wrinkles of the waist.
Where a rest shape is known, it is drawn there: of the difference d the share max(0, 1 − σ²/(T mean d²)) is kept that noise does not make (a
rest shape that is itself one noisy frame differs by all of σ, and changes nothing). Poses err by the noise of the mean over the nodes,
σ√(2/B) per coordinate, by other noise in every frame: cloth is shaken. So the rigid motion is smoothed in time as far as it is smooth,

    x̂ = (1 + λ D₃ᵀD₃)⁻¹ x,     D₃: third differences,     λ: least |x − x̂|²/tr(1 − (1 + λ D₃ᵀD₃)⁻¹)²

and by no more than that noise. A polynomial through five frames would smooth all motions alike: at 25 frames per second it loses 0.5 mm of
a ring that turns by 40 degrees at 1.3 Hz.

Source: James & Stein 1961 (the share); Whittaker 1923; Craven & Wahba 1979 (generalised cross-validation). Limits: what a single node does
beyond that is lost; one λ serves all frames, so that a jolt keeps the noise of the whole recording.

Where a frame as tracked is the rest shape, its noise is part of that shape: the border keeps it (`WornRest`), or it would be strained for
ever.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDS = 3  # of alignment to a mean shape that the alignment itself improves
FEWEST = 4  # fewer nodes, or frames, have nothing worth averaging
SMOOTHNESS = 10.0 ** np.arange(-4, 4.1, 0.25)  # candidates for λ
STRAIGHT = 1e-3  # of a border's size, squared: across a straighter one noise says how it is turned, and it is held not to be


@dataclass(frozen=True)
class WornRest:
    """Driven nodes in the frame that is the rest shape: as tracked, `rest` [B, 3] m, and as they really were, `quiet` [B, 3] m."""

    rest: Array
    quiet: Array

    def kept(self, driven: Array) -> Array:
        """A quieted motion [T, B, 3] m with the noise of the rest shape, which turns with the border."""
        if not len(self.rest):
            return driven
        shape = self.quiet - self.quiet.mean(0)
        H = np.einsum("bi,tbj->tij", shape, driven - driven.mean(1, keepdims=True))
        R = _rotations(H + STRAIGHT * np.sum(shape**2) * np.eye(3))
        return driven + np.einsum("tij,bj->tbi", R, self.rest - self.quiet)


def quieted(x: Array, noise: float, rest: Array | None = None) -> Array:
    """The motion [T, B, 3] m of driven nodes from what was tracked of them, with white noise of `noise` [m] per coordinate; `rest` [B, 3]
    m: where they lie in the rest shape.
    """
    T, B, _ = x.shape
    if not noise or min(B, T) < FEWEST:
        return x
    shape = x[0] - x[0].mean(0)
    for _ in range(ROUNDS):
        centre, R = _poses(x, shape)
        local = np.einsum("tji,tbj->tbi", R, x - centre[:, None])
        shape = local.mean(0)
    U, s, W = np.linalg.svd((local - shape).reshape(T, 3 * B), full_matrices=False)
    real = s > noise * (np.sqrt(T) + np.sqrt(3 * B))
    if rest is not None:
        shape = _drawn_to(rest, shape, noise**2 / T)
    kept = shape + ((U[:, real] * s[real]) @ W[real]).reshape(T, B, 3)
    rigid = centre[:, None] + np.einsum("tij,bj->tbi", R, shape)
    centre, R = _poses(_smoothed(rigid, noise * np.sqrt(2 / B)), shape)
    return centre[:, None] + np.einsum("tij,tbj->tbi", R, kept)


def _poses(x: Array, shape: Array) -> tuple[Array, Array]:
    """Centres [T, 3] and rotations [T, 3, 3] that carry the shape [B, 3] onto x [T, B, 3] with the least squares."""
    centre = x.mean(1)
    return centre, _rotations(np.einsum("bi,tbj->tij", shape - shape.mean(0), x - centre[:, None]))


def _rotations(H: Array) -> Array:
    """The rotations R [T, 3, 3] of greatest tr(R H) for H [T, 3, 3]."""
    U, _, Wt = np.linalg.svd(H)
    flip = np.linalg.det(U @ Wt)
    U[:, :, 2] *= flip[:, None]
    return np.swapaxes(U @ Wt, 1, 2)


def _drawn_to(rest: Array, shape: Array, variance: float) -> Array:
    """shape [B, 3] m, known to `variance` [m²] per coordinate, less what noise alone may have made of its difference to the shape at rest."""
    centre, R = _poses(shape[None], rest - rest.mean(0))
    there = centre[0] + (rest - rest.mean(0)) @ R[0].T
    d = shape - there
    return there + max(0.0, 1 - variance / max(float(np.mean(d**2)), 1e-300)) * d


def _smoothed(x: Array, noise: float) -> Array:
    """x [T, B, 3] m as smooth in time as generalised cross-validation makes it, within `noise` [m], root mean square."""
    s, U = np.linalg.eigh(_roughness(len(x)))
    c = U.T @ x.reshape(len(x), -1)
    taken = 1 - 1 / (1 + SMOOTHNESS[:, None] * s)  # share of every component that each λ takes away
    moved = taken**2 @ np.sum(c**2, 1)  # |x − x̂|²
    worth = np.where(moved <= noise**2 * x.size, moved / np.sum(taken, 1) ** 2, np.inf)
    best = int(np.argmin(worth))
    return x if np.isinf(worth[best]) else (U @ ((1 - taken[best])[:, None] * c)).reshape(x.shape)


def _roughness(T: int) -> Array:
    """D₃ᵀD₃ [T, T]."""
    D = np.diff(np.eye(T), 3, axis=0)
    return D.T @ D
