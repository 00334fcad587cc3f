"""Loose geometry becomes a scene: what the file holds is used, what it lacks is chosen and said, and what cannot be is refused."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.capture.tracked_geometry import TrackedGeometry
from tasks.cloth.boundary import carried
from tasks.cloth.tracked_scene import tracked_scene
from tasks.geometry.faults import BadInput
from tasks.geometry.rotations import matrix_from_axis_angle
from tests.cloth.test_boundary import swing


def track(**changes) -> TrackedGeometry:
    x, faces, body, body_faces = swing(8)
    found = TrackedGeometry(
        vertices=x,
        faces=faces,
        fps=25.0,
        observed=np.isfinite(x).all(2),
        boundary=np.empty(0, np.int32),
        collider_vertices=body,
        collider_faces=body_faces,
    )
    return replace(found, **changes)


def test_the_boundary_is_chosen_and_what_the_other_driver_changes_is_said():
    found = tracked_scene(track(), name="t")
    assert found.scene.cloth.boundary.tolist() == list(range(24))
    assert any("24 nodes chosen" in said for said in found.chosen)
    assert any("skinned ones lie" in said for said in found.chosen)
    other = tracked_scene(track(), name="t", driver="skinned")
    np.testing.assert_array_equal(other.scene.boundary_motion, found.otherwise)
    np.testing.assert_array_equal(other.otherwise, found.scene.boundary_motion)


def test_carried_points_move_rigidly_with_the_body():
    _, _, body, faces = swing(2)
    R = matrix_from_axis_angle(np.array([[0.2, -0.4, 0.7]]))[0]
    moved = np.stack([body[0], body[0] @ R.T + [0.1, 0.2, 0.3]])
    x = body[0, ::7] * [1.1, 1, 1.1]
    np.testing.assert_allclose(carried(x, moved, faces)[1], x @ R.T + [0.1, 0.2, 0.3], atol=1e-12)


def test_a_named_boundary_is_taken_and_without_a_body_there_is_no_other_driver():
    found = tracked_scene(track(boundary=np.array([3, 5], np.int32), collider_vertices=None, collider_faces=None), name="t")
    assert found.scene.cloth.boundary.tolist() == [3, 5]
    assert found.otherwise is None
    assert found.scene.collider_motion.shape == (8, 0, 3)


def test_the_weight_gives_the_density():
    plain, weighed = tracked_scene(track(), name="t"), tracked_scene(track(mass_kg=0.1), name="t")
    assert not plain.weighed and weighed.weighed
    assert weighed.fabric.areal_density * weighed.scene.cloth.rest_areas.sum() == pytest.approx(0.1)


def test_pattern_before_rest_vertices_before_the_first_frame():
    x = track().vertices[0]
    flat = np.stack([np.arctan2(x[:, 2], x[:, 0]) * 0.11, x[:, 1]], 1)
    assert tracked_scene(track(), name="t").scene.cloth.x_rest is not None
    np.testing.assert_array_equal(tracked_scene(track(), name="t").scene.cloth.x_rest, x)
    np.testing.assert_array_equal(tracked_scene(track(rest_vertices=2 * x), name="t").scene.cloth.x_rest, 2 * x)
    faces = track().faces
    open_ = faces[np.ptp(flat[faces, 0], axis=1) < 0.3]  # a tube lies flat once it is cut open: without the faces across the cut
    cut = tracked_scene(track(uv=flat, rest_vertices=2 * x, faces=open_), name="t").scene.cloth
    assert cut.rest_angles == "flat" and cut.uv.shape == (len(cut.faces), 3, 2)


def test_it_begins_with_the_first_whole_frame_and_compares_only_what_was_seen():
    at = track()
    x, seen = at.vertices.copy(), at.observed.copy()
    x[:2, 100], seen[:2, 100] = np.nan, False
    seen[5, 90] = False
    found = tracked_scene(replace(at, vertices=x, observed=seen), name="t")
    assert len(found.scene.observed) == 6 and "frames 2 to 7 of 8" in found.chosen[0]
    assert not found.scene.compared[3, 90] and found.scene.compared[3, 91]


def test_noise_covariances_whiten():
    at = track()
    C = np.broadcast_to(np.diag([1e-6, 4e-6, 9e-6]), (*at.observed.shape, 3, 3))
    scene = tracked_scene(replace(at, noise_cov=C), name="t").scene
    d = np.broadcast_to([1e-3, 2e-3, 3e-3], scene.observed.shape)
    np.testing.assert_allclose(scene.whitened(d), 1.0)
    np.testing.assert_allclose(scene.whitened(np.stack([d, 2 * d], -1))[..., 1], 2.0)


def test_a_body_the_garment_pokes_through_is_drawn_in():
    x, _, body, _ = swing(8, lag_m=0.0)
    slim = track(vertices=x, collider_vertices=body)
    assert not any("drawn in" in said for said in tracked_scene(slim, name="t").chosen)
    fat = body * [1.16, 1, 1.16]  # its surface then lies outside the cloth in places
    named = replace(slim, collider_vertices=fat, boundary=np.arange(24, dtype=np.int32))
    assert any("drawn in" in said for said in tracked_scene(named, name="t").chosen)


@pytest.mark.parametrize(
    ("changes", "driver", "said"),
    [
        ({"collider_vertices": None, "collider_faces": None}, "skinned", "ride on a body"),
        ({"base": {"densty": 3}}, "tracked", "densty"),
        ({"base": {"density": "heavy"}}, "tracked", "Give a number"),
        ({"vertices": np.full((8, 240, 3), np.nan)}, "tracked", "are absent"),
    ],
)
def test_what_cannot_be_is_refused_with_a_remedy(changes, driver, said):
    with pytest.raises(BadInput, match=said):
        tracked_scene(track(**changes), name="t", driver=driver)


def test_too_few_frames_and_a_driven_vertex_out_of_sight():
    at = track()
    x = at.vertices.copy()
    x[3, 0] = np.nan
    with pytest.raises(BadInput, match="driven vertex 0 is not known in frame 3"):
        tracked_scene(replace(at, vertices=x, boundary=np.array([0], np.int32)), name="t")
    x[:6, 5] = np.nan
    with pytest.raises(BadInput, match="2 frames from the first whole one"):
        tracked_scene(replace(at, vertices=x), name="t")


@pytest.mark.parametrize("frames", [0, 1])
def test_too_few_frames_are_asked_for(frames):
    """The file has enough."""
    with pytest.raises(
        BadInput, match=f"{frames + 1} frames from the first whole one on, as many as are asked for. Ask for at least 2 after"
    ):
        tracked_scene(track(), name="t", frames=frames)
    assert len(tracked_scene(track(), name="t", frames=2).scene.observed) == 3


def test_what_was_hardly_meant_is_said():
    assert not any(said.startswith("doubtful") for said in tracked_scene(track(), name="t").chosen)
    heavy = tracked_scene(track(base={"density": 0.2}), name="t").chosen
    assert any("fabric.density: 0.2 is outside 50 to 3000" in said for said in heavy)
