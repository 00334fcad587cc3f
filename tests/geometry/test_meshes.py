"""Topology against brute force, normals and areas against closed forms, and every fault by name."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.geometry.distances import closest_points, signed_distance
from tasks.geometry.faults import BadInput, Fault, refuse
from tasks.geometry.meshes import (
    boundary_edges,
    components,
    edges,
    face_areas,
    hinges,
    mesh_faults,
    submesh,
    vertex_areas,
    vertex_normals,
    weld,
)

CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]],
    np.int32,
)


def grid(n: int, m: int) -> tuple[np.ndarray, np.ndarray]:
    """An n × m sheet in the x, y plane, normals along +z."""
    x, y = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    i = np.arange(n * m).reshape(n, m)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1).astype(float), np.concatenate(
        [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    ).astype(np.int32)


def hinges_obvious(faces: np.ndarray) -> set[tuple]:
    found = set()
    for f in faces.tolist():
        for k in range(3):
            a, b, c = f[k], f[(k + 1) % 3], f[(k + 2) % 3]
            for g in faces.tolist():
                for j in range(3):
                    if (g[j], g[(j + 1) % 3]) == (b, a) and a < b:
                        found.add((a, b, c, g[(j + 2) % 3]))
    return found


@given(st.integers(2, 5), st.integers(2, 5), st.randoms(use_true_random=False))
@settings(max_examples=20, deadline=None)
def test_hinges_are_the_obvious_ones(n, m, random):
    _, faces = grid(n, m)
    keep = np.array([random.random() < 0.8 for _ in faces]) | (np.arange(len(faces)) == 0)
    assert {tuple(h) for h in hinges(faces[keep]).tolist()} == hinges_obvious(faces[keep])


def test_euler_characteristic_and_boundaries():
    assert len(CUBE) - len(edges(CUBE_FACES)) + len(CUBE_FACES) == 2
    assert len(hinges(CUBE_FACES)) == len(edges(CUBE_FACES))
    assert len(boundary_edges(CUBE_FACES)) == 0
    _, sheet = grid(4, 5)
    assert len(boundary_edges(sheet)) == 2 * (3 + 4)


def test_normals_areas_and_signed_distance_of_the_cube():
    assert face_areas(CUBE, CUBE_FACES).sum() == pytest.approx(6)
    assert vertex_areas(CUBE, CUBE_FACES).sum() == pytest.approx(6)
    outward = np.sum(vertex_normals(CUBE, CUBE_FACES) * (CUBE - 0.5), 1)
    assert (outward > 0).all()
    np.testing.assert_allclose(signed_distance(np.array([[0.5, 0.5, 0.5], [2.0, 0.5, 0.5]]), CUBE, CUBE_FACES), [-0.5, 1.0])
    near = closest_points(np.array([[0.25, 0.75, 3.0]]), CUBE, CUBE_FACES)
    np.testing.assert_allclose(near.point, [[0.25, 0.75, 1.0]])
    np.testing.assert_allclose(near.barycentric[0] @ CUBE[CUBE_FACES[near.face[0]]], near.point[0])


def test_pieces_and_welding():
    two = np.concatenate([CUBE, CUBE + 5])
    faces = np.concatenate([CUBE_FACES, CUBE_FACES + 8])
    assert components(faces, 16).tolist() == [0] * 8 + [1] * 8
    soup = CUBE[CUBE_FACES].reshape(-1, 3)
    vertices, index = weld(soup, 1e-6)
    assert len(vertices) == 8
    np.testing.assert_array_equal(vertices[index], soup)
    part, kept = submesh(faces, np.arange(16) >= 8)
    np.testing.assert_array_equal(two[kept][part], two[faces[12:]])


BROKEN = {
    "not finite": lambda v, f: (np.where(np.arange(8)[:, None] == 3, np.nan, v), f),
    "face 3 names vertices": lambda v, f: (v, np.where(np.arange(12)[:, None] == 3, 9, f)),
    "no area": lambda v, f: (v, np.concatenate([f, [[0, 1, 1]]])),
    "more than two faces": lambda v, f: (np.concatenate([v, [[0.5, -1, 0.5]]]), np.concatenate([f, [[0, 1, 8]]])),
    "run the same way": lambda v, f: (v, np.where(np.arange(12)[:, None] == 0, f[:, ::-1], f)),
    "diagonal of 1732": lambda v, f: (v * 1000, f),
    "diagonal of 0.001732": lambda v, f: (v / 1000, f),
    "no faces": lambda v, f: (v, f[:0]),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_broken_mesh_is_refused_with_its_fault(what):
    faults = mesh_faults(*BROKEN[what](CUBE, CUBE_FACES), "cube.obj")
    assert any(what in str(fault) and "cube.obj" in str(fault) for fault in faults), faults


def test_a_sound_mesh_has_no_fault():
    assert mesh_faults(CUBE, CUBE_FACES, "cube.obj") == []
    refuse([])
    with pytest.raises(BadInput, match=r"a: b\. c\nd: e\. f"):
        refuse([Fault("a", "b", "c"), Fault("d", "e", "f")])
