"""A surface for frame 0 from masks alone: the visual hull, meshed.

H = {x : every camera k that has x in its image has π_k(x) inside its mask, and at least a given share of all cameras has}. The hull is
the zero set of the field

φ(x) = min_k d_k(π_k(x)) z_k(x)/f_k   [m, positive inside]

with d_k the signed distance to the mask's outline in pixels, so that marching cubes places the surface between grid points. The largest
piece is smoothed (Taubin 1995: λ, then μ, no shrinkage), brought to the wanted number of vertices by collapsing shortest edges, and its
triangles are evened out by moving vertices towards their neighbours' mean and back onto the surface.

Source: Laurentini (1994), The visual hull concept. Limits: hollows that no outline shows are filled (under arms, between folds), the body
and its clothes are one piece without names, and colours are not used: photometric refinement of the hull is not built.
"""

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras, project
from tasks.geometry.distances import closest_points
from tasks.geometry.faults import BadInput, Fault
from tasks.geometry.meshes import boundary_edges, components, edges, mesh_faults, submesh
from tasks.tracking.mask_distance import signed_distance

Array = NDArray[np.float64]

_COARSE = 48  # grid points along the longest side of the first, wide search
_EVENING = 8


def visual_hull(
    masks: list[NDArray],
    cameras: Cameras,
    *,
    target_vertices: int = 5000,
    voxel: float = 0.01,
    bounds: Array | None = None,
    least_share: float = 0.5,
) -> tuple[Array, NDArray[np.int32]]:
    """Watertight mesh (vertices [V, 3] m, faces [F, 3], outward) of what lies within all masks [camera][height, width].

    voxel: grid spacing [m]; bounds [2, 3] m: where to look, by default around the point that all cameras look at;
    least_share: a point that fewer of the cameras have in their image is outside. Raises BadInput.
    """
    distances = _outlines(masks, cameras)
    box = _search(distances, cameras, least_share) if bounds is None else np.asarray(bounds, float)
    field, points, shape = _field(distances, cameras, box, voxel, least_share)
    if not (field > 0).any():
        raise BadInput([Fault("masks", "no point lies within all of them", "Check that masks and calibration belong together.")])
    vertices, faces = _largest(*_surface(field, points, shape))
    fine = _taubin(vertices, faces)
    coarse, coarse_faces = _decimated(fine, faces, target_vertices)
    even = _evened(coarse, coarse_faces, fine, faces)
    faults = mesh_faults(even, coarse_faces, "visual hull", metres=False)
    if len(boundary_edges(coarse_faces)):
        faults.append(Fault("visual hull", "it is not closed", "Enlarge the bounds: the hull reaches their edge."))
    if faults:
        raise BadInput(faults)
    return even, coarse_faces


def _outlines(masks: list[NDArray], cameras: Cameras) -> list[NDArray[np.float32]]:
    """Signed distance to each mask's outline [px], positive inside."""
    faults = [
        Fault(
            f"mask of camera {name}",
            f"size {mask.shape[1::-1]}, camera {tuple(int(n) for n in size)}",
            "Give masks of the calibrated size.",
        )
        for name, mask, size in zip(cameras.names, masks, cameras.size, strict=True)
        if mask.shape[:2] != (size[1], size[0])
    ]
    if faults:
        raise BadInput(faults)
    return [signed_distance(m if m.dtype == bool else m > m.max() / 2) for m in masks]


def _search(distances: list[NDArray[np.float32]], cameras: Cameras, least_share: float) -> Array:
    """Bounds [2, 3] of the hull with a margin, from a coarse grid around the point nearest to all optical axes."""
    axis, centre = cameras.R[:, 2], cameras.centres()
    P = np.eye(3) - axis[:, :, None] * axis[:, None, :]
    middle = np.linalg.lstsq(P.sum(0), np.einsum("kij,kj->i", P, centre), rcond=None)[0]
    reach = np.linalg.norm(centre - middle, axis=1).max()
    wide = np.array([middle - reach, middle + reach])
    for _ in range(2):  # the second pass sees what is thinner than the first one's spacing
        spacing = (wide[1] - wide[0]).max() / _COARSE
        field, points, _ = _field(distances, cameras, wide, spacing, least_share)
        near = points[field > -spacing]
        if not len(near):
            raise BadInput([Fault("masks", "no point lies within all of them", "Check that masks and calibration belong together.")])
        wide = np.array([near.min(0) - spacing, near.max(0) + spacing])
    return wide


def _field(
    distances: list[NDArray[np.float32]], cameras: Cameras, box: Array, spacing: float, least_share: float
) -> tuple[Array, Array, tuple[int, int, int]]:
    """φ [N] m at grid points [N, 3], x fastest, and the grid's shape (x, y, z)."""
    axes = [np.arange(box[0, a], box[1, a] + spacing, spacing) for a in range(3)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    φ, views = np.full(len(points), np.inf), np.zeros(len(points), np.int32)
    for k, distance in enumerate(distances):
        uv, depth = project(cameras.subset([k]), points)
        _carve(distance, uv[0], depth[0] / cameras.K[k, 0, 0], φ, views)
    φ[views < max(1, least_share * len(cameras))] = -spacing
    return φ, points, (len(axes[0]), len(axes[1]), len(axes[2]))


@njit(parallel=True, cache=True)
def _carve(distance, uv, metres, φ, views):
    height, width = distance.shape
    for n in prange(len(uv)):
        u, v = uv[n, 0] - 0.5, uv[n, 1] - 0.5
        if not (metres[n] > 0 and u >= 0 and v >= 0 and u < width - 1 and v < height - 1):
            continue
        i, j = int(u), int(v)
        f, g = u - i, v - j
        d = (1 - g) * ((1 - f) * distance[j, i] + f * distance[j, i + 1]) + g * ((1 - f) * distance[j + 1, i] + f * distance[j + 1, i + 1])
        φ[n] = min(φ[n], d * metres[n])
        views[n] += 1


def _surface(field: Array, points: Array, shape: tuple[int, int, int]) -> tuple[Array, NDArray[np.int32]]:
    """Zero set by marching cubes, normals outward."""
    import igl

    V, F, _ = igl.marching_cubes(field, points, *shape, 0.0)
    a, b, c = V[F[:, 0]], V[F[:, 1]], V[F[:, 2]]
    outward = np.einsum("fi,fi->", a, np.cross(b, c)) > 0  # six times the enclosed volume
    return V, (F if outward else F[:, ::-1]).astype(np.int32)


def _largest(vertices: Array, faces: NDArray[np.int32]) -> tuple[Array, NDArray[np.int32]]:
    label = components(faces, len(vertices))
    kept, old = submesh(faces, label == np.bincount(label).argmax())
    return vertices[old], kept


def _neighbour_mean(faces: NDArray[np.int32], n: int):  # scipy's sparse matrices have no public type
    from scipy.sparse import coo_matrix, diags

    e = edges(faces)
    A = coo_matrix((np.ones(2 * len(e)), (np.concatenate([e[:, 0], e[:, 1]]), np.concatenate([e[:, 1], e[:, 0]]))), shape=(n, n)).tocsr()
    return diags(1 / np.asarray(A.sum(1)).ravel()) @ A


def _taubin(vertices: Array, faces: NDArray[np.int32], *, sweeps: int = 10, λ: float = 0.5, μ: float = -0.53) -> Array:
    mean = _neighbour_mean(faces, len(vertices))
    for _ in range(sweeps):
        for weight in (λ, μ):
            vertices = vertices + weight * (mean @ vertices - vertices)
    return vertices


def _decimated(vertices: Array, faces: NDArray[np.int32], target_vertices: int) -> tuple[Array, NDArray[np.int32]]:
    """Shortest edges collapsed until about `target_vertices` remain (a closed surface has two faces per vertex)."""
    import igl

    if len(vertices) <= target_vertices:
        return vertices, faces
    V, F, _, _ = igl.decimate(np.asfortranarray(vertices), np.asfortranarray(faces), 2 * target_vertices - 4)
    return np.ascontiguousarray(V), np.ascontiguousarray(F).astype(np.int32)


def _evened(vertices: Array, faces: NDArray[np.int32], fine: Array, fine_faces: NDArray[np.int32]) -> Array:
    mean = _neighbour_mean(faces, len(vertices))
    for _ in range(_EVENING):
        vertices = closest_points(0.5 * vertices + 0.5 * (mean @ vertices), fine, fine_faces).point
    return vertices
