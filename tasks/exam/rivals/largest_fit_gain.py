"""Largest fit gain: the single effect that lowers χ² most on the recordings that it is fitted to.

    gain_j = min_κ χ² − min_{κ, θ_j} χ²,      weight of effect j ∝ exp(½ gain_j),      of none ∝ 1

with the windows, start states and tangents of the diagnosis. What it is not: nothing is taken off for numerics, no window is kept out, and
every coordinate counts as independent. What misses on any recording of another mesh is blamed on the effect that looks most like it.

Source: Wilks 1938 (likelihood ratio), white noise taken at its word.
"""

from dataclasses import replace

from tasks.cloth.base_refit import summed
from tasks.cloth.nuisances import without_nuisances
from tasks.cloth.shooting import follow
from tasks.cloth.state_modes import smooth_modes
from tasks.exam.rivals.linear_fit import applied, column_names, fit
from tasks.exam.rivals.rival import NONE, Case, Reply, Rival
from tasks.gap.acceleration import effect_acceleration
from tasks.gap.gathered import jobs, restarted
from tasks.gap.screening import MODES


def largest_fit_gain(case: Case) -> Reply:
    """The effect of largest gain; none if no effect has any."""
    data, base = case.refitted
    φ = smooth_modes(case.model.subject.cloth, MODES)
    todo = jobs(replace(base.model, effects=case.effects), data, φ, columns=True, prior=base.prior)
    evidence = [e for e in case.run(follow, todo) if e.prediction.complete]
    A, b = summed([without_nuisances(e.normals, base.prior) for e in evidence], column_names(case.effects))
    nothing = fit(A, b, case.effects, [])
    singles = [fit(A, b, case.effects, [effect]) for effect in case.effects]
    weight = {NONE: 0.0} | {single.names: (single.gain - nothing.gain) / 2 for single in singles}
    best = max([nothing, *singles], key=lambda found: found.gain)
    after = applied(base.model, best.effects, best.base, best.strengths)
    return Reply(
        weight,
        before=base.model,
        after=after,
        deviation=best.deviation,
        vertex_accel=effect_acceleration(after, restarted(after, data, case.run), best.by_column, case.run) if best.effects else None,
    )


RIVAL = Rival(
    "largest_fit_gain",
    "names the effect that fits best, on the recordings it was fitted to",
    "Wilks 1938, the likelihood ratio",
    largest_fit_gain,
    refits=True,
)
