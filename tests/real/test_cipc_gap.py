"""The way C-IPC's recordings go, gone by one in which nothing is missing: that a diagnosis of them arrives."""

import pytest

from tasks.cloth.start_state import States
from tasks.cloth.windows import windows
from tasks.effects.library import library
from tasks.gap.gathered import Gathered
from tests.cloth.test_windows import FPS, swung
from tests.real.cipc_gap import NOISE, diagnosed


@pytest.mark.timeout(300)
def test_a_recording_of_the_base_model_lacks_nothing():
    """Its fabric is known, its velocities are the model's own, and its last windows are kept out."""
    model, recording, _, v = swung(31, noise=NOISE)
    data = Gathered((recording,), (States(recording.observed, v, "converged"),), tuple(windows([recording], FPS)))
    effects = [library()[name] for name in ("air_normal_drag", "fabric_mass_damping", "observation_delay")]
    said = diagnosed(model, data, effects, map)
    assert said.verdict.kind == "none" and said.gap.held_out
