"""Files of one garment become recordings: those that teach, that are held out and that are blind in the same way."""

from dataclasses import replace

import numpy as np

from tasks.gap.garment_recordings import garment_recordings, recording
from tasks.geometry.rotations import matrix_from_axis_angle
from tests.cloth.test_boundary import swing
from tests.cloth.test_tracked_scene import track


def test_driven_nodes_move_alike_whatever_a_recording_is_for():
    x, _, body, _ = swing(24)
    noisy = x + np.random.default_rng(0).normal(scale=2e-3, size=x.shape)
    pins = np.arange(24, dtype=np.int32)
    file = track(
        vertices=noisy, observed=np.isfinite(noisy).all(2), collider_vertices=body, noise_m=np.full(x.shape[:2], 2e-3), boundary=pins
    )
    taught = garment_recordings([file], ["taught"])
    kept = recording(file, "kept", taught)
    unseen = noisy.copy()
    unseen[2:, 24:] = np.nan
    blind = recording(replace(file, vertices=unseen, observed=np.isfinite(unseen).all(2)), "blind", taught, blind=True)
    for other in (kept, blind):
        np.testing.assert_allclose(other.motion.boundary, taught.recordings[0].motion.boundary, atol=1e-12)
    assert np.abs(kept.motion.boundary - noisy[:, pins]).max() > 1e-3  # quieted at all


def turned(file, angle: float):
    """The same recording in a room that is turned about the vertical."""
    R = matrix_from_axis_angle(np.array([0.0, angle, 0.0]))
    return replace(file, vertices=file.vertices @ R.T, collider_vertices=file.collider_vertices @ R.T)


def test_a_border_keeps_the_noise_of_a_rest_shape_that_is_a_frame_as_tracked():
    """Taught from the file itself or, by a second file, in a room turned by a right angle."""
    x, _, body, _ = swing(24)
    noisy = x + np.random.default_rng(1).normal(scale=1e-3, size=x.shape)
    pins, noise = np.arange(24, dtype=np.int32), np.full(x.shape[:2], 1e-3)
    file = track(vertices=noisy, observed=np.ones(x.shape[:2], bool), collider_vertices=body, noise_m=noise, boundary=pins)
    made = garment_recordings([file, turned(file, np.pi / 2)], ["one", "other"])
    rest = np.linalg.norm(np.diff(made.model.subject.cloth.x_rest[pins], axis=0), axis=-1)
    for each in made.recordings:
        strain = np.linalg.norm(np.diff(each.motion.boundary, axis=1), axis=-1) / rest - 1
        assert np.sqrt(np.mean(strain**2)) < 1e-3
    cut = garment_recordings([replace(file, rest_vertices=x[0])], ["one"])
    assert np.abs(cut.recordings[0].motion.boundary[0] - noisy[0, pins]).max() > 1e-3


def test_what_was_not_observed_is_filled_and_then_counts_as_seen():
    """Zeros stand where a vertex was hidden, in the first frame too; driven nodes that the file gives are known though hidden."""
    at = track(boundary=np.arange(24, dtype=np.int32))
    x, seen = at.vertices.copy(), at.observed.copy()
    x[:3, 100], seen[:3, 100], seen[:, :24] = 0.0, False, False
    made = garment_recordings([replace(at, vertices=x, observed=seen)], ["t"])
    np.testing.assert_array_equal(made.model.subject.cloth.x_rest[100], at.vertices[3, 100])
    np.testing.assert_array_equal(made.model.subject.cloth.x_rest[:24], at.vertices[0, :24])
    assert len(made.recordings[0]) == 8 and np.isnan(made.recordings[0].observed[:3, 100]).all()
