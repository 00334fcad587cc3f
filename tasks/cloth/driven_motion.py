"""What the driven nodes really did: a tracked boundary without the tracker's noise.

Driven nodes are stiff: a millimetre of noise at 30 frames per second is an acceleration of several metres per second squared that the cloth must
follow, and strain on the edges between them. On a skirt of 650 vertices 1 mm of noise at the waist moved the rest by 10–25 mm within eight frames.

A border moves almost rigidly with the body. Its motion is split into the rigid motion of all nodes (Kabsch 1976, averaged over them), the mean shape,
and what remains, of which only the principal components are kept that noise alone would not make: white noise σ on a T × 3B matrix has no
singular value above about σ(√T + √(3B)) (Geman 1980). Nothing is smoothed in time: at 25 frames per second a turning body moves too far between
frames for a polynomial through five of them (0.5 mm of error on a ring that turns by 40 degrees at 1.3 Hz).
Limits: what a single node does beyond that is lost; the pose keeps the noise of the mean over the nodes.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROUNDS = 3  # of alignment to a mean shape that the alignment itself improves
FEWEST = 4  # fewer nodes, or frames, have nothing worth averaging


def quieted(x: Array, noise: float) -> Array:
    """The motion [T, B, 3] m of driven nodes from what was tracked of them, with white noise of `noise` [m] per coordinate."""
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
    kept = shape + ((U[:, real] * s[real]) @ W[real]).reshape(T, B, 3)
    return centre[:, None] + np.einsum("tij,tbj->tbi", R, kept)


def _poses(x: Array, shape: Array) -> tuple[Array, Array]:
    """Centres [T, 3] and rotations [T, 3, 3] that carry the shape [B, 3] onto x [T, B, 3] with the least squares."""
    centre = x.mean(1)
    H = np.einsum("bi,tbj->tij", shape - shape.mean(0), x - centre[:, None])
    U, _, Wt = np.linalg.svd(H)
    flip = np.linalg.det(U @ Wt)
    U[:, :, 2] *= flip[:, None]
    return centre, np.swapaxes(U @ Wt, 1, 2)
