"""Loose geometry becomes a scene: what the file holds is used, what it lacks is chosen and said, and what cannot be is refused."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tasks.capture.tracked_geometry import TrackedGeometry
from tasks.cloth.boundary import carried
from tasks.cloth.tracked_scene import tracked_scene
from tasks.geometry.faults import BadInput
from tasks.geometry.rotations import matrix_from_axis_angle
from tests.cloth.test_boundary import swing
from tests.simulator.scenes import sheet, sphere


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
    flat = np.stack([np.arange(len(x)) % 24 * 2 * np.pi / 24 * 0.11, x[:, 1]], 1)
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
        ({"base": {"density": -1}}, "tracked", r"t: base: fabric.density: -1\.0\. It must be above 0"),
        ({"base": {"membrane": 0}}, "tracked", r"t: base: fabric.membrane: 0\.0\. It must be above 0"),
        ({"base": {"bending": 0}}, "tracked", r"t: base: fabric.bending: 0\.0\. It must be above 0"),
        ({"boundary": np.arange(238, dtype=np.int32)}, "tracked", "t: boundary: 238 of 240 vertices are driven"),
        ({"vertices": np.full((8, 240, 3), np.nan)}, "tracked", "are absent"),
    ],
)
def test_what_cannot_be_is_refused_with_a_remedy(changes, driver, said):
    with pytest.raises(BadInput, match=said):
        tracked_scene(track(**changes), name="t", driver=driver)


def test_a_strip_that_is_all_border_has_nothing_to_compare():
    x, faces, *_ = swing(8, lag_m=0.0)
    strip = faces[(faces < 48).all(1)]
    ribbon = replace(track(), vertices=x[:, :48], faces=strip, observed=np.ones((8, 48), bool))
    with pytest.raises(BadInput, match="t: boundary: 48 of 48 vertices are driven"):
        tracked_scene(ribbon, name="t")


def test_too_few_frames_and_a_driven_vertex_out_of_sight():
    at = track()
    x = at.vertices.copy()
    x[3, 0] = np.nan
    with pytest.raises(BadInput, match="driven vertex 0 is not known in frame 3"):
        tracked_scene(replace(at, vertices=x, boundary=np.array([0], np.int32)), name="t")
    x[:6, 5] = np.nan
    with pytest.raises(BadInput, match="2 frames from the one to start from"):
        tracked_scene(replace(at, vertices=x), name="t")


@pytest.mark.parametrize("frames", [0, 1])
def test_too_few_frames_are_asked_for(frames):
    """The file has enough."""
    with pytest.raises(
        BadInput, match=f"{frames + 1} frames from the one to start from on, as many as are asked for. Ask for at least 2 after"
    ):
        tracked_scene(track(), name="t", frames=frames)
    assert len(tracked_scene(track(), name="t", frames=2).scene.observed) == 3


def test_what_was_hardly_meant_is_said():
    assert not any(said.startswith("doubtful") for said in tracked_scene(track(), name="t").chosen)
    heavy = tracked_scene(track(base={"density": 0.2}), name="t").chosen
    assert any("fabric.density: 0.2 is outside 50 to 3000" in said for said in heavy)


PINS = np.arange(24, dtype=np.int32)


def unseen(at: TrackedGeometry, where: tuple, *, place: float = np.nan) -> TrackedGeometry:
    """The same, not observed at (frames, vertices), where the file has this number."""
    x, seen = at.vertices.copy(), at.observed.copy()
    x[where], seen[where] = place, False
    return replace(at, vertices=x, observed=seen)


def test_a_number_that_stands_where_nothing_was_observed_is_not_taken_for_a_place():
    """Zeros give the scene that NaN gives, in the first frame as in later ones."""
    swung = track(vertices=swing(8, lag_m=0.008)[0])
    for where in ((slice(0, 2), 100), (slice(2, 5), 150), (slice(2, 7), slice(224, 240))):
        zeros, gaps = (tracked_scene(unseen(swung, where, place=p), name="t") for p in (0.0, np.nan))
        assert zeros.chosen == gaps.chosen
        for name in ("x0", "v0", "observed", "boundary_motion", "collider_motion"):
            np.testing.assert_array_equal(getattr(zeros.scene, name), getattr(gaps.scene, name))
        np.testing.assert_array_equal(zeros.scene.cloth.x_rest, gaps.scene.cloth.x_rest)
    never = unseen(swung, (slice(None), 100), place=0.0)
    with pytest.raises(BadInput, match="1 of 240 are never seen, the first is vertex 100"):
        tracked_scene(never, name="t")


def test_a_garment_that_is_hidden_somewhere_in_every_frame_starts_from_the_best_known_one():
    """Trackers that flag what the body hides never show all of it."""
    swung = track(vertices=swing(8, lag_m=0.008)[0])
    even, odd = slice(0, None, 2), slice(1, None, 2)
    hidden = unseen(unseen(swung, (even, slice(100, 102)), place=0.0), (odd, 150), place=0.0)
    found = tracked_scene(hidden, name="t")
    assert found.chosen[0] == (
        "frames 1 to 7 of 8; no frame shows the whole garment, and 1 vertices of the first were filled in from the frames around it"
    )
    np.testing.assert_allclose(found.scene.x0[150], (swung.vertices[0, 150] + swung.vertices[2, 150]) / 2)
    np.testing.assert_array_equal(np.delete(found.scene.x0, 150, 0), np.delete(swung.vertices[1], 150, 0))
    assert found.scene.compared[1:, 150].tolist() == [True, False] * 3


def test_nodes_that_the_file_drives_are_known_though_nobody_saw_them():
    at = track(boundary=PINS)
    hidden = replace(at, observed=at.observed & (np.arange(240) >= 24))
    np.testing.assert_array_equal(tracked_scene(hidden, name="t").scene.boundary_motion, tracked_scene(at, name="t").scene.boundary_motion)


def test_a_boundary_is_not_chosen_by_what_was_hardly_seen():
    """Only the first frame is whole: an inner vertex that is lost then says nothing of the borders, a hem that is lost cannot be judged."""
    swung = track(vertices=swing(8, lag_m=0.008)[0])
    assert tracked_scene(unseen(swung, (slice(1, 8), 100)), name="t").scene.cloth.boundary.tolist() == PINS.tolist()
    with pytest.raises(BadInput, match="t: boundary: names no node, and 1 borders near the collider are known in too few frames"):
        tracked_scene(unseen(swung, (slice(2, 8), slice(216, 240))), name="t")


def test_a_garment_without_a_border_flies_freely():
    ball, faces = sphere(1, 0.2)
    closed = track(vertices=np.stack([ball] * 8), faces=faces.astype(np.int32), observed=np.ones((8, len(ball)), bool))
    found = tracked_scene(closed, name="t")
    assert not len(found.scene.cloth.boundary) and "no border" in found.chosen[1]


def dipped(body, body_faces) -> TrackedGeometry:
    """A strip that is held at its end and lies 3 mm inside a body's top, at z = 0.1 m."""
    x, own = sheet(9, 9, length=0.3, width=0.1)
    strip = np.column_stack([x[:, [0, 2]] - [0.08, 0.05], np.full(len(x), 0.097)])
    still = [np.stack([a] * 3) for a in (strip, body)]
    seen, noise = np.ones((3, len(x)), bool), np.full((3, len(x)), 5e-4)
    pins = np.arange(3, dtype=np.int32)
    return TrackedGeometry(still[0], own, 25.0, seen, pins, collider_vertices=still[1], collider_faces=body_faces, noise_m=noise)


def test_every_piece_of_a_files_collider_stays():
    """A ball, and a smaller one beside it."""
    (large, faces), (small, more) = sphere(3, 0.1), sphere(2, 0.05)
    body = np.concatenate([large, small + np.array([0.15, 0, 0])])
    found = tracked_scene(dipped(body, np.concatenate([faces, more + len(large)]).astype(np.int32)), name="t")
    assert any("drawn in" in said for said in found.chosen)
    assert found.scene.collider_motion.shape == (3, len(body), 3) and len(found.scene.collider.faces) == len(faces) + len(more)


def test_a_files_collider_may_have_large_faces():
    box = trimesh.creation.box((0.8, 0.8, 0.2))
    found = tracked_scene(dipped(np.array(box.vertices), np.array(box.faces, np.int32)), name="t")
    assert any("drawn in" in said for said in found.chosen)
    assert len(found.scene.collider.faces) == 12


def test_a_collider_gives_way_where_the_garment_was_seen_though_some_of_it_was_not():
    ball, faces = sphere(3, 0.1)
    at = dipped(ball, faces.astype(np.int32))
    found = tracked_scene(unseen(at, (slice(1, 3), slice(40, 81))), name="t")
    assert any("drawn in by up to" in said for said in found.chosen)
    far = unseen(at, (slice(1, 3), slice(3, 40)))  # where it pokes through; seen in the first frame
    whole, gone = (tracked_scene(a, name="t").scene.collider_motion for a in (at, far))
    np.testing.assert_allclose(gone[2] - ball, (whole[0] - ball) / 4, atol=1e-12)


def test_a_first_frame_that_is_the_rest_shape_strains_no_border_with_its_noise():
    """With rest_vertices of its own the border is quieted all the same, and lies otherwise than in the first frame."""
    noisy = track(vertices=swing(8)[0] + np.random.default_rng(3).normal(scale=1e-3, size=(8, 240, 3)), noise_m=np.full((8, 240), 1e-3))
    worn, cut = (tracked_scene(replace(noisy, boundary=PINS, rest_vertices=rest), name="t").scene for rest in (None, swing(8)[0][0]))
    np.testing.assert_allclose(worn.boundary_motion[0], worn.cloth.x_rest[PINS], atol=1e-12)
    assert np.abs(cut.boundary_motion[0] - noisy.vertices[0, PINS]).max() > 1e-3
