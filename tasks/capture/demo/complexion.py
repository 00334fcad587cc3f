"""Colours of the actor's body at its vertices: skin with slow variation and freckles, a cap of hair, brows, eyes, lips, shoes.

The face is found by the landmarks of the body model, so that any body in the layout of SMPL-X can be painted. Resolution is that
of the vertices (4-10 mm).
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SKIN, LIPS, HAIR, WHITE, IRIS, SHOES = (
    np.array(c)
    for c in ((0.52, 0.31, 0.22), (0.42, 0.10, 0.09), (0.045, 0.028, 0.02), (0.75, 0.73, 0.7), (0.05, 0.07, 0.06), (0.10, 0.05, 0.035))
)
LEFT_BROW, RIGHT_BROW, EYES, MOUTH = slice(0, 5), slice(5, 10), (slice(19, 25), slice(25, 31)), slice(31, 43)  # of the 51 landmarks
HEAD, EYEBALLS, FEET = 15, (23, 24), (7, 8, 10, 11)


def complexion(vertices: Array, joints: Array, weights: Array, face: Array, rng: np.random.Generator) -> Array:
    """Linear albedo [V, 3] of a body at rest.

    vertices [V, 3], joints [55, 3], face [51, 3] m, the landmarks without the contour; weights [V, 55] skin weights.
    """
    colours = SKIN * (1 + _mottling(vertices, rng)[:, None] * np.array([0.5, 1.0, 1.0]))
    _cover(colours, weights[:, FEET].sum(1) > 0.5, SHOES)
    _cover(colours, _hair(vertices, weights, face), HAIR)
    _cover(colours, _near_curve(vertices, face[LEFT_BROW]) | _near_curve(vertices, face[RIGHT_BROW]), HAIR * 1.5)
    _cover(colours, _in_outline(vertices, face[MOUTH]), LIPS)
    for eye, joint in ((face[part], _nearest_eye(face[part], joints)) for part in EYES):
        ball = np.linalg.norm(vertices - joint, axis=1)
        front = eye.mean(0)
        _cover(colours, _in_outline(vertices, eye) | (weights[:, EYEBALLS].max(1) > 0.5) & (ball < 0.02), WHITE)
        _cover(colours, np.linalg.norm(vertices[:, :2] - front[:2], axis=1) + 1e3 * (vertices[:, 2] < front[2] - 0.02) < 0.0065, IRIS)
    return np.clip(colours, 0.02, 0.9)


def _cover(colours: Array, where: NDArray[np.bool_], tint: Array) -> None:
    """Paint over, keeping half of the mottling: hair and shoes are not of one colour either."""
    shade = colours[where].mean(1, keepdims=True) / SKIN.mean()
    colours[where] = tint * (0.5 + 0.5 * shade)


def _mottling(vertices: Array, rng: np.random.Generator) -> Array:
    """Sum of plane waves of random direction, from 15 cm to 3 cm, of falling amplitude; and freckles."""
    total = np.zeros(len(vertices))
    for length, amplitude in ((0.15, 0.05), (0.07, 0.045), (0.035, 0.045)):
        for _ in range(6):
            k = rng.normal(size=3)
            total += amplitude * np.sin(vertices @ (k / np.linalg.norm(k)) * 2 * np.pi / length + rng.uniform(0, 2 * np.pi))
    return total / np.sqrt(2) - 0.25 * (rng.uniform(size=len(vertices)) < 0.03)


def _hair(vertices: Array, weights: Array, face: Array) -> NDArray[np.bool_]:
    """The head above a plane that rises from the nape to a hairline over the brows."""
    brow = face[:10].mean(0)
    height = brow[1] - face[MOUTH].mean(0)[1]
    hairline = brow[1] + 0.5 * height + 1.1 * (vertices[:, 2] - brow[2])
    nape = brow[1] - 1.1 * height
    return (weights[:, HEAD] > 0.5) & (vertices[:, 1] > np.maximum(hairline, nape))


def _near_curve(vertices: Array, curve: Array, distance: float = 0.0055) -> NDArray[np.bool_]:
    points = np.concatenate([np.linspace(a, b, 8) for a, b in pairwise(curve)])
    return np.linalg.norm(vertices[:, None] - points[None], axis=2).min(1) < distance


def _in_outline(vertices: Array, outline: Array) -> NDArray[np.bool_]:
    """Seen from the front, inside the outline [P, 3] (its convex hull), and not far behind it."""
    from scipy.spatial import Delaunay

    seen = Delaunay(outline[:, :2]).find_simplex(vertices[:, :2]) >= 0
    return seen & (np.abs(vertices[:, 2] - outline[:, 2].mean()) < 0.02)


def _nearest_eye(lids: Array, joints: Array) -> Array:
    eyes = joints[list(EYEBALLS)]
    return eyes[np.linalg.norm(eyes - lids.mean(0), axis=1).argmin()]
