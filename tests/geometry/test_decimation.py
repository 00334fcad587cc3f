"""A coarser mesh is made of vertices of the finer one; lines, zones, corners and area stay, and no triangle is a sliver."""

import numpy as np
import pytest

from tasks.geometry.decimation import decimate, roundness
from tasks.geometry.meshes import boundary_edges, components, edges, face_areas, mesh_faults
from tests.geometry.test_meshes import grid

FREE, PINNED, HEM, SEAM = range(4)


def panel(n=55):
    """A square of 0.6 m with its first row pinned, its last a hem, and a seam down the middle: vertices, faces, kind."""
    x, faces = grid(n, n)
    x = x * 0.6 / (n - 1)
    kind = np.full(n * n, FREE, np.int32)
    kind[n // 2 :: n], kind[-n:], kind[:n] = SEAM, HEM, PINNED
    return x, faces, kind


def cone(rings, around, *, length=0.34, waist=0.135, hem=0.21):
    """A skirt: vertices from the waist down, faces."""
    x, faces = grid(around + 1, rings)
    angle, t = 2 * np.pi * x[:, 0] / around, x[:, 1] / (rings - 1)
    r = waist + (hem - waist) * t
    closed = np.arange((around + 1) * rings).reshape(around + 1, rings)
    closed[-1] = closed[0]
    used, number = np.unique(closed.ravel(), return_inverse=True)
    skirt = np.stack([r * np.cos(angle), -length * t, r * np.sin(angle)], 1)[used]
    return skirt, number.ravel()[faces].astype(np.int32)


@pytest.fixture(scope="module")
def coarse():
    x, faces, kind = panel()
    return x, faces, kind, decimate(x, faces, 800, kind=kind)


def test_it_has_as_many_vertices_as_asked_for_and_they_are_old_ones(coarse):
    x, _, _, found = coarse
    assert len(x) == 3025 and len(found.kept) == 800
    assert (np.diff(found.kept) > 0).all()
    assert np.array_equal(np.unique(found.faces), np.arange(800))


def test_the_surface_stays_a_manifold_of_one_piece_with_its_area(coarse):
    x, faces, _, found = coarse
    assert mesh_faults(x[found.kept], found.faces, "coarse") == []
    assert components(found.faces, 800).max() == 0
    V, E, F = len(found.kept), len(edges(found.faces)), len(found.faces)
    assert V - E + F == 1  # a disc
    assert face_areas(x[found.kept], found.faces).sum() == pytest.approx(face_areas(x, faces).sum(), rel=1e-9)


def test_border_vertices_and_corners_stay_on_the_border(coarse):
    _, faces, _, found = coarse
    border = found.kept[np.unique(boundary_edges(found.faces))]
    assert np.isin(border, np.unique(boundary_edges(faces))).all()
    corners = np.array([0, 54, 54 * 55, 55 * 55 - 1])
    assert np.isin(corners, border).all()


def test_pins_hem_and_seam_are_thinned_evenly_and_end_where_they_ended(coarse):
    x, _, kind, found = coarse
    for line, axis in ((PINNED, 1), (HEM, 1), (SEAM, 0)):
        old, new = np.sort(x[kind == line, axis]), np.sort(x[found.kept[kind[found.kept] == line], axis])
        assert 10 < len(new) < 0.8 * len(old)
        assert np.diff(new).max() < 5 * np.diff(old).max()
        assert new[-1] - new[0] > 0.9 * (old[-1] - old[0])


def test_triangles_are_round_and_of_one_size(coarse):
    x, _, _, found = coarse
    q = roundness(x[found.kept], found.faces)
    assert q.min() > 0.45 and np.median(q) > 0.75
    area = face_areas(x[found.kept], found.faces)
    assert area.max() < 8 * np.median(area)


def test_every_old_vertex_knows_the_kept_one_next_to_it(coarse):
    x, _, _, found = coarse
    assert np.array_equal(found.nearest[found.kept], np.arange(800))
    away = np.linalg.norm(x - x[found.kept[found.nearest]], axis=1)
    least = np.linalg.norm(x[:, None] - x[found.kept][None], axis=2).min(1)
    assert (away <= 1.6 * least + 1e-12).all()  # along edges, not through the air


def test_a_closed_band_keeps_its_two_rims_and_nearly_its_area():
    x, faces = cone(40, 75)
    found = decimate(x, faces, 700, kind=np.zeros(len(x), np.int32))
    assert len(found.kept) == 700
    V, E, F = 700, len(edges(found.faces)), len(found.faces)
    assert V - E + F == 0  # an annulus
    assert face_areas(x[found.kept], found.faces).sum() == pytest.approx(face_areas(x, faces).sum(), rel=0.02)
    assert mesh_faults(x[found.kept], found.faces, "coarse") == []


def test_a_mesh_where_nothing_may_go_stays_whole():
    x, faces, _ = panel(6)
    found = decimate(x, faces, 5, kind=np.arange(len(x), dtype=np.int32))
    assert np.array_equal(found.kept, np.arange(36))
