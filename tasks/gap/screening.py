"""Screening: the base refitted, what its discretisation does, and the tangents of all effects, as hypotheses weighed without further simulation."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.chord_shortening import chord_shortening
from tasks.cloth.contact_sagitta import body_speed
from tasks.cloth.numerics import corrected, finer_offset
from tasks.cloth.shooting import BaseFit, Evidence, Job, Map, Prior, follow, refit, without_state
from tasks.cloth.state_modes import smooth_modes
from tasks.effects.effect import Effect, MeshDoubt
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, jobs
from tasks.gap.hypotheses import NOWHERE, Fitted, Windows

Array = NDArray[np.float64]

MODES = 40  # smooth modes of the start state, times three directions, place and velocity
ITERATIONS, FINAL = 5, 3  # of the base refit, on a few windows and then on all
ROUGH = 4  # windows of the first rounds of the base refit


@dataclass(frozen=True)
class Screened:
    """The refitted base, the training windows' evidence with all tangents, and the hypotheses, best first."""

    base: BaseFit
    evidence: tuple[Evidence, ...]
    windows: Windows
    hypotheses: tuple[Fitted, ...]


def roughly_refitted(model: Model, data: Gathered, run: Map = map, tell: Callable[[str], None] = lambda text: None) -> Model:
    """The model after the first rounds of the base refit, on a few of the windows."""
    few = data.only(data.windows[:: max(1, len(data.windows) // ROUGH)])
    φ = smooth_modes(model.subject.cloth, MODES)
    return refit(jobs(model, few, φ), noise=data.noise, iterations=ITERATIONS, run=run, tell=tell).model


def screen(
    model: Model,
    data: Gathered,
    effects: Sequence[Effect],
    *,
    feigned: Mapping[str, float] = NOWHERE,
    iterations: int = FINAL,
    run: Map = map,
    tell: Callable[[str], None] = lambda text: None,
) -> Screened:
    """Base refit, numerics, and the tangents of all effects on the training windows; no iterations where the base is known."""
    φ = smooth_modes(model.subject.cloth, MODES)
    noise = data.noise
    base = refit(jobs(model, data, φ), noise=noise, iterations=iterations, run=run, tell=tell)
    followed = [e.prediction.complete for e in base.evidence]
    data = data.only(w for w, ok in zip(data.windows, followed, strict=True) if ok)
    coarse = [e.prediction.x for e in base.evidence if e.prediction.complete]
    tell("finer re-run")
    offsets = list(run(_offset, list(zip(jobs(base.model, data, φ), coarse, strict=True))))
    tell("tangents of all effects")
    suspicious = base.model.joined(effects, {})
    plain = jobs(suspicious, data, φ, columns=True, prior=base.prior)
    evidence = tuple(run(follow, [replace(job, offset=_known(o, x)) for job, o, x in zip(plain, offsets, coarse, strict=True)]))
    compared = compress(evidence, base.prior, effects, feigned)
    return Screened(base, evidence, compared, tuple(ranked(compared)))


def mesh_doubt(model: Model, data: Gathered, contact_doubt: float) -> MeshDoubt:
    """What the coarse mesh leaves in doubt; contact_doubt [m]: where contact may hold the cloth wrongly."""
    scale = chord_shortening(model.subject.cloth, data.states, data.noise)
    return MeshDoubt(contact_doubt, body_speed(data.recordings, model.subject.fps), scale)


def feigned(effects: Sequence[Effect], doubt: MeshDoubt) -> dict[str, float]:
    """Column -> standard deviation of the strength that the coarse mesh alone may feign."""
    return {c: float(σ) for e in effects for c, σ in zip(e.columns, e.feigned(doubt), strict=True) if σ}


def _offset(job: tuple[Job, Array]) -> Array | None:
    return finer_offset(*job)


def _known(offset: Array | None, coarse: Array) -> Array:
    return np.zeros_like(coarse[1:]) if offset is None else offset


def compress(evidence: Sequence[Evidence], prior: Prior, effects: Sequence[Effect], feigned: Mapping[str, float] = NOWHERE) -> Windows:
    """Normal equations with start state and numerics integrated out."""
    return Windows([corrected(without_state(e.normals, prior)) for e in evidence if e.prediction.complete], effects, feigned=feigned)


def ranked(compared: Windows) -> list[Fitted]:
    """Singles, strongest evidence first."""
    return sorted((compared.fit([e]) for e in compared.effects), key=lambda f: -f.evidence)
