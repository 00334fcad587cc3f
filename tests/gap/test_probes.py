"""Effects simulated at a strength that shows: the one that was left out comes nearest, and where nothing was, nobody does."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.base_refit import BaseFit
from tasks.cloth.nuisances import Prior, without_state
from tasks.cloth.shooting import follow
from tasks.cloth.start_state import states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import marginalised, normals, predict, windows
from tasks.effects.library import library
from tasks.gap import probes
from tasks.gap.gathered import Gathered, jobs
from tasks.gap.probes import FEW, PROBED, STARTING, Probe, at_rest, probed
from tasks.gap.strength_priors import BASE_SPREAD
from tests.cloth.test_windows import FPS, swung

NOISE = 1e-3
NAMES = ("air_normal_drag", "fabric_bending_damping", "fabric_density_gradient", "body_lag")
EFFECTS = tuple(library()[name] for name in NAMES)


def fitted(model, data):
    """A fit that found the model."""
    evidence = tuple(map(follow, jobs(model, data, smooth_modes(model.subject.cloth, STARTING))))
    return BaseFit(model, np.eye(2), Prior(NOISE, 0.03), evidence, (), "converged")


@pytest.fixture(scope="module")
def panels():
    """A panel that swings, and what its model finds of it alone, and of it with drag that it does not know; model -> the screening, the windows."""
    model, recording, x, v = swung(31, noise=NOISE)
    drag = EFFECTS[0]
    dragged = replace(model, effects=(drag,), strengths={drag.name: np.array([20.0])})
    y = np.stack([f.x for f in dragged.run(recording.motion, x[0], v[0])])
    slowed = replace(recording, observed=y + NOISE * np.random.default_rng(1).standard_normal(y.shape))
    each = [Gathered((r,), (states(model, r.motion, r.observed, NOISE),), tuple(windows([r], FPS))) for r in (recording, slowed)]
    return [(fitted(model, data), data) for data in each]


def test_what_was_left_out_comes_to_rest_where_it_was_with_the_base(panels):
    _, (found, data) = panels
    nearest, *_ = probed(found, data, EFFECTS, frozenset(), map)
    assert nearest.effect.name == "air_normal_drag"
    model = at_rest(found, data, nearest, map)
    assert model.strength(EFFECTS[0]) == pytest.approx(20.0, rel=0.1)
    fabric = found.model.subject.fabric
    assert 0.3 < model.subject.fabric.bending / fabric.bending < 3 and model.subject.fabric != fabric


def test_beside_a_leader_the_strengths_of_both_come_to_rest(panels):
    """Where both were, from others: the leader's is fitted again."""
    _, (found, data) = panels
    drag, damping = EFFECTS[:2]
    (recording,), (walked,) = data.recordings, data.states
    truth = replace(found.model, effects=(drag, damping), strengths={drag.name: np.array([20.0]), damping.name: np.array([0.03])})
    y = np.stack([f.x for f in truth.run(recording.motion, walked.x[0], walked.v[0])])
    both = replace(recording, observed=y + NOISE * np.random.default_rng(2).standard_normal(y.shape))
    data = replace(data, recordings=(both,), states=(states(found.model, both.motion, both.observed, NOISE),))
    leading = replace(found.model, effects=(damping,), strengths={damping.name: np.array([0.06])})
    model = at_rest(fitted(leading, data), data, Probe(drag, np.array([10.0]), 1.0), map)
    assert model.strength(drag) == pytest.approx(20.0, rel=0.1)
    assert model.strength(damping) == pytest.approx(0.03, rel=0.3)


def test_of_twins_one_is_proposed(panels, monkeypatch):
    _, (found, data) = panels
    monkeypatch.setattr(probes, "_nearer", lambda job, base, found, prior: np.array([3.0, 2.0, 1.0, 0.0, 0.0, 0.0]))
    twins = frozenset({frozenset(NAMES[:2])})
    for alike, proposed in ((frozenset(), NAMES[:3]), (twins, NAMES[0:3:2])):
        assert [probe.effect.name for probe in probed(found, data, EFFECTS, alike, map)] == [*proposed]


def test_where_nothing_is_missing_nothing_is_proposed(panels):
    (found, data), _ = panels
    assert probed(found, data, EFFECTS, frozenset(), map) == []


def test_only_the_worst_windows_are_simulated_with_what_moves_cloth_either_way(panels, monkeypatch):
    (found, data), _ = panels
    asked = []
    monkeypatch.setattr(probes, "_predicted", lambda job: asked.append((job.window, *job.model.strengths.items())))
    assert probed(found, data, EFFECTS, frozenset(), map) == []  # none could be simulated
    worst = sorted(found.evidence, key=lambda e: -without_state(e.normals, found.prior).c / e.normals.n)[:FEW]
    assert [w for w, *_ in asked] == [e.prediction.window for e in worst for _ in range(6)]
    moving = (*EFFECTS[:3], EFFECTS[2], EFFECTS[3], EFFECTS[3])
    assert [(name, float(*θ)) for _, (name, θ) in asked[:6]] == [
        (e.name, sign * PROBED * e.strengths[0].typical) for e, sign in zip(moving, (1, 1, 1, -1, 1, -1))
    ]


def test_a_probe_is_as_near_as_its_own_normal_equations_say(panels):
    """One column of coefficient one, against the window weighed anew."""
    _, (found, data) = panels
    model, prior = found.model, found.prior
    job = jobs(model, data, smooth_modes(model.subject.cloth, STARTING))[2]
    base = probes._followed(job)
    other = predict(model.joined([EFFECTS[0]], {NAMES[0]: np.array([16.0])}), job.recording, job.window, job.states).x
    nearer = probes._nearer(job, base, [other, None], prior)

    def misfit(x):
        n = normals(replace(base, x=x), job.recording, model.subject)
        z = [name for name in n.names if name not in PARAMETERS]
        return marginalised(n, [*z, *PARAMETERS], np.array([*prior.variances(z), *[BASE_SPREAD**2] * 2])).c

    assert nearer[0] == pytest.approx(np.log(misfit(base.x) / misfit(other)), rel=1e-6) and abs(nearer[0]) > 0.05
    assert nearer[1] == -np.inf
