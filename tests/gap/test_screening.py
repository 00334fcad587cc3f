"""What computing otherwise changes is told about the states themselves, wherever derivatives are then taken."""

import numpy as np

from tasks.cloth.numerics import MESH, offsets
from tasks.cloth.shooting import Job, follow
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Window
from tasks.gap.screening import _otherwise
from tests.cloth.test_windows import swung


def test_a_start_that_was_moved_has_no_part_in_what_another_mesh_does():
    model, recording, x, v = swung(12)
    φ = smooth_modes(model.subject.cloth, 6)
    off = States(x + 1e-3 * φ[0][:, None], v, "converged")
    job = Job(model, recording, Window(0, 4, 4), off, φ)
    found = follow(job)
    start, changed = _otherwise((job, found))
    assert start and max(map(abs, start.values())) > 1e-5
    expected = offsets(job, found.prediction.x, (MESH,))
    np.testing.assert_array_equal(changed[MESH.name], expected[MESH.name])
    assert np.abs(changed[MESH.name]).max() > 1e-6
