"""Where the hinges of a cloth lie in its sewing pattern."""

import numpy as np

from tasks.geometry.meshes import edge_lengths
from tasks.simulator import Cloth
from tasks.simulator.hinge_bending import hinge_shape
from tasks.simulator.potential import Array


def edges_in_pattern(cloth: Cloth) -> Array:
    """Places [H, side, end, 2] m in the pattern of both ends (a, b) of each hinge as either of its faces has them."""
    assert cloth.uv is not None
    n, faces, uv = len(cloth.x_rest), cloth.faces.astype(np.int64), cloth.uv
    key = np.concatenate([faces[:, i] * n + faces[:, (i + 1) % 3] for i in range(3)])
    ends = np.concatenate([np.stack([uv[:, i], uv[:, (i + 1) % 3]], 1) for i in range(3)])
    order = np.argsort(key)
    a, b = cloth.hinges[:, 0].astype(np.int64), cloth.hinges[:, 1].astype(np.int64)
    first, second = (order[np.searchsorted(key[order], k)] for k in (a * n + b, b * n + a))
    return np.stack([ends[first], ends[second][:, ::-1]], 1)


def hinge_spans(cloth: Cloth) -> Array:
    """(Ā₁ + Ā₂)/|ē| [H] m: the angle of a hinge on a cylinder of curvature κ about its edge is κ times this."""
    length = edge_lengths(cloth.x_rest, cloth.hinges[:, :2])
    return 3 * length / hinge_shape(cloth)
