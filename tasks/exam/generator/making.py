"""Making a case with the generator's own engine: strengths for the magnitude asked, and the runs that are recorded."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator.causes import CAUSES, Conditions
from tasks.exam.generator.recording import Made, Sizes, recorded, shown, tracked
from tasks.exam.generator.rehearsal import least, numerics, rehearsed, still_run, strength
from tasks.exam.generator.stepper import State, Stepper
from tasks.exam.generator.strata import Question, drawn
from tasks.exam.generator.subject import FRAMES, Subject, TooFaint, Unmakeable, drawn_subject, states

Array = NDArray[np.float64]
Once = Callable[[Question, np.random.Generator, float], Made]
NEARLY = 0.8  # share of the magnitude asked that a draw must reach to be taken at once


def make(question: Question, once: Once | None = None, *, attempts: int = 8) -> Made:
    """Make the case. A scene that cannot be simulated, or shows its causes by less than was asked at any plausible strength, is drawn
    again; where none shows them so, the one that shows them best is taken. Raises Unmakeable where none shows them at all.

    once: makes it from one draw; that of the generator's own engine where none is given.
    """
    reasons, faint = [], []

    def tried(attempt: int, share: float) -> Made | None:
        q = drawn(question, attempt) if attempt else question
        try:
            return (once or make_once)(q, np.random.default_rng([*question.seed, attempt, 1]), share)
        except ArithmeticError as error:
            reasons.append(f"{q.kind}: {error}")
            if isinstance(error, TooFaint) and share:
                faint.append((error.share, attempt))
        return None

    for attempt in range(attempts):
        if made := tried(attempt, NEARLY):
            return made
    for _, attempt in sorted(faint, reverse=True):
        if made := tried(attempt, 0.0):
            return made
    raise Unmakeable(f"case {question.number} {sorted(question.causes)}: {'; '.join(reasons)}")


def make_once(q: Question, rng: np.random.Generator, share: float) -> Made:
    """The case from one draw. share: of the magnitude asked that its causes must reach, and a floor at least.

    Raises ArithmeticError where its scene cannot be simulated, Unmakeable where it cannot show its causes.
    """
    subject = drawn_subject(q, rng)
    base = subject.conditions(subject.garment.fine)
    stepper = Stepper(subject.world(base, 0))
    still = subject.still(stepper, 0)
    plain = np.stack([subject.reported(s.x) for s in states(stepper, still)])
    discretisation = numerics(subject, plain)
    floor = float(np.hypot(subject.tracker.rms, discretisation))
    strengths, true = {}, base
    settled = still_run(subject, subject.conditions(subject.garment.coarse)) if q.causes else None
    for name, multiple in q.causes.items():
        sign = -1.0 if CAUSES[name].symmetric and rng.uniform() < 0.5 else 1.0
        tried = partial(rehearsed, subject, CAUSES[name], plain=settled)
        strengths[name] = strength(CAUSES[name], tried, multiple * floor, least(multiple, share) * floor, sign)
        true = CAUSES[name].apply(true, strengths[name])
    first, change = plain, None
    if strengths:
        first, still, change = _beside_base(subject, true, base)
    moved = shown(tracked(subject, 0, first, true.smoothing), tracked(subject, 0, plain, base.smoothing), floor, asked=bool(strengths))
    runs = [first] + [_moved(subject, true, k, still) for k in (1, 2)]
    seen = [tracked(subject, k, x, true.smoothing) for k, x in enumerate(runs)]
    return recorded(q, subject, seen, strengths, Sizes(moved, subject.tracker.rms, discretisation), change, rng)


def _moved(subject: Subject, c: Conditions, recording: int, start: State) -> Array:
    """Positions [T, C, 3] on the coarse mesh in a recording."""
    return np.stack([subject.reported(s.x) for s in states(Stepper(subject.world(c, recording)), start)])


def _beside_base(subject: Subject, true: Conditions, base: Conditions) -> tuple[Array, State, Array]:
    """The first recording, its start, and the change of acceleration [C] m/s² rms: between the laws with and without causes at the same states."""
    stepper, other = Stepper(subject.world(true, 0)), Stepper(subject.world(base, 0))
    start = subject.still(stepper, 0)
    x, squares = [], np.zeros(len(subject.garment.fine.rest))
    for state in states(stepper, start):
        x.append(subject.reported(state.x))
        normal_force = stepper.contact.normal_force
        squares += np.sum((stepper.accelerations(state) - other.accelerations(state)) ** 2, 1)
        stepper.contact.normal_force = normal_force
    squares[subject.garment.fine.pinned] = 0
    return np.stack(x), start, np.sqrt(subject.garment.resampled(squares[:, None])[:, 0] / FRAMES)
