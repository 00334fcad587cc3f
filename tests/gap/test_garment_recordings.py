"""Files of one garment become recordings: those that teach, that are held out and that are blind in the same way."""

from dataclasses import replace

import numpy as np

from tasks.gap.garment_recordings import garment_recordings, recording
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
