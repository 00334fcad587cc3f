"""The z-buffer against ray casting pixel by pixel."""

import numpy as np

from tasks.geometry.rasterise import rasterise
from tests.geometry.test_meshes import CUBE, CUBE_FACES


def ray_cast_obvious(K, R, t, size, vertices, faces):
    """Möller & Trumbore 1997, one pixel and one face at a time."""
    x = vertices @ R.T + t
    face, depth = np.full(size[::-1], -1), np.full(size[::-1], np.inf)
    for j in range(size[1]):
        for i in range(size[0]):
            r = np.linalg.solve(K, [i + 0.5, j + 0.5, 1.0])
            for f, (a, b, c) in enumerate(x[faces]):
                A = np.stack([-r, b - a, c - a], 1)
                if abs(np.linalg.det(A)) > 1e-12:
                    z, β, γ = np.linalg.solve(A, -a)
                    if z > 1e-3 and β >= 0 and γ >= 0 and β + γ <= 1 and z < depth[j, i]:
                        face[j, i], depth[j, i] = f, z
    return face, depth


def view(distance: float):
    K = np.array([[40.0, 0, 16.3], [0, 42.0, 11.8], [0, 0, 1]])
    angle = 0.5
    R = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
    return K, R, np.array([0.1, -0.05, distance])


def test_rasterised_as_ray_cast():
    K, R, t = view(2.5)
    ours = rasterise(K, R, t, (32, 24), CUBE - 0.5, CUBE_FACES)
    face, depth = ray_cast_obvious(K, R, t, (32, 24), CUBE - 0.5, CUBE_FACES)
    assert (face >= 0).sum() > 100
    np.testing.assert_allclose(ours.depth, depth, rtol=1e-5)
    assert ((ours.face == face) | np.isclose(ours.depth, depth, rtol=1e-6)).all()  # on an edge either face may win
    seen = ours.face >= 0
    x = np.einsum("nk,nkc->nc", ours.barycentric[seen], ((CUBE - 0.5) @ R.T + t)[CUBE_FACES[ours.face[seen]]])
    j, i = np.nonzero(seen)
    np.testing.assert_allclose((K @ (x / x[:, 2:]).T).T[:, :2], np.stack([i + 0.5, j + 0.5], 1), atol=1e-4)


def test_a_camera_inside_the_mesh_sees_it_all_around_and_nothing_behind():
    K, R, _ = view(0)
    ours = rasterise(K, R, np.zeros(3), (32, 24), CUBE - 0.5, CUBE_FACES)
    _, depth = ray_cast_obvious(K, R, np.zeros(3), (32, 24), CUBE - 0.5, CUBE_FACES)
    np.testing.assert_allclose(ours.depth, depth, rtol=1e-5)
