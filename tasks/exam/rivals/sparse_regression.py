"""Sparse regression on smoothed accelerations: which terms of the library add up to the acceleration that the base model lacks (SINDy).

    ÿ − a(y, ẏ) = Σ_j θ_j ∂a/∂θ_j(y, ẏ) + ε,      sequentially thresholded least squares,      weight of a set of names: its share of the bags

y: the recording as a smooth motion of cloth (`cloth/start_state.py`), its derivatives by local polynomials; a and its derivatives from one
frame of simulation from (y, ẏ). The threshold rises until no more effects are left than an answer may name; bags are of frames. What it is
not: nothing integrates, so errors of y enter the forces of stiff cloth; a tracker's fault is seen only as far as it shows within one frame;
strengths are unbounded while they are sought.

Source: Brunton, Proctor & Kutz 2016 (SINDy); Fasel et al. 2022 (bagging); PySINDy (Kaptanoglu et al. 2022).
"""

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.start_state import States, derivative
from tasks.cloth.windows import Recording, Window, predict
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.exam.rivals.linear_fit import applied, by_effect, column_names, typical
from tasks.exam.rivals.rival import NONE, Array, Case, Names, Reply, Rival

EVERY = 2  # frames
EDGE = 2  # frames at either end, whose derivatives are extrapolated
ALONG = np.array([2, 1]) / 3  # weights of the accelerations at both ends of a frame in 2(x₁ − x₀ − v₀Δt)/Δt²
THRESHOLDS = 0.1 * 2.0 ** np.arange(0, 6, 0.5)  # of a coefficient, in typical strengths
RIDGE = 1e-3  # [m²/s⁴] penalty on a coefficient of one typical strength
BAGS = 20
MOST = 4  # names: an answer with more counts as none


@dataclass(frozen=True)
class Frame:
    """What the base model lacks [V, 3] m/s² in a frame, and what every column at typical strength would add [V, 3, P] m/s²."""

    missing: Array
    terms: Array


def sparse_regression(case: Case) -> Reply:
    """The set of names that most bags agree on."""
    data, base = case.refitted
    effects, model = case.effects, replace(base.model, effects=case.effects)
    jobs = [(model, r, s, Window(k, t, 1)) for k, (r, s) in enumerate(zip(data.recordings, data.states, strict=True)) for t in _times(s)]
    frames = [frame for frame in case.run(frame_of, jobs) if frame is not None]
    free = np.setdiff1d(np.arange(len(model.subject.cloth.x_rest)), model.subject.cloth.boundary)
    found = bags(frames, free, effects)
    sets = [named(u, effects) for u in found]
    shares = Counter(sets)
    best = shares.most_common(1)[0][0]
    u = np.mean([u for u, names in zip(found, sets, strict=True) if names == best], 0)
    kept = [e for e in effects if e.name in best]
    θ = by_effect(u * typical(effects), effects)
    strengths = {e.name: np.clip(θ[e.name], [s.low for s in e.strengths], [s.high for s in e.strengths]) for e in kept}
    p = len(PARAMETERS)
    return Reply(
        {names or NONE: float(np.log(count)) for names, count in shares.items()},
        before=base.model,
        after=applied(base.model, kept, u[:p], strengths),
        vertex_accel=np.sqrt(np.mean([np.sum((frame.terms[..., p:] @ u[p:]) ** 2, 1) for frame in frames], 0)) if kept else None,
    )


def frame_of(job: tuple[Model, Recording, States, Window]) -> Frame | None:
    """The frame after a window's start; None where the simulation does not reach it."""
    model, recording, states, window = job
    found = predict(model, recording, window, states, parameters=PARAMETERS, columns=True)
    if not found.complete:
        return None
    t, fps = window.start, model.subject.fps
    a = np.einsum("f,fvi->vi", ALONG, derivative(states.x, fps, 2)[t : t + 2])
    simulated = 2 * fps**2 * (found.x[1] - states.x[t] - states.v[t] / fps)
    columns = np.stack([found.columns[name][0] for name in column_names(model.effects)], -1)
    return Frame(a - simulated, 2 * fps**2 * columns * typical(model.effects))


def bags(frames: Sequence[Frame], free: NDArray[np.int64], effects: Sequence[Effect]) -> list[Array]:
    """Coefficients [P] in typical strengths, from `BAGS` draws of the frames with replacement; all with the threshold that the whole asks for."""
    A, b = np.stack([f.terms[free] for f in frames]), np.stack([f.missing[free] for f in frames])  # [n, V, 3, P], [n, V, 3]
    λ = next((λ for λ in THRESHOLDS if len(named(_thresholded(A, b, λ), effects)) <= MOST), THRESHOLDS[-1])
    draws = np.random.default_rng(0).integers(len(frames), size=(BAGS, len(frames)))
    return [_thresholded(A[draw], b[draw], λ) for draw in draws]


def _thresholded(A: Array, b: Array, λ: float) -> Array:
    """Sequentially thresholded least squares; a term that stays is fitted without penalty."""
    from pysindy.optimizers import STLSQ

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that nothing is left is an answer
        return STLSQ(threshold=λ, alpha=RIDGE * b.size).fit(A.reshape(b.size, -1), b.reshape(-1, 1)).coef_[0]


def named(u: Array, effects: Sequence[Effect]) -> Names:
    """Effects of which any strength is left."""
    return tuple(name for name, own in by_effect(u, effects).items() if own.any())


def _times(states: States) -> range:
    return range(EDGE, len(states.x) - EDGE, EVERY)


RIVAL = Rival(
    "sparse_regression",
    "adds up the missing acceleration, frame by frame, from as few effects as possible",
    "Brunton, Proctor & Kutz 2016, SINDy (PySINDy's thresholded least squares)",
    sparse_regression,
    slow=True,
    needs="pysindy",
    refits=True,
)
