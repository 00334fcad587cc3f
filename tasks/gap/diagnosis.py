"""The diagnosis, from recordings of one garment to where the base model fails, which effect it lacks, and how far the gap then shrinks.

    states → base refit → finer re-run → tangents of all effects → hypotheses → refit of the leaders → verdict → held-out windows

Everything before the verdict sees the training windows only. `run` maps a function over windows: serially, over processes, or over workers.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import BaseFit, Evidence, Job, Map, Prior, follow, moved, refit, with_fabric, without_state
from tasks.cloth.start_state import States, states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Recording, Window, windows
from tasks.effects.effect import Effect, Subject
from tasks.effects.model import Model
from tasks.gap.hypotheses import Fitted, Windows
from tasks.gap.numerics import corrected, finer_offset

Array = NDArray[np.float64]

MODES = 40  # smooth modes of the start state, times three directions, place and velocity
LEADERS = 3  # hypotheses that are refitted with the simulator
PARTNERS = 6  # leaders whose pairs are tried
HELD = 0.3  # share of each recording kept for the end where no recording is given for it
FEWEST_WINDOWS = 4  # of training windows that can be followed


@dataclass(frozen=True)
class Data:
    """Recordings of one garment with the states their windows start from."""

    recordings: tuple[Recording, ...]
    states: tuple[States, ...]
    windows: tuple[Window, ...]

    def only(self, windows: Iterable[Window]) -> "Data":
        """Some of the windows."""
        return replace(self, windows=tuple(windows))


@dataclass(frozen=True)
class Screened:
    """The refitted base, the training windows' evidence with all tangents, and the hypotheses, best first."""

    base: BaseFit
    evidence: tuple[Evidence, ...]
    windows: Windows
    hypotheses: tuple[Fitted, ...]


@dataclass(frozen=True)
class Refitted:
    """A hypothesis after a refit with the simulator: its model, how it fits, and the evidence of its windows."""

    hypothesis: Fitted
    model: Model
    evidence: tuple[Evidence, ...]


def gather(model: Model, recordings: Sequence[Recording], run: Map = map) -> Data:
    """States and windows of recordings; windows that start where the cloth could not be brought to what was seen are left out."""
    found = tuple(run(_states, [(model, r) for r in recordings]))
    cut = windows(recordings, model.subject.fps)
    return Data(tuple(recordings), found, tuple(w for w in cut if w.start < len(found[w.recording].x)))


def _states(job: tuple[Model, Recording]) -> States:
    model, recording = job
    return states(model, recording.motion, recording.observed, float(np.median(recording.noise)))


def split(data: Data) -> tuple[Data, Data]:
    """Training windows, and the last part of each recording to hold out (none where a recording is too short)."""
    train, held = [], []
    for k in range(len(data.recordings)):
        own = [w for w in data.windows if w.recording == k]
        count = round(HELD * len(own)) if len(own) > FEWEST_WINDOWS else 0
        train += own[: len(own) - count]
        held += own[len(own) - count :]
    return data.only(train), data.only(held)


def jobs(model: Model, data: Data, φ: Array, **options) -> list[Job]:
    """One job per window."""
    return [Job(model, data.recordings[w.recording], w, data.states[w.recording], φ, **options) for w in data.windows]


def screen(model: Model, data: Data, effects: Sequence[Effect], *, run: Map = map, tell: Callable[[str], None] = lambda text: None) -> Screened:
    """Base refit, numerics, and the tangents of all effects on the training windows."""
    φ = smooth_modes(model.subject.cloth, MODES)
    noise = float(np.median([np.median(r.noise) for r in data.recordings]))
    base = refit(jobs(model, data, φ), noise=noise, run=run, tell=tell)
    followed = [e.prediction.complete for e in base.evidence]
    data = data.only(w for w, ok in zip(data.windows, followed, strict=True) if ok)
    coarse = [e.prediction.x for e in base.evidence if e.prediction.complete]
    tell("finer re-run")
    offsets = list(run(_offset, list(zip(jobs(base.model, data, φ), coarse, strict=True))))
    tell("tangents of all effects")
    suspicious = replace(base.model, effects=tuple(effects))
    plain = jobs(suspicious, data, φ, columns=True, prior=base.prior)
    evidence = tuple(run(follow, [replace(job, offset=_known(o, x)) for job, o, x in zip(plain, offsets, coarse, strict=True)]))
    compared = compress(evidence, base.prior, effects)
    return Screened(base, evidence, compared, tuple(ranked(compared)))


def _offset(job: tuple[Job, Array]) -> Array | None:
    return finer_offset(*job)


def _known(offset: Array | None, coarse: Array) -> Array:
    return np.zeros_like(coarse[1:]) if offset is None else offset


def compress(evidence: Sequence[Evidence], prior: Prior, effects: Sequence[Effect]) -> Windows:
    """Normal equations with start state and numerics integrated out."""
    return Windows([corrected(without_state(e.normals, prior)) for e in evidence if e.prediction.complete], effects)


def ranked(compared: Windows) -> list[Fitted]:
    """Singles, and pairs of the leading ones, best score first."""
    singles = sorted((compared.fit([e]) for e in compared.effects), key=lambda f: -f.score)
    leading = [f.effects[0] for f in singles[:PARTNERS] if f.score > 0]
    pairs = [compared.fit(pair) for pair in combinations(leading, 2)]
    return sorted([*singles, *pairs], key=lambda f: -f.score)


def refitted(screened: Screened, data: Data, hypothesis: Fitted, effects: Sequence[Effect], *, run: Map = map) -> Refitted:
    """The training windows followed once more with the hypothesis' effects at their estimated strengths, and what a last linear step adds."""
    base = screened.base
    model = replace(base.model, effects=hypothesis.effects, strengths={e.name: hypothesis.θ(e) for e in hypothesis.effects})
    model = with_fabric(model, moved(model.subject.fabric, hypothesis.base)[0])
    φ = smooth_modes(model.subject.cloth, MODES)
    data = data.only(e.prediction.window for e in screened.evidence)
    offsets = [e.offset for e in screened.evidence]
    todo = [replace(job, offset=o) for job, o in zip(jobs(model, data, φ, columns=True, prior=base.prior), offsets, strict=True)]
    evidence = tuple(run(follow, todo))
    if not all(e.prediction.complete for e in evidence):
        return Refitted(replace(hypothesis, score=-np.inf), model, evidence)
    after = screened.windows.again([corrected(without_state(e.normals, base.prior)) for e in evidence], hypothesis)
    return Refitted(after, model, evidence)
