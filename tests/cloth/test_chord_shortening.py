"""Chords of a bent sheet, and edges that noise makes longer."""

import numpy as np
import pytest

from tasks.cloth.chord_shortening import LEFT, chord_shortening
from tasks.cloth.start_state import States
from tasks.simulator import Cloth
from tests.simulator.scenes import sheet


def rolled(radius):
    """A sheet and the same sheet rolled up along its first axis, edges kept as chords of the cylinder."""
    x, faces = sheet(21, 3, length=0.4, width=0.04)
    long = int(np.argmax(np.ptp(x, axis=0)))
    thin = int(np.argmin(np.ptp(x, axis=0)))
    φ = x[:, long] / radius
    bent = x.copy()
    bent[:, long], bent[:, thin] = radius * np.sin(φ), radius * (1 - np.cos(φ))
    return Cloth(x, faces, np.empty(0, np.int32)), States(bent[None], np.zeros((1, *x.shape)), "converged")


def test_a_rolled_sheet_is_shorter_by_its_sagittas():
    """Edges along the roll are chords of φ = ℓ/R; they are a third of all hinges' turns at most, so the mean lies between a quarter and one of φ²/24."""
    cloth, walked = rolled(0.1)
    full = (0.02 / 0.1) ** 2 / 24
    assert 0.25 * full < chord_shortening(cloth, [walked], 0.0) < full
    _, tighter = rolled(0.05)
    ratio = chord_shortening(cloth, [tighter], 0.0) / chord_shortening(cloth, [walked], 0.0)
    assert ratio == pytest.approx(4, rel=0.05)


def test_noise_adds_its_share():
    cloth, walked = rolled(1e6)
    found = chord_shortening(cloth, [walked], 1e-3)
    assert 0.5 * LEFT * (1e-3 / 0.028) ** 2 < found < 2 * LEFT * (1e-3 / 0.02) ** 2
