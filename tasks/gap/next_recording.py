"""What to record next: of a few motions the one that would best tell apart the causes that these recordings leave.

Were cause a right at its strength θ_a, recordings of normal equations G would reject cause b, its strength and the base parameters free, by

    d²(a|b) = θ_aᵀ (G_aa − G_ar (G_rr + P_r⁻¹)⁻¹ G_ra) θ_a / φ_a,    r = base parameters and b, with their priors P_r

squared standard deviations: twice the expected log likelihood ratio, which is T-optimality. G holds the recordings at hand and `SECONDS` of
the motion, which is simulated with the fitted base and differentiated by the causes in question, in windows like those at hand: start
states, errors of tracking and forcing are integrated out, misfits scaled as there, and φ_a is how much more than independent coordinates
the windows at hand scatter. A motion is worth what it does for the pair that it parts worst; "none" is a rival where it is not excluded.

Source: Atkinson & Fedorov 1975 (designs that discriminate between rival models). Limits: derivatives about the base; only those other ways
of computing that have a tangent have a part in it, so that every motion is flattered. A motion that the base cannot be simulated through
is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.base_refit import summed
from tasks.cloth.nuisances import without_forcing
from tasks.cloth.numerics import with_tangents
from tasks.cloth.shooting import Evidence, Map, follow
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Recording, Window
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.confusability import SHOWN, over_scales
from tasks.gap.gathered import Gathered, jobs
from tasks.gap.hypotheses import Fitted
from tasks.gap.next_motions import NextMotion, next_motions
from tasks.gap.screening import MODES, Screened, compressed
from tasks.gap.strength_priors import precision
from tasks.gap.verdict import Verdict
from tasks.simulator.newton import CONVERGED

Array = NDArray[np.float64]

SECONDS = 2.0  # of the next recording
MOST = 4  # causes that are compared
WINDOWS = 2  # compared of each motion, after a lead as long as one, where the motion lasts that long
FAINT = 0.1  # of the typical strength: weaker causes are compared at the typical one

STILL = "a faster motion with stops: sways of 0.3 m at 1 Hz, half turns, and two seconds of rest after each"
MORE = "the same garment in a second, different motion of at least two seconds"
NOW, AGAIN = "these recordings alone", "the same motion once more"


@dataclass(frozen=True)
class Design:
    """said: the motion; apart: standard deviations by which the pair of causes that it parts worst would be told apart, the second beside the first."""

    said: str
    apart: float
    pair: tuple[str, str]


def in_question(verdict: Verdict, singles: Sequence[Fitted]) -> list[Fitted]:
    """Causes that a next recording should tell apart: those named, then others that 90 % of the probability needs, as they weigh alone."""
    names = dict.fromkeys([n for group in verdict.classes for n in group] + verdict.answer_set)
    alone = {h.name: h for h in singles}
    return [alone[n] for n in names if n in alone][:MOST]


def designs(
    screened: Screened, base: Model, train: Gathered, asked: Sequence[Fitted], *, or_none: bool, run: Map = map
) -> tuple[Design, ...]:
    """What is known of the causes `asked` now (`NOW`, first), and what each motion would add, the best first; nothing where there is no
    pair to part. or_none: whether "none" is a rival too.
    """
    pairs = [(a, b.effects[0]) for a, b in permutations(asked, 2)] + ([(a, None) for a in asked] if or_none else [])
    if not pairs:
        return ()
    effects = [h.effects[0] for h in asked]
    names = [*PARAMETERS, *(c for e in effects for c in e.columns)]
    now, _ = summed(over_scales(screened.windows), names)
    fps, length = base.subject.fps, int(np.median([w.length for w in train.windows]))
    told = {NOW: np.zeros_like(now), AGAIN: now * SECONDS * fps / sum(w.length for w in train.windows)}
    k = train.windows[0].recording  # the cloth may not have been followed into the first
    recording, states = train.recordings[k], train.states[k]
    planned = next_motions(recording, states.x[0], states.v[0], (1 + WINDOWS) * length + 1, fps)
    model = with_tangents(base.joined(effects, {}))
    for motion, evidence in zip(planned, run(_followed, [(model, recording, motion, length) for motion in planned]), strict=True):
        if evidence:
            equations = compressed(evidence, screened.prior, effects, screened.doubt)
            G, _ = summed([without_forcing(n, screened.windows.forcing) for n in equations], names)
            told[motion.said] = G * np.mean(1 / screened.windows.scale) * SECONDS * fps / (len(evidence) * length)
    first, *others = (_worst(said, now + G, names, pairs) for said, G in told.items())
    return (first, *sorted(others, key=lambda d: -d.apart))


def record_next(verdict: Verdict, found: Sequence[Design]) -> str:
    """In words. found: as `designs` tells them; none where nothing was asked."""
    if verdict.kind == "not_testable":
        return STILL
    if not found:
        return MORE
    now, best, *_ = found
    parted = " from ".join(best.pair)
    if best.apart < SHOWN:
        return f"nothing that was tried parts {parted} ({best.said}, at best: {best.apart:.1f} standard deviations); measure one of them by itself"
    return f"{best.said}, for {SECONDS:g} seconds: it would part {parted} by {best.apart:.1f} standard deviations (now {now.apart:.1f})"


def separation(G: Array, names: Sequence[str], a: Fitted, b: Effect | None) -> float:
    """d(a|b) for normal equations G [P, P] of columns `names`; b None: "none"."""
    others, own = list(PARAMETERS) + (list(b.columns) if b else []), a.effects[0]
    i, r = ([names.index(c) for c in columns] for columns in (own.columns, others))
    θ = a.θ(own)
    if np.linalg.norm(θ / own.typical) < FAINT:
        θ = own.typical
    free = G[np.ix_(r, r)] + np.diag(precision([b] if b else []))
    seen = G[np.ix_(i, i)] - G[np.ix_(i, r)] @ np.linalg.solve(free, G[np.ix_(r, i)])
    return float(np.sqrt(max(θ @ seen @ θ, 0.0) / a.weights[0].dispersion))


def _worst(said: str, G: Array, names: Sequence[str], pairs: Sequence[tuple[Fitted, Effect | None]]) -> Design:
    apart = [separation(G, names, a, b) for a, b in pairs]
    k = int(np.argmin(apart))
    a, b = pairs[k]
    return Design(said, apart[k], (a.name, b.name if b else "none"))


def _followed(job: tuple[Model, Recording, NextMotion, int]) -> list[Evidence]:
    """The last windows of a motion, observed as simulated; none where the model cannot be simulated through it."""
    model, like, asked, length = job
    frames = list(like.scene(model).run(asked.motion, asked.x0, asked.v0))
    count = min(WINDOWS, (len(frames) - 1) // length) if frames[-1].converged else 0
    windows = tuple(Window(0, len(frames) - 1 - k * length, length) for k in range(count, 0, -1))
    x, v = np.stack([f.x for f in frames]), np.stack([f.v for f in frames])
    planned = Recording(like.collider, asked.motion, x, np.full(x.shape[:2], np.median(like.noise)), like.correlation)
    data = Gathered((planned,), (States(x, v, CONVERGED),), windows)
    found = [follow(job) for job in jobs(model, data, smooth_modes(model.subject.cloth, MODES), columns=True, forced=True)]
    return [e for e in found if e.prediction.complete]
