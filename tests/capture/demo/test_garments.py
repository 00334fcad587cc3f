"""Panels, hulls and garments: triangle quality, isometry between pattern and body, no contact with the body when sewn."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tasks.capture.demo.garments import Panel, locate, pattern_strain, sew
from tasks.capture.demo.hulls import arc_length, bridge, hull_curve
from tasks.capture.demo.panels import inside, sample, triangulate
from tasks.geometry.distances import signed_distance
from tasks.geometry.meshes import boundary_edges, components, edges, face_areas, mesh_faults

L_SHAPE = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]) * 0.2


def outline_of(corners: np.ndarray, spacing: float) -> np.ndarray:
    closed = np.concatenate([corners, corners[:1]])
    return np.concatenate([sample(closed[k : k + 2], spacing)[:-1] for k in range(len(corners))])


def quality(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """4√3 A / Σ l²: 1 for an equilateral triangle."""
    length2 = sum(np.sum((points[faces[:, k]] - points[faces[:, k - 1]]) ** 2, 1) for k in range(3))
    return 4 * np.sqrt(3) * face_areas(np.c_[points, np.zeros(len(points))], faces) / length2


def test_a_panel_is_filled_exactly_with_good_triangles() -> None:
    outline = outline_of(L_SHAPE, 0.02)
    points, faces = triangulate(outline, 0.02, np.random.default_rng(0))
    assert_allclose(points[: len(outline)], outline)
    assert face_areas(np.c_[points, np.zeros(len(points))], faces).sum() == pytest.approx(3 * 0.04, rel=1e-12)
    assert quality(points, faces).min() > 0.5 and np.median(quality(points, faces)) > 0.95
    assert len(np.unique(np.linalg.norm(np.diff(points[edges(faces)], axis=1), axis=2).round(6))) > 300  # unstructured


def test_a_slot_narrower_than_its_triangles_is_refused() -> None:
    """A corner close to the far side of a slot: Delaunay joins it across and loses the edge there."""
    slot = np.array([[0, 0], [2, 0], [2, 1], [0, 1], [0, 0.52], [0.5, 0.501], [1, 0.52], [1, 0.5], [0, 0.5]])
    with pytest.raises(ValueError, match="finer spacing"):
        triangulate(slot, 5.0, np.random.default_rng(0))


def test_inside_a_polygon_with_a_corner_cut_out() -> None:
    assert inside(np.array([[0.1, 0.1], [0.3, 0.3], [0.3, 0.1], [0.5, 0.1]]), L_SHAPE).tolist() == [True, False, True, False]


def test_hull_of_a_disc_is_a_circle_at_the_ease() -> None:
    turn = np.linspace(0, 2 * np.pi, 3000)
    curve = hull_curve(0.15 * np.stack([np.cos(turn), np.sin(turn)], 1), 0.01)
    assert_allclose(np.linalg.norm(curve, axis=1), 0.16, atol=1e-6)
    assert arc_length(curve)[-1] == pytest.approx(2 * np.pi * 0.16, rel=1e-4)


def test_hull_keeps_the_ease_from_every_point() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(0, 1, (60, 2)) * [0.2, 0.1]
    curve = hull_curve(points, 0.01)
    nearest = np.linalg.norm(points[:, None] - curve[None], axis=2).min()
    assert 0.0099 < nearest < 0.03
    assert inside(points, curve[:-1]).all()


def test_hull_of_an_ellipse_stays_close_to_it() -> None:
    """Support function and its derivative together give the curve; h n alone would leave the ellipse by half its lesser axis."""
    turn = np.linspace(0, 2 * np.pi, 3000)
    ellipse = np.stack([0.2 * np.cos(turn), 0.1 * np.sin(turn)], 1)
    away = np.linalg.norm(hull_curve(ellipse, 0.01)[:, None] - ellipse[None], axis=2).min(1)
    assert away.min() > 0.0099 and away.max() < 0.022


def test_bridge_over_nothing_is_straight_and_over_a_post_clears_it() -> None:
    start, end = np.array([0.1, 1.0]), np.array([-0.1, 1.0])
    assert_allclose(bridge(start, end, np.array([[0.0, 0.5]]), ease=0.01)[:, 1], 1.0)
    over = bridge(start, end, np.array([[0.0, 1.2], [0.02, 1.2]]), ease=0.012)
    assert_allclose(over[[0, -1]], [start, end], atol=1e-12)
    assert np.linalg.norm(over - [0.0, 1.2], axis=1).min() > 0.006


def test_sewing_joins_what_meets_and_nothing_else() -> None:
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]) * 0.1
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    flat = np.c_[square, np.zeros(4)]
    held = np.array([True, False, False, True])
    garment = sew("cloth", [Panel(square, faces, flat, held), Panel(square, faces, flat + np.array([0.1, 0, 0]), ~held)])
    assert len(garment.vertices) == 6 and len(garment.uv_vertices) == 8
    assert_allclose(pattern_strain(garment), 1)
    assert sorted(garment.vertices[garment.boundary][:, 0].round(3).tolist()) == [0.0, 0.0, 0.2, 0.2]


@pytest.mark.parametrize(("name", "loops", "stretch"), [("skirt", 2, 0.01), ("top", 4, 0.2)])
def test_garments_are_sound_and_fit(plan, name, loops, stretch) -> None:
    """One piece with the openings of its kind, cut from the pattern without stretching, clear of the body by millimetres."""
    for garment in (plan.fittings[name].garment, plan.scanned[name]):
        assert mesh_faults(garment.vertices, garment.faces, name) == []
        assert components(garment.faces, len(garment.vertices)).max() == 0
        assert components_of_edges(boundary_edges(garment.faces)) == loops
        assert quality(garment.uv_vertices, garment.uv_faces).min() > 0.4
        strain = pattern_strain(garment)
        assert np.abs(strain - 1).max() < stretch and np.abs(strain - 1).mean() < 0.015
        assert signed_distance(garment.vertices, plan.actor.posed.vertices[0], plan.actor.model.faces).min() > 0.003
        assert garment.faces.shape == garment.uv_faces.shape
        normal_area = np.cross(*np.moveaxis(np.diff(garment.uv_vertices[garment.uv_faces], axis=1), 1, 0))
        assert (normal_area > 0).all()
    limit = {"skirt": 800, "top": 900}[name]
    assert (
        len(plan.scanned[name].vertices) < limit
        and 1.7 < len(plan.fittings[name].garment.vertices) / len(plan.scanned[name].vertices) < 2.3
    )


@pytest.mark.parametrize("name", ["skirt", "top"])
def test_nothing_crosses_when_sewn(plan, name) -> None:
    """Neither the garment itself nor garment and collider; a garment shifted by 10 cm does cross the collider."""
    fitting = plan.fittings[name]
    assert not crosses(fitting.garment.vertices, fitting)
    assert crosses(fitting.garment.vertices + np.array([0.1, 0, 0]), fitting)


@pytest.mark.parametrize("name", ["skirt", "top"])
def test_scanned_vertices_lie_on_the_fine_surface(plan, name) -> None:
    """The same pattern in other triangles: through the pattern a coarse vertex finds its own place in space, up to the sag of a chord."""
    coarse, fine = plan.scanned[name], plan.fittings[name].garment
    assert np.linalg.norm(locate(coarse, fine).of(fine.vertices) - coarse.vertices, axis=1).max() < 2.5e-3


def crosses(x: np.ndarray, fitting) -> bool:
    import ipctk

    vertices = np.concatenate([x, fitting.collider_motion[0]])
    faces = np.concatenate([fitting.garment.faces, fitting.collider_faces + len(x)])
    mesh = ipctk.CollisionMesh(vertices, edges(faces), faces)
    mesh.can_collide = ipctk.make_vertex_patches_filter(
        np.r_[np.arange(1, len(x) + 1), np.zeros(len(vertices) - len(x), int)].astype(np.int32)
    )
    return ipctk.has_intersections(mesh, vertices)


def components_of_edges(pairs: np.ndarray) -> int:
    used, index = np.unique(pairs, return_inverse=True)
    e = index.reshape(-1, 2)
    return int(components(np.c_[e, e[:, :1]], len(used)).max()) + 1
