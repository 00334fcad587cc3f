"""What a model whose effects move something must find anew before its windows start."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.start_state import States
from tasks.effects.library import library
from tasks.gap import gathered, refits
from tests.cloth import test_yielded_collider

limbs = test_yielded_collider.limbs


@pytest.mark.parametrize(
    ("name", "θ", "drawn", "anew"),
    [
        ("fabric_hem_mass", 0.1, 0, 0),
        ("fabric_rest_scale", 0.02, 0, 2),
        ("contact_friction", 0.3, 0, 0),
        ("observation_smoothing", 1e-3, 0, 2),
        ("body_offset", 2e-3, 2, 2),
    ],
)
def test_only_what_moves_the_body_lets_it_give_way_again(limbs, monkeypatch, name, θ, drawn, anew) -> None:
    """Mass and friction change neither body nor states; the lengths that cloth was cut to, and a smoothing tracker, states but not the body."""
    model, recording = limbs
    asked = {"drawn": 0, "anew": 0}

    def draw(r, m):
        asked["drawn"] += 1
        return r

    def restate(job):
        asked["anew"] += 1
        return States(recording.observed, recording.observed, "converged")

    monkeypatch.setattr(gathered, "with_yielded_collider", draw)
    monkeypatch.setattr(gathered, "_restate", restate)
    known = States(recording.observed, recording.observed, "converged")
    data = gathered.Gathered((recording, recording), (known, known), ())
    effect = library()[name]
    gathered.restarted(model.joined([effect], {name: np.full(len(effect.strengths), θ)}), data)
    assert asked == {"drawn": drawn, "anew": anew}


@pytest.mark.parametrize(
    ("name", "φ", "times"), [("fabric_hem_mass", np.ones(1), 0), ("body_offset", np.ones(1), 1), ("body_offset", None, 0)]
)
def test_windows_before_a_body_in_another_place_start_without_wrinkles_too(limbs, monkeypatch, name, φ, times) -> None:
    model, recording = limbs
    known, asked = States(recording.observed, recording.observed, "converged"), []
    monkeypatch.setattr(gathered, "_anew", lambda job: (job[1], known))
    monkeypatch.setattr(gathered, "unwrinkled", lambda model, data, φ, run: asked.append(φ) or data)
    data = gathered.Gathered((recording,), (known,), ())
    effect = library()[name]
    gathered.restarted(model.joined([effect], {name: np.full(len(effect.strengths), 2e-3)}), data, map, φ)
    assert asked == [φ] * times


@pytest.mark.parametrize("name", ["fabric_hem_mass", "body_offset"])
def test_every_model_asks_for_corrections_of_its_own(limbs, monkeypatch, name) -> None:
    """From starts that the base had asked for, a scale of 1.4 % weighed less the nearer its simulation came to it."""
    model, recording = limbs
    states, effect = States(recording.observed, recording.observed, "converged"), library()[name]
    window = SimpleNamespace(recording=0, start=0, length=2)
    monkeypatch.setattr(gathered, "_anew", lambda job: (job[1], states))
    monkeypatch.setattr(gathered, "unwrinkled", lambda model, data, φ, run: data)
    monkeypatch.setattr(refits, "follow_nearer", lambda job: (dict(job.start), job.offsets, job.columns and job.forced))
    before = [SimpleNamespace(prediction=SimpleNamespace(window=window), offsets={"mesh": 1.0}, start={"x 0 x": 0.01})]
    screened = SimpleNamespace(base=SimpleNamespace(prior=None))
    changed = model.joined([effect], {name: np.full(len(effect.strengths), 2e-3)})
    data = gathered.Gathered((recording,), (states,), (window,))
    assert refits._simulated(changed, screened, data, before, map) == (({}, {"mesh": 1.0}, True),)
