"""Windows that several workers share: what comes back as plain data is what was computed."""

from dataclasses import replace

import numpy as np

from tasks.cloth.nuisances import Prior
from tasks.cloth.numerics import offsets
from tasks.cloth.shooting import Job, follow
from tasks.cloth.state_modes import smooth_modes
from tasks.effects.library import library
from tasks.gap.gathered import gather, jobs, restated
from tasks.shared_map import SharedMap
from tests.cloth.test_windows import swung

EFFECTS = [library()[name] for name in ("air_normal_drag", "observation_smoothing")]


def test_states_and_evidence_are_the_same_to_the_last_bit(tmp_path):
    model, recording, *_ = swung(9, noise=1e-3)
    shared = SharedMap(tmp_path, lambda f, items: list(map(f, items)), 1)
    alone, together = gather(model, [recording], map), gather(model, [recording], shared)
    again = restated(model, together, shared)
    for a, b in zip((alone, alone), (together, again), strict=True):
        np.testing.assert_array_equal(a.states[0].x, b.states[0].x)
        np.testing.assert_array_equal(a.recordings[0].motion.boundary, b.recordings[0].motion.boundary)
    assert together.recordings[0].correlation == recording.correlation

    φ = smooth_modes(model.subject.cloth, 4)
    todo = jobs(model.joined(EFFECTS, {}), together, φ, columns=True, forced=True, prior=Prior(1e-3, 0.1))
    todo = [replace(job, offsets=_offsets(job)) for job in todo]
    for a, b in zip(map(follow, todo), shared(follow, todo), strict=True):
        assert a.normals.names == b.normals.names and a.prediction.window == b.prediction.window
        np.testing.assert_array_equal(a.normals.G, b.normals.G)
        np.testing.assert_array_equal(a.residual, b.residual)
        assert {n: c.tobytes() for n, c in a.prediction.columns.items()} == {n: c.tobytes() for n, c in b.prediction.columns.items()}


def _offsets(job: Job):
    return offsets(job, np.zeros((job.window.length + 1, *job.recording.observed.shape[1:])))
