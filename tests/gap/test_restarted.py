"""What a model whose effects move something must find anew before its windows start."""

import numpy as np
import pytest

from tasks.cloth.start_state import States
from tasks.effects.library import library
from tasks.gap import gathered
from tests.cloth import test_yielded_collider

limbs = test_yielded_collider.limbs


@pytest.mark.parametrize(
    ("name", "θ", "drawn", "anew"),
    [("fabric_hem_mass", 0.1, 0, 0), ("observation_smoothing", 1e-3, 0, 2), ("body_offset", 2e-3, 2, 2)],
)
def test_only_what_moves_the_body_lets_it_give_way_again(limbs, monkeypatch, name, θ, drawn, anew) -> None:
    """A fabric changes neither body nor states; a smoothing tracker where the driven nodes were, but not the body."""
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
