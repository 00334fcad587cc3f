"""Screening: the base refitted, what its discretisation does, and the tangents of all effects, as hypotheses weighed without further simulation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth import nearest_fabric
from tasks.cloth.base_parameters import with_fabric
from tasks.cloth.base_refit import BaseFit, refit
from tasks.cloth.likeliest_errors import estimated_correlation, estimated_prior
from tasks.cloth.nuisances import Prior, without_state
from tasks.cloth.numerics import corrected, offsets, with_tangents
from tasks.cloth.shooting import Evidence, Job, Map, Start, follow, nearer_start
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.tracking_noise import Correlation
from tasks.cloth.windows import Normals, predict
from tasks.effects.effect import Effect, MeshDoubt
from tasks.effects.model import Model
from tasks.gap.feigned import feigned, mesh_doubt, without_doubts
from tasks.gap.gathered import Gathered, jobs
from tasks.gap.hypotheses import Fitted, Windows

Array = NDArray[np.float64]

MODES = 40  # smooth modes of the start state, times three directions, place and velocity
ITERATIONS, FINAL = 6, 3  # of the base refit, on a few windows of each length and then on all
CERTAIN = MeshDoubt(0.0, 0.0, 0.0)
ROUGH = 3  # windows of the first rounds of the base refit,
STARTING = 12  # and modes of their starts where fabrics far apart are compared


@dataclass(frozen=True)
class Screened:
    """The refitted base, the training windows' evidence with all tangents, the start states' prior once forcing has its own, the
    hypotheses, best first (none where no window could be followed), and what the mesh leaves in doubt.
    """

    base: BaseFit
    evidence: tuple[Evidence, ...]
    prior: Prior
    windows: Windows
    hypotheses: tuple[Fitted, ...]
    doubt: MeshDoubt = CERTAIN


def roughly_refitted(
    model: Model, each: Sequence[Gathered], run: Map = map, tell: Callable[[str], None] = lambda text: None, *, searched: bool = True
) -> tuple[Model, Correlation]:
    """The model after the first rounds of the base refit, on a few windows of each length, short ones first, and how the tracker's errors
    correlate there.

    From a fabric far off, long windows lead nowhere; short ones may not tell one fabric from another, so the long ones begin with what is
    nearest of that and of fabrics far apart, if `searched`.
    """
    φ, first = smooth_modes(model.subject.cloth, MODES), model.subject.fabric
    for data in each:
        few = data.only(data.windows[:: max(1, len(data.windows) // ROUGH)])
        if searched and data is each[-1]:
            todo = jobs(model, few, smooth_modes(model.subject.cloth, STARTING))
            model = with_fabric(model, nearest_fabric.searched(todo, first, noise=few.noise, run=run))
        base = refit(jobs(model, few, φ), noise=data.noise, iterations=ITERATIONS, run=run, tell=tell)
        model = base.model
    correlation = estimated_correlation(jobs(model, few, φ)[::2], base.prior, data.noise, run)
    tell(f"errors of tracking: {correlation.share:.0%} shared over {1e3 * correlation.length:.0f} mm for {correlation.memory:.2g} s")
    return model, correlation


def screen(
    model: Model,
    data: Gathered,
    effects: Sequence[Effect],
    *,
    contact_doubt: float = 0.0,
    iterations: int = FINAL,
    run: Map = map,
    tell: Callable[[str], None] = lambda text: None,
) -> Screened:
    """Base refit, numerics, and the tangents of all effects on the training windows; no iterations where the base is known."""
    φ = smooth_modes(model.subject.cloth, MODES)
    base = refit(jobs(model, data, φ), noise=data.noise, iterations=iterations, run=run, tell=tell)
    followed = [e for e in base.evidence if e.prediction.complete]
    data = data.only(e.prediction.window for e in followed)
    evidence = signatures(base, data, followed, effects, run, tell)
    prior = estimated_prior(evidence, data.noise)
    doubt = mesh_doubt(base.model, data, contact_doubt)
    compared = compress(evidence, prior, effects, doubt)
    return Screened(base, evidence, prior, compared, tuple(ranked(compared)), doubt)


def signatures(
    base: BaseFit, data: Gathered, followed: Sequence[Evidence], effects: Sequence[Effect], run: Map, tell: Callable[[str], None]
) -> tuple[Evidence, ...]:
    """Followed windows of `data` with the tangents of all effects about the start that the base asks for, and what computing otherwise changes."""
    φ = smooth_modes(base.model.subject.cloth, MODES)
    tell("the same computed otherwise")
    otherwise = list(run(_otherwise, list(zip(jobs(base.model, data, φ), followed, strict=True))))
    tell("tangents of all effects")
    plain = jobs(with_tangents(base.model.joined(effects, {})), data, φ, columns=True, forced=True, prior=base.prior)
    return tuple(run(follow, [replace(job, start=z, offsets=d) for job, (z, d) in zip(plain, otherwise, strict=True)]))


def _otherwise(job: tuple[Job, Evidence]) -> tuple[Start, dict[str, Array]]:
    """The start that the base asks for in a window, and what computing otherwise changes.

    That is simulated from the state itself, where the cloth lies as forces and body let it: a start that was moved along smooth modes is
    freed of the body by every mesh in its own way, which would be taken for what the mesh does to the motion.
    """
    todo, found = job
    own = predict(todo.model, todo.recording, todo.window, todo.states)
    start, _ = nearer_start(replace(todo, start=found.start), found)
    return start, offsets(todo, own.x) if own.complete else {}


def compress(evidence: Sequence[Evidence], prior: Prior, effects: Sequence[Effect], doubt: MeshDoubt = CERTAIN) -> Windows:
    """Normal equations with start state, doubts of the mesh and numerics integrated out."""
    followed = [e for e in evidence if e.prediction.complete]
    plain = [_of_certain_mesh(e, prior, effects, doubt) for e in followed]
    return Windows([corrected(n) for n in plain], effects, feigned=feigned(effects, doubt, plain, prior.a))


def compressed(evidence: Sequence[Evidence], prior: Prior, effects: Sequence[Effect], doubt: MeshDoubt) -> list[Normals]:
    """The same of single windows, all of which could be followed."""
    return [corrected(_of_certain_mesh(e, prior, effects, doubt)) for e in evidence]


def _of_certain_mesh(e: Evidence, prior: Prior, effects: Sequence[Effect], doubt: MeshDoubt) -> Normals:
    return without_doubts(without_state(e.normals, prior), effects, doubt)


def ranked(compared: Windows) -> list[Fitted]:
    """Singles, strongest evidence first; none where no window could be followed, for then there is nothing to weigh them by."""
    effects = compared.effects if len(compared) else ()
    return sorted((compared.fit([e]) for e in effects), key=lambda f: -f.evidence)
