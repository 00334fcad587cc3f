"""Nameless accelerations: absent at zero, with the derivative of a force that is there."""

from dataclasses import replace

import numpy as np

from tasks.cloth.forcing import FORCED, Forcing, SmoothForce
from tasks.cloth.likeliest_errors import estimated_prior
from tasks.cloth.shooting import Job, follow
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Window, predict
from tasks.effects.effect import Effect, Strength
from tests.cloth.test_windows import swung


class Pushed(Effect):
    """A smooth force that is really there."""

    name, kind, strengths = "pushed", "force", (Strength("a", "m/s2", 1.0, -9.0, 9.0),)

    def __init__(self, φ, axis):
        self.φ, self.axis = φ, axis

    def potentials(self, subject, θ):
        return (Push(subject.fabric.areal_density * subject.cloth.vertex_areas * self.φ * θ[0], self.axis),)


class Push(SmoothForce):
    """−f·x along one axis, f [V] N."""

    def __init__(self, f, axis):
        super().__init__(f, f[None], ())
        self.f = np.zeros((len(f), 3))
        self.f[:, axis] = f

    def energy(self, x, step):
        return -float(np.sum(self.f * x))

    def gradient(self, x, step):
        return -self.f


def test_columns_are_the_derivatives_by_a_force():
    model, recording, x, v = swung(12)
    φ = smooth_modes(model.subject.cloth, 6)
    window, start = Window(0, 4, 5), States(x, v, "converged")
    plain = predict(model, recording, window, start)
    found = predict(model, recording, window, start, φ=φ, forced=True)
    np.testing.assert_array_equal(found.x, plain.x)
    assert sum(name.startswith("a ") for name in found.columns) == 3 * min(len(φ), FORCED)
    for name, mode, axis in (("a 0 y", 0, 1), ("a 2 x", 2, 0)):
        e = 1e-2
        sides = [
            predict(replace(model, effects=(Pushed(φ[mode], axis),), strengths={"pushed": np.array([s])}), recording, window, start).x
            for s in (e, -e)
        ]
        slope = (sides[0] - sides[1])[1:] / (2 * e)
        assert np.linalg.norm(found.columns[name] - slope) < 1e-3 * np.linalg.norm(slope)


def test_a_push_other_in_every_window_is_estimated_at_its_size():
    """Accelerations of 2 m/s² in a smooth mode, another sign in every window, and none: σ_a says so."""
    model, recording, x, v = swung(25, noise=5e-4)
    φ = smooth_modes(model.subject.cloth, 6)
    start = States(x, v, "converged")
    for size, low, high in ((0.0, 0.0, 0.11), (2.0, 0.3, 3.1)):
        evidence = []
        for k, first in enumerate(range(0, 20, 5)):
            window = Window(0, first, 5)
            pushed = replace(model, effects=(Pushed(φ[k % 3], k % 3),), strengths={"pushed": np.array([size * (-1) ** k])})
            own = predict(pushed, recording, window, start).x + recording.observed[window.frames] - x[window.frames]
            observed = recording.observed.copy()
            observed[window.frames] = own
            evidence.append(follow(Job(model, replace(recording, observed=observed), window, start, φ, forced=True)))
        assert low <= estimated_prior(evidence, 5e-4).a <= high
    assert estimated_prior([follow(Job(model, recording, Window(0, 0, 5), start, φ))], 5e-4).a == 0.0


def test_a_forcing_has_three_columns_per_mode():
    assert Forcing(np.ones((2, 5))).columns == ("a 0 x", "a 0 y", "a 0 z", "a 1 x", "a 1 y", "a 1 z")
