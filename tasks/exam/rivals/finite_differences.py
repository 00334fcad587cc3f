"""Finite differences and AIC stepwise: whole recordings simulated from their first state, once per parameter, and terms added while AIC
falls.

    S_j = (x(θ + δ_j e_j) − x(θ))/δ_j,      AIC = n log(RSS/n) + 2k,      weight of a model ∝ exp(−½ AIC)

Terms are chosen in the linear model; each model on the way is then simulated, and weighed by the RSS that it has.
What it is: the textbook way, with the same simulator, base and library. What it is not: no windows (over a second cloth is chaotic, and so
are the differences), no uncertain start, no numerics, no recording kept out. A parameter whose simulation does not get as far as the base
is left out.

Source: Akaike 1974; Efroymson 1960 (stepwise regression); weights as in Burnham & Anderson 2002, § 2.9.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tasks.cloth.base_parameters import PARAMETERS, moved, with_fabric
from tasks.cloth.shooting import Map
from tasks.cloth.start_state import FRAMES, States, derivative, states
from tasks.cloth.windows import Recording, Window, predict
from tasks.cloth.yielded_collider import with_yielded_collider
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.exam.rivals.linear_fit import Fit, applied, column_names, fit
from tasks.exam.rivals.rival import NONE, Array, Case, Reply, Rival

STEP = 0.1  # δ of a strength, in typical strengths
LOG_STEP = 0.05  # δ of a base parameter's logarithm
MOST = 4  # names: an answer with more counts as none
Started = tuple[Recording, States]  # its collider drawn in once, for simulations that are subtracted must meet the same body


@dataclass(frozen=True)
class Differences:
    """Whitened residual r [n] of a model and its derivatives S [n, P]; fields: column -> derivative [T, V, 3] m of the first recording."""

    r: Array
    S: Array
    fields: dict[str, Array]

    @property
    def rss(self) -> float:
        """Sum of squares."""
        return float(self.r @ self.r)

    def aic(self, found: Fit) -> float:
        """Of a fit to these."""
        return aic(self.rss - found.gain, len(self.r), found)

    def fit(self, among: Sequence[Effect], effects: Sequence[Effect]) -> Fit:
        """Some effects, least squares."""
        return fit(self.S.T @ self.S, self.S.T @ self.r, among, effects)


def finite_differences(case: Case) -> Reply:
    """The model at which stepwise selection stops."""
    base = case.refitted[1].model
    started = list(case.run(_started, [(base, recording) for recording in case.recordings]))
    found = differences(base, started, case.effects, case.run)
    path = stepwise(partial(found.fit, case.effects), case.effects, found.aic)
    models = [base, *(applied(base, f.effects, f.base, f.strengths) for f in path[1:])]
    misfits = [_rss(r, len(found.r)) for r in residuals(models, started, case.run)]
    simulated = [aic(rss, len(found.r), f) for rss, f in zip(misfits, path, strict=True)]
    k = int(np.argmin(simulated))
    σ = np.sqrt(misfits[k] / len(found.r))
    return Reply(
        {f.names or NONE: -a / 2 for f, a in zip(path, simulated, strict=True)},
        before=base,
        after=models[k],
        deviation={name: σ * sd for name, sd in path[k].deviation.items()},
        vertex_accel=_added(found, path[k], case.model.subject.fps),
    )


def aic(rss: float, n: int, of: Fit) -> float:
    """Akaike's criterion of a fit with this residual sum of squares over n coordinates."""
    return float(n * np.log(rss / n) + 2 * len(column_names(of.effects)))


def stepwise(fits: Callable[[tuple[Effect, ...]], Fit], effects: Sequence[Effect], criterion: Callable[[Fit], float]) -> list[Fit]:
    """From nothing, always the effect that lowers the criterion most, until none does."""
    path = [fits(())]
    while len(path) <= min(MOST, len(effects)):
        now = path[-1]
        best = min((fits((*now.effects, e)) for e in effects if e not in now.effects), key=criterion)
        if criterion(best) >= criterion(now):
            break
        path.append(best)
    return path


def differences(model: Model, started: Sequence[Started], effects: Sequence[Effect], run: Map = map) -> Differences:
    """Forward differences in the base parameters and in every strength."""
    beside = list(_neighbours(model, effects))
    here, *there = _motions([model, *(m for m, _ in beside)], started, run)
    slopes = [[_slope(a, b, δ) for a, b in zip(here, own, strict=True)] for own, (_, δ) in zip(there, beside, strict=True)]
    S = np.stack([_compared(started, own, model) for own in slopes], 1)
    return Differences(_residual(started, here, model), S, {c: own[0] for c, own in zip(column_names(effects), slopes, strict=True)})


def residuals(models: Sequence[Model], started: Sequence[Started], run: Map = map) -> list[Array]:
    """Whitened residual [n] of every model; shorter where a simulation ends early."""
    return [_residual(started, x, model) for x, model in zip(_motions(models, started, run), models, strict=True)]


def _rss(r: Array, n: int) -> float:
    """Sum of squares; infinite where not all n coordinates were reached."""
    return float(r @ r) if len(r) == n else np.inf


def _motions(models: Sequence[Model], started: Sequence[Started], run: Map) -> list[list[Array]]:
    """x [T, V, 3] m of every model in every recording."""
    found, count = list(run(_motion, [(m, *start) for m in models for start in started])), len(started)
    return [found[k : k + count] for k in range(0, len(found), count)]


def _started(job: tuple[Model, Recording]) -> Started:
    model, recording = job
    recording = with_yielded_collider(recording, model)
    first = recording.cut(slice(0, FRAMES))
    return recording, states(recording.scene(model), first.motion.given_way, first.observed, float(np.median(first.noise)))


def _motion(job: tuple[Model, Recording, States]) -> Array:
    """A whole recording [T, V, 3] m simulated from its first state; fewer frames where the simulation ends early."""
    model, recording, first = job
    return predict(model, recording, Window(0, 0, len(recording) - 1), first).x


def _slope(a: Array, b: Array, δ: float) -> Array:
    """Nothing where the second simulation ended before the first."""
    return (b[: len(a)] - a) / δ if len(b) >= len(a) else np.zeros_like(a)


def _neighbours(model: Model, effects: Sequence[Effect]) -> list[tuple[Model, float]]:
    """One model per column, and by how much it differs."""
    logarithms = [with_fabric(model, moved(model.subject.fabric, LOG_STEP * e)[0]) for e in np.eye(len(PARAMETERS))]
    found = [(m, LOG_STEP) for m in logarithms]
    for effect in effects:
        for k, δ in enumerate(STEP * effect.typical):
            θ = δ * np.eye(len(effect.strengths))[k]
            found.append((replace(model, effects=(effect,), strengths={effect.name: θ}), float(δ)))
    return found


def _residual(started: Sequence[Started], motions: Sequence[Array], model: Model) -> Array:
    return _compared(started, [recording.observed[: len(x)] - x for (recording, _), x in zip(started, motions, strict=True)], model)


def _compared(started: Sequence[Started], fields: Sequence[Array], model: Model) -> Array:
    """Fields [T, V, 3] m over the noise, where free vertices were seen after the start, as one vector."""
    rows = []
    for (recording, _), field in zip(started, fields, strict=True):
        on = np.isfinite(recording.observed[: len(field)]).all(-1)
        on[0], on[:, model.subject.cloth.boundary] = False, False
        rows.append((field[on] / recording.noise[: len(field)][on][:, None]).ravel())
    return np.concatenate(rows)


def _added(found: Differences, best: Fit, fps: float) -> Array | None:
    """Root mean square acceleration [V] m/s² that the effects add."""
    θ = {c: value for e in best.effects for c, value in zip(e.columns, best.strengths[e.name], strict=True)}
    if not θ:
        return None
    a = derivative(sum(value * found.fields[c] for c, value in θ.items()), fps, 2)
    return np.sqrt(np.mean(np.sum(a**2, -1), 0))


RIVAL = Rival(
    "finite_differences",
    "simulates whole recordings once per parameter and adds effects while AIC falls",
    "Efroymson 1960, Akaike 1974: stepwise regression on forward differences",
    finite_differences,
    slow=True,
    refits=True,
)
