"""The fit of the recorded sleeve, on swings that are linear in the parameters."""

import numpy as np
import pytest

from tests.real import sleeve_fit, sleeve_gap
from tests.real.sleeve_fit import (
    LEFT_OUT,
    OFFSET,
    SPREAD,
    TRAIN,
    UPRIGHT,
    fitted,
    held_out_mm,
    misfit,
    prior,
    residual,
    start,
    trajectories,
)
from tests.real.sleeve_recording import DOWN, folder

pytestmark = pytest.mark.skipif(not folder().is_dir(), reason=f"the recorded sleeve is not at {folder()}; set PHYSAVATAR_REAL_DATA")
TRUE = {"friction": 0.35, "delay": 0.004, "air_linear_drag": 1.2}


def linear(θ):
    """The recorded swings where θ is TRUE (elsewhere as it starts); each parameter moves every place by another wave."""
    found = {}
    for place, paths in trajectories(TRAIN).items():
        x = np.mean(paths, 0)
        t = np.linspace(0, 1, len(x))[:, None]
        waves = [np.sin(2 * np.pi * (k + 1) * t + place + np.arange(3)) for k in range(len(θ))]
        away = [(θ[n] - TRUE.get(n, prior(n)[0])) / prior(n)[1] for n in θ]
        found[place] = x + 5 * SPREAD * sum(a * w for a, w in zip(away, waves, strict=True))
    return found


def test_up_is_y():
    np.testing.assert_allclose(UPRIGHT @ -DOWN, [0, np.linalg.norm(DOWN), 0], atol=1e-12)
    np.testing.assert_allclose(UPRIGHT @ UPRIGHT.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(UPRIGHT) > 0


def test_a_fit_finds_parameters_and_strengths(monkeypatch):
    monkeypatch.setattr(sleeve_fit, "swing", linear)
    θ, places = fitted(start(["air_linear_drag"]), iterations=6)
    for name, value in TRUE.items():
        assert abs(θ[name] - value) < 0.05 * prior(name)[1]
    assert misfit(θ, places) < 0.02 * misfit(start(["air_linear_drag"]), linear(start(["air_linear_drag"])))


def test_what_a_fold_does_by_chance_is_no_step(monkeypatch):
    """Where no change of a parameter helps, the fit stays."""
    monkeypatch.setattr(sleeve_fit, "swing", lambda θ: linear({n: prior(n)[0] if n not in TRUE else TRUE[n] for n in θ}))
    before = start()
    assert fitted(before, iterations=3)[0] == before


def test_a_place_may_be_off_by_a_centimetre_and_its_motion_may_not():
    exact = {p: np.mean(v, 0) for p, v in trajectories(TRAIN).items()}
    (place, *_) = (p for p in exact if p not in LEFT_OUT)
    off = exact | {place: exact[place] + [OFFSET, 0, 0]}
    moving = exact | {place: exact[place] + OFFSET * np.sin(np.linspace(0, 40, len(exact[place])))[:, None] * [1, 0, 0]}
    θ = start()
    assert misfit(θ, exact) < 1e-12
    assert 0.9 < misfit(θ, off) < 1.1
    assert misfit(θ, moving) > 50
    raw, motion = held_out_mm(off)[place]
    assert raw > 8 and abs(motion - held_out_mm(exact)[place][1]) < 1e-9


def test_a_missing_strength_is_foretold_beside_the_base():
    θ = start()
    short = {n: v for n, v in TRUE.items() if n in θ}
    with_drag = {**θ, **short, "air_linear_drag": 0.0}
    at = linear(with_drag)
    probes = [{**θ, **short, n: {**θ, **short}[n] + 0.3 * prior(n)[1]} for n in θ]
    base = {**θ, **short}
    J = sleeve_gap.columns(base, at, [(p, linear({**p, "air_linear_drag": 0.0})) for p in probes])
    u = sleeve_gap.columns(base, at, [({**base, "air_linear_drag": 0.7}, linear({**base, "air_linear_drag": 0.7}))])[:, 0]
    strength, gain = sleeve_gap.foretold(base, at, J, u)
    assert abs(strength - TRUE["air_linear_drag"]) < 0.02
    assert 0.5 < gain / np.sum(residual(base, at) ** 2) <= 1.0


def test_closed_is_one_at_the_mean_trajectory():
    floor = float(np.mean([b for _, b in sleeve_gap.baselines().values()]))
    assert sleeve_gap.closed(5.0, floor) == 1.0 and sleeve_gap.closed(5.0, 5.0) == 0.0
