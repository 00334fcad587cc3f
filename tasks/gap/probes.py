"""Probes: effects simulated at a strength that shows, for what derivatives at strength zero do not tell.

What a strong cause does is not what its derivative foretells: what rings without damping is gone with it, and the derivative about the
ringing says nothing of that; to cloth five times softer one way than the other an isotropic base fits the mean, and the slope there may
point nowhere; air that weighs five times what the cloth does makes it another fabric; a body that is three frames late strikes cloth that
it is not beside now. So what acts through forces or moves what drives the cloth is simulated at `PROBED` typical strengths, either way where
it has two, in the `FEW` windows that the base (or the leading cause, for a second one beside it) misfits most, and ranks by

    ⟨log(J_w/J_w^base)⟩_w        J_w: misfit with start and base parameters marginalised by the base's derivatives; the mean of logarithms, for a window
                                 that kinks would outvote the others

From where the best are, base and strength are fitted together in all windows (`cloth/joint_refit.py`); there they are simulated and weighed
as all others are (`trials.py`): a probe proposes, and is no evidence.

Source: the logarithm of a sum of squares is the log likelihood where its scale is unknown. Limits: one strength either way, of each
component alone; from the base's states, which a body in another place has to push aside.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.base_refit import BaseFit
from tasks.cloth.joint_refit import refit_jointly
from tasks.cloth.nuisances import Prior, state_names, without_state
from tasks.cloth.shooting import Job, Map
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Prediction, marginalised, normals, predict
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, jobs
from tasks.gap.strength_priors import BASE_SPREAD
from tasks.gap.verdict import Twins, told_apart

Array = NDArray[np.float64]

PROBED = 2.0  # typical strengths
FEW = 3  # windows
STARTING = 12  # modes of their starts
ITERATIONS = 5  # of the fit of base and strength together
NEARER = 0.04  # mean logarithm of J_w^base/J_w from which one is


@dataclass(frozen=True)
class Probe:
    """An effect at strengths [K], and how much nearer it comes: the mean logarithm above."""

    effect: Effect
    strengths: Array
    nearer: float


def probed(about: BaseFit, data: Gathered, effects: Sequence[Effect], alike: Twins, run: Map) -> list[Probe]:
    """Those of these effects that come nearer than a fit on windows of `data`, the nearest first, of twins one."""
    worst = sorted(about.evidence, key=lambda e: -without_state(e.normals, about.prior).c / e.normals.n)[:FEW]
    todo = _jobs(about.model, data.only(e.prediction.window for e in worst))
    asked = list(_strengths(effects))
    base = list(run(_followed, todo))
    found = list(run(_predicted, [replace(job, model=about.model.joined([e], {e.name: θ})) for job in todo for e, θ in asked]))
    each = [found[k : k + len(asked)] for k in range(0, len(found), len(asked))]
    nearer = np.mean([_nearer(job, b, own, about.prior) for job, b, own in zip(todo, base, each, strict=True)], 0)
    chosen: list[Probe] = []
    for k in np.argsort(-nearer):
        effect, θ = asked[k]
        if nearer[k] > NEARER and told_apart(effect.name, (other.effect.name for other in chosen), alike):
            chosen.append(Probe(effect, θ, float(nearer[k])))
    return chosen


def at_rest(about: BaseFit, data: Gathered, probe: Probe, run: Map) -> Model:
    """The model where fabric and all strengths come to rest from there."""
    effect = probe.effect
    model = about.model.joined([], {effect.name: probe.strengths})
    plain = _jobs(model, data.only(e.prediction.window for e in about.evidence))
    todo = [replace(job, offsets=e.offsets) for job, e in zip(plain, about.evidence, strict=True)]
    effects = (*model.effects, effect)  # with what the fit has already
    return refit_jointly(replace(about, model=model), todo, effects, noise=data.noise, iterations=ITERATIONS, run=run).model


def _jobs(model: Model, data: Gathered) -> list[Job]:
    """One per window, with few modes of its start."""
    return [replace(job, recording=job.recording.forgetful) for job in jobs(model, data, smooth_modes(model.subject.cloth, STARTING))]


def _strengths(effects: Sequence[Effect]) -> Iterator[tuple[Effect, Array]]:
    """Each component of each effect that moves cloth by itself: up and, where it may be negative, down."""
    for effect in effects:
        for i, s in enumerate(effect.strengths if effect.acts_through & {"potentials", "fabric", "motion"} else ()):
            for sign in (1.0, -1.0) if s.low < 0 else (1.0,):
                θ = np.zeros(len(effect.strengths))
                θ[i] = np.clip(sign * PROBED * s.typical, s.low, s.high)
                yield effect, θ


def _followed(job: Job) -> Prediction:
    return predict(job.model, job.recording, job.window, job.states, parameters=PARAMETERS, φ=job.φ)


def _predicted(job: Job) -> Array | None:
    """x [L + 1, V, 3] m; None where the simulation fails."""
    found = predict(job.model, job.recording, job.window, job.states)
    return found.x if found.complete else None


def _nearer(job: Job, base: Prediction, found: Sequence[Array | None], prior: Prior) -> Array:
    """log(J_w^base/J_w) of each probe [N] of a window; −∞ where there is none. Each enters the base's normal equations as a column of coefficient one."""
    probes = {f"probe {k}": (x - base.x)[1:] for k, x in enumerate(found) if x is not None}
    n = normals(replace(base, columns={**base.columns, **probes}), job.recording, job.model.subject)
    z = state_names(n.names)
    n = marginalised(n, [*z, *PARAMETERS], np.concatenate([prior.variances(z), np.full(len(PARAMETERS), BASE_SPREAD**2)]))
    J = {name: n.c - 2 * n.g[i] + n.G[i, i] for i, name in enumerate(n.names)}
    names = [f"probe {k}" for k in range(len(found))]
    return np.array([np.log(n.c / J[name]) if name in J else -np.inf for name in names])
