"""Boundary nodes: where garment and body move least against one another (PhysAvatar, supplement A.3).

Candidates are the open borders of the garment (waistband, neckline, armholes, hems). In the frame of the nearest body face a border that is
fastened stays put; the measure is the standard deviation over time of each node's place in that frame, over the frames in which it is known, of
which `FEWEST` are needed. The border with the least median is fastened, and with it every border below `ALIKE` times that; the nodes of a
border that stay within `ALIKE` times its median are driven.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from tasks.geometry.distances import Closest, closest_points
from tasks.geometry.meshes import boundary_edges

Array = NDArray[np.float64]

ALIKE = 2.0
NEAREST_M = 0.06  # [m] borders farther from the body than this in the median are free hems
FEWEST = 3  # frames: one has no motion, and of two any pair of nodes may agree by chance


@dataclass(frozen=True)
class Fastening:
    """nodes [B] driven by the body; relative_motion_m [V] (NaN inside, and of nodes known in too few frames); borders: (nodes, median
    motion in mm, whether fastened) each; unjudged: how many borders near the body have no node that is known in enough frames.
    """

    nodes: NDArray[np.int32]
    relative_motion_m: Array
    borders: tuple[tuple[int, float, bool], ...]
    unjudged: int = 0


def fastened_nodes(x: Array, faces: NDArray[np.int32], body: Array, body_faces: NDArray[np.int32]) -> Fastening:
    """Which border nodes of a garment x [T, V, 3] m, NaN where not known but in the first frame, the body [T, C, 3] m carries; none of one
    without a border.
    """
    border = boundary_edges(faces)
    nodes = np.unique(border)
    motion = np.full(x.shape[1], np.nan)
    if not len(nodes):
        return Fastening(nodes.astype(np.int32), motion, ())
    motion[nodes], distance = _relative_motion(x[:, nodes], body, body_faces)
    loops = _loops(border, x.shape[1], nodes)
    median = np.array([_median(motion[loop]) for loop in loops])
    near = np.array([np.median(distance[np.searchsorted(nodes, loop)]) < NEAREST_M for loop in loops])
    judged = near & np.isfinite(median)
    least = median[judged].min() if judged.any() else np.inf
    held = judged & (median <= ALIKE * least)
    driven = [loop[motion[loop] <= ALIKE * m] for loop, m, h in zip(loops, median, held) if h]
    rows = tuple((len(loop), float(1e3 * m), bool(h)) for loop, m, h in zip(loops, median, held))
    chosen = np.sort(np.concatenate(driven)).astype(np.int32) if driven else np.empty(0, np.int32)
    return Fastening(chosen, motion, rows, int((near & ~judged).sum()))


def carried(x0: Array, body: Array, body_faces: NDArray[np.int32]) -> Array:
    """Points x0 [n, 3] m carried along [T, n, 3] m, each rigidly with the face of the body [T, C, 3] m that is nearest at first."""
    near = closest_points(x0, body[0], body_faces)
    at, frame = _on_faces(body, body_faces, near)
    local = np.einsum("nij,nj->ni", frame[0], x0 - at[0])
    return at + np.einsum("tnij,ni->tnj", frame, local)


def _relative_motion(x: Array, body: Array, body_faces: NDArray[np.int32]) -> tuple[Array, Array]:
    """Standard deviation over time [n] m of x [T, n, 3] in the frame of its nearest body face at the first frame, NaN where fewer than
    `FEWEST` are known, and that distance [n] m.
    """
    near = closest_points(x[0], body[0], body_faces)
    at, frame = _on_faces(body, body_faces, near)
    local = np.einsum("tnij,tnj->tni", frame, x - at)
    enough = np.isfinite(x).all(-1).sum(0) >= FEWEST
    return np.where(enough, np.sqrt(np.nanvar(local, 0).sum(-1)), np.nan), near.distance


def _median(motion: Array) -> float:
    """Of the nodes of a border [n] that can be judged; NaN where none can."""
    return float(np.median(motion[np.isfinite(motion)])) if np.isfinite(motion).any() else np.nan


def _on_faces(body: Array, body_faces: NDArray[np.int32], near: Closest) -> tuple[Array, Array]:
    """Where points of the body [T, n, 3] m go, and the axes [T, n, 3, 3] (rows) of the faces they lie on."""
    corners = body[:, body_faces[near.face]]  # [T, n, 3, 3]
    e1, e2 = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0]
    u = e1 / np.linalg.norm(e1, axis=-1, keepdims=True)
    n = np.cross(e1, e2)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return np.einsum("nk,tnkc->tnc", near.barycentric, corners), np.stack([u, np.cross(n, u), n], -2)


def _loops(border: NDArray[np.int32], vertex_count: int, nodes: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    graph = coo_matrix((np.ones(len(border)), (border[:, 0], border[:, 1])), shape=(vertex_count, vertex_count))
    label = connected_components(graph, directed=False)[1][nodes]
    return [nodes[label == k] for k in np.unique(label)]
