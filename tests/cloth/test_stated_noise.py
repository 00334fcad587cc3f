"""What a file says of its noise reaches fits and recordings alike, and what it cannot say of unseen vertices harms neither."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.stated_noise import NOISE_M, noise_of
from tasks.cloth.tracked_scene import tracked_scene
from tasks.gap.garment_recordings import garment_recordings
from tests.cloth.test_tracked_scene import track

HIDDEN = (slice(4, 6), 100)


def hidden(**noise):
    """Vertex 100 out of sight in two frames."""
    at = track()
    x, seen = at.vertices.copy(), at.observed.copy()
    x[HIDDEN], seen[HIDDEN] = np.nan, False
    pins = np.arange(24, dtype=np.int32)
    return replace(at, vertices=x, observed=seen, boundary=pins, collider_vertices=None, collider_faces=None, **noise)


def covariances(sd, unseen):
    C = np.broadcast_to(sd**2 * np.eye(3), (8, 240, 3, 3)).copy()
    C[HIDDEN] = unseen
    return C


def deviations(sd, unseen):
    σ = np.full((8, 240), sd)
    σ[HIDDEN] = unseen
    return σ


@pytest.mark.parametrize("unseen", [np.nan, 0.5])
@pytest.mark.parametrize(("key", "stated"), [("noise_cov", covariances), ("noise_m", deviations)])
def test_where_nothing_was_seen_the_noise_is_that_of_what_was(key, stated, unseen):
    file = hidden(**{key: stated(2e-3, unseen)})
    np.testing.assert_allclose(noise_of(file), 2e-3)
    np.testing.assert_allclose(tracked_scene(file, name="t").scene.noise_m, 2e-3)
    np.testing.assert_allclose(garment_recordings([file], ["t"]).recordings[0].noise, 2e-3)
    assert np.isfinite(tracked_scene(file, name="t").scene.boundary_motion).all()


def test_a_file_that_states_none_has_a_millimetre_and_one_that_states_zero_a_little():
    assert (noise_of(hidden()) == NOISE_M).all()
    assert (noise_of(hidden(noise_m=np.zeros((8, 240)))) == 1e-5).all()
    assert 0 < noise_of(hidden(noise_cov=np.zeros((8, 240, 3, 3)))).max() < 1e-5
