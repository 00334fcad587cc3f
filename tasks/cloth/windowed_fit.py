"""The default fit: κ_s and κ_b from windows of the recording (`windows.py`, `shooting.py`, `base_refit.py`), then one replay of the whole for the figures.

A replay of a second from one start is chaotic where cloth buckles: its loss has a false minimum wherever a fold falls the other way, and
Gauss–Newton on it stops in the first. In windows, each from its own start whose error is marginalised, derivatives hold: first of a fifth
of a second, which lead home from any fabric, then, with states that the fabric found allows, of up to a third, for what bending does grows
with the square of time. There κ_b is bracketed by losses (`bending_profile.py`).

What the mesh and the step alone do is taken off at the end: each window is also simulated on about twice the vertices with half the step,
and the difference d enters as y − x = … + (1 ± 1) d (Roache 1994: the finer run is nearer to the limit by about as much as it differs). By
what d does to all windows alike the answer stays uncertain, however many there are (`numerics.py`).

Windows in which nothing was seen, and those that begin after the cloth could not be brought to where it was seen, are left out, and the fit
says so.

Where effects are added to the base model (`joint_refit.py`), their strengths are fitted with the fabric after it, on the windows alone, and
the whole is replayed with them (`completed_replay.py`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS, logarithms, moved, with_fabric
from tasks.cloth.base_refit import SCALE, BaseFit, refit, scaled
from tasks.cloth.bending_profile import ASIDE, Followed, bracketed
from tasks.cloth.completed_replay import replay_completed
from tasks.cloth.gauss_newton import UNKNOWN, Fit, Normal, rms_mm
from tasks.cloth.joint_refit import CompletedFit, joint_normal, refit_jointly
from tasks.cloth.likeliest_errors import estimated_prior
from tasks.cloth.nearest_fabric import followed_in
from tasks.cloth.nuisances import Prior, without_state
from tasks.cloth.numerics import FINER, offsets
from tasks.cloth.scene import FORGETFUL, FrameMemory, Scene, replay
from tasks.cloth.shooting import Evidence, Job, Map, follow
from tasks.cloth.start_state import states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.unwrinkled_start import FINE, without_wrinkles
from tasks.cloth.windows import PREDICTED, SHORT_S, Normals, Recording, every_window, longest_s, predict, windows
from tasks.cloth.yielded_collider import with_yielded_collider
from tasks.effects.effect import Effect, Motion, Subject
from tasks.effects.model import Model
from tasks.simulator import Fabric
from tasks.simulator.newton import CONVERGED

Array = NDArray[np.float64]

FEWEST = 3  # windows: their scatter says how sure a stiffness is
ROUNDS, FAR = 3, 0.2  # in longer windows, and the change of a logarithm that asks for another
LEAST_NOISE = 1e-5  # [m]
MODES = 20  # of the start state, times three directions, times place and velocity


@dataclass(frozen=True)
class Cut:
    """The windows of a scene, how the walk through its states ended, and what of the scene they leave out, in sentences."""

    jobs: list[Job]
    ending: str
    reasons: tuple[str, ...]


def fit_windows(
    scene: Scene,
    fabric: Fabric,
    *,
    effects: Sequence[Effect] = (),
    iterations: int = 8,
    run: Map = map,
    memory: FrameMemory = FORGETFUL,
    tell: Callable[[str], None] = lambda text: None,
) -> Fit:
    """Fit `PARAMETERS` from `fabric`, and the strengths of `effects` with them (then a CompletedFit); `run` maps over windows."""
    cut = _cut(scene, fabric, SHORT_S)
    stated = _noise(scene)
    if not cut.jobs:
        whole = replay(scene, fabric)
        return Fit(fabric, _nothing(), whole, (), f"no window can be followed: {'; '.join(cut.reasons)}", whole.reasons)
    found = refit(cut.jobs, noise=_noise(scene), iterations=iterations, run=run, tell=tell)
    while (shown := _misfit(found)) < SCALE and _noise(scene) > LEAST_NOISE:
        quieter = replace(scene, noise_m=np.sqrt(shown) * scene.noise_m)
        again = _cut(quieter, found.model.subject.fabric, SHORT_S)
        if not again.jobs:
            break
        scene, cut, history = quieter, again, found.history
        found = refit(cut.jobs, noise=_noise(scene), iterations=iterations, run=run, tell=tell)
        found = replace(found, history=(*history, *found.history))
    found, cut = _settled(scene, found, cut, iterations, run, tell)
    if effects:
        return replace(_completed(scene, found, cut, effects, iterations, run, tell), noise_share=_noise(scene) / stated)
    fabric, normal, doubts = _less_numerics(found, cut.jobs, run)
    whole = replay(scene, fabric, memory=memory)
    reasons = (*cut.reasons, *_lost(found, cut.jobs), *doubts, *whole.reasons)
    history = (*found.history, {"kappa_s": fabric.membrane, "kappa_b": fabric.bending, "rms_mm": rms_mm(scene, whole)})
    return Fit(fabric, normal, whole, history, found.ending, reasons, _noise(scene) / stated)


def _misfit(found: BaseFit) -> float:
    """Median over windows of χ² per coordinate: far below one where the noise is overstated, as it is where a file names none and is exact."""
    each = [without_state(e.normals, found.prior) for e in found.evidence if e.prediction.complete]
    return float(np.median([n.c / n.n for n in each])) if each else np.inf


def _settled(scene: Scene, found: BaseFit, cut: Cut, iterations: int, run: Map, tell: Callable[[str], None]) -> tuple[BaseFit, Cut]:
    """The fit gone on in longer windows, whose states are those of the fabric found, until it stands still, and these; as it was where
    cloth cannot be predicted that far.
    """
    for _ in range(ROUNDS):
        before = found.model.subject.fabric
        longer = _cut(scene, before)
        if not longer.jobs:
            break
        further = refit(longer.jobs, noise=_noise(scene), iterations=iterations, run=run, tell=tell)
        if not _whole(further.evidence) or _misfit(further) > PREDICTED:
            break
        profile = bracketed(further.model.subject.fabric, _following(further, longer.jobs, run))
        after = further.model.subject.fabric if profile is None else profile.fabric
        found = replace(further, model=with_fabric(further.model, after), history=(*found.history, *further.history))
        cut = longer
        if np.abs(logarithms(after) - logarithms(before)).max() < FAR:
            break
    return found, cut


def _following(found: BaseFit, jobs: Sequence[Job], run: Map) -> Followed:
    """What windows say of any fabric, the smooth modes of their start marginalised."""

    def told(fabrics: Sequence[Fabric]) -> list[list[Normals] | None]:
        each = followed_in(fabrics, jobs, run)
        return [[without_state(e.normals, found.prior) for e in evidence] if _whole(evidence) else None for evidence in each]

    return told


def _following_finely(found: BaseFit, jobs: Sequence[Job], run: Map) -> Followed:
    """The same with what noise leaves of wrinkles marginalised too, which only stiffness could iron, and with the columns of what the computation does."""
    fine = [replace(job, φ=smooth_modes(job.model.subject.cloth, FINE)) for job in jobs]

    def told(fabrics: Sequence[Fabric]) -> list[list[Normals] | None]:
        each = followed_in(fabrics, fine, run)
        return [_without_wrinkles(fine, evidence, found.prior) if _whole(evidence) else None for evidence in each]

    return told


def _without_wrinkles(jobs: Sequence[Job], evidence: Sequence[Evidence], prior: Prior) -> list[Normals]:
    return [without_wrinkles(job, e, prior, MODES) for job, e in zip(jobs, evidence, strict=True)]


def _whole(evidence: Sequence[Evidence]) -> bool:
    return all(e.prediction.complete for e in evidence)


def _completed(
    scene: Scene, found: BaseFit, cut: Cut, effects: Sequence[Effect], iterations: int, run: Map, tell: Callable[[str], None]
) -> Fit:
    """The base's refit gone on with the effects, and the replay with all of them."""
    followed = _with_offsets(found, cut.jobs, run)
    reasons = (*cut.reasons, *_lost(found, cut.jobs), *_unrefined(found, followed))
    if not followed:
        ending = "no window can be followed on both meshes, so no strength was fitted"
        whole = replay(scene, found.model.subject.fabric)
        return Fit(found.model.subject.fabric, _nothing(), whole, found.history, ending, (*reasons, *whole.reasons))
    joint = refit_jointly(found, followed, effects, noise=_noise(scene), iterations=iterations, run=run, tell=tell)
    whole = replay_completed(scene, joint.model)
    seen = replace(whole, x=joint.model.observed(whole.x))
    last = {**joint.history[-1], "rms_mm": rms_mm(scene, seen)}
    return CompletedFit(
        joint.model.subject.fabric,
        joint_normal(joint.model, joint.evidence, joint.prior),
        whole,
        (*found.history, *joint.history[:-1], last),
        joint.ending,
        (*reasons, *whole.reasons),
        model=joint.model,
    )


def _lost(found: BaseFit, jobs: list[Job]) -> tuple[str, ...]:
    lost = sum(not e.prediction.complete for e in found.evidence)
    return (f"{lost} of {len(jobs)} windows could not be followed",) if lost else ()


def _with_offsets(found: BaseFit, jobs: list[Job], run: Map) -> list[Job]:
    """The windows that the refitted base follows on either mesh, with what the finer one adds."""
    done = [replace(job, model=found.model) for job, e in zip(jobs, found.evidence) if e.prediction.complete]
    return [replace(job, offsets=d) for job, d in zip(done, run(_finer, done)) if len(d) == len(FINER)]


def _unrefined(found: BaseFit, with_offset: list[Job]) -> tuple[str, ...]:
    followed = sum(e.prediction.complete for e in found.evidence)
    missing = followed - len(with_offset)
    return (f"{missing} of {followed} windows have no finer computation",) if missing else ()


def _less_numerics(found: BaseFit, jobs: list[Job], run: Map) -> tuple[Fabric, Normal, tuple[str, ...]]:
    """The fabric with what a finer computation adds, what the windows say there, and what could not be had of it; without it nothing is known."""
    fabric, with_offset = found.model.subject.fabric, _with_offsets(found, jobs, run)
    reasons = _unrefined(found, with_offset)
    profile = bracketed(fabric, _following_finely(found, with_offset, run)) if with_offset else None
    if profile is None:
        alone = _normal(followed_in([fabric], jobs, run)[0], found.prior)
        return fabric, replace(alone, common=np.nan), (*reasons, UNKNOWN)
    normal = profile.normal
    return moved(profile.fabric, np.clip(normal.step, -ASIDE, ASIDE))[0], normal, reasons


def _finer(job: Job) -> dict[str, Array]:
    """name -> x(finer) − x [L, V, 3] m of a window, without what fails."""
    coarse = predict(job.model, job.recording, job.window, job.states)
    return offsets(job, coarse.x, FINER) if coarse.complete else {}


@dataclass(frozen=True)
class Windowed:
    """What short windows say of a fabric, in which any cloth can be predicted: the objective of the first rounds of `fit_windows`, for any
    scene like it.

    like: a model whose effects act at their strengths, and in which the scene is then linearised too (None: the base alone).
    """

    run: Map = field(default=map)
    like: Model | None = None

    @classmethod
    def of(cls, found: Fit, run: Map) -> "Windowed":
        """The objective that a fit is the optimum of."""
        return cls(run, found.model if isinstance(found, CompletedFit) else None)

    def losses(self, scene: Scene, fabrics: Sequence[Fabric]) -> list[float]:
        """Means of rᵀC⁻¹r; NaN where windows are lost, of which one fabric may lose others than the next."""
        return [self._loss(scene, fabric) for fabric in fabrics]

    def _loss(self, scene: Scene, fabric: Fabric) -> float:
        cut = _cut(scene, fabric, SHORT_S)
        if cut.ending != CONVERGED or not cut.jobs:
            return np.nan
        evidence, prior = self._followed(scene, cut)
        if not _whole(evidence):
            return np.nan
        return sum(without_state(e.normals, prior).c for e in evidence) / sum(e.normals.n for e in evidence)

    def normal(self, scene: Scene, fabric: Fabric) -> Normal:
        """Normal equations per window; NaN where none can be followed."""
        evidence, prior = self._followed(scene, _cut(scene, fabric, SHORT_S))
        return _normal(evidence, prior) if self.like is None else joint_normal(self.like, evidence, prior)

    def _followed(self, scene: Scene, cut: Cut) -> tuple[list[Evidence], Prior]:
        jobs = cut.jobs
        if self.like is not None:
            completed = replace(jobs[0].model, effects=self.like.effects, strengths=self.like.strengths) if jobs else None
            jobs = [replace(job, model=completed, columns=True) for job in jobs]
        evidence = list(self.run(follow, jobs))
        return evidence, estimated_prior(evidence, _noise(scene))


def _cut(scene: Scene, fabric: Fabric, length_s: float | None = None) -> Cut:
    """The windows of a scene, as long as leaves `FEWEST` of them if not said."""
    zone = np.full(len(scene.x0), "free", dtype="U8")
    model = Model(Subject(scene.cloth, fabric, scene.collider, zone, scene.fps), replace(scene.settings, yield_collider=False))
    recording = Recording(scene.collider, Motion(scene.collider_motion, scene.boundary_motion), scene.observed, scene.noise_m)
    if scene.settings.yield_collider:
        recording = with_yielded_collider(recording, model)
    known = states(model, recording.motion.given_way, recording.observed, _noise(scene))
    length_s = length_s or longest_s([recording], scene.fps, FEWEST)
    every, seen = (of([recording], scene.fps, length_s) for of in (every_window, windows))
    begun = [w for w in seen if w.start < len(known.x)] if len(known.x) > 1 else []
    φ = smooth_modes(scene.cloth, MODES)
    jobs = [Job(model, recording, w, known, φ) for w in begun]
    return Cut(jobs, known.ending, _left_out(len(every), len(seen), len(jobs), known.ending))


def _left_out(every: int, seen: int, begun: int, ending: str) -> tuple[str, ...]:
    """Of `every` window so many that were `seen`, and of these so many that could be `begun` before the walk through the states ended."""
    unseen = [f"{every - seen} of {every} windows are left out: hardly anything was seen in them"] if seen < every else []
    if ending == CONVERGED:
        return tuple(unseen)
    lost = f"the cloth cannot be brought to where it was seen, {ending}: {seen - begun} of {every} windows begin later and are left out"
    return (*unseen, lost)


def _normal(evidence: list[Evidence] | tuple[Evidence, ...], prior: Prior) -> Normal:
    done = [scaled(without_state(e.normals, prior)) for e in evidence if e.prediction.complete]
    if not done:
        return _nothing()
    at = done[0].index(PARAMETERS)
    return Normal(np.stack([n.g[at] for n in done]), np.stack([n.G[np.ix_(at, at)] for n in done]))


def _nothing() -> Normal:
    P = len(PARAMETERS)
    return Normal(np.full((1, P), np.nan), np.full((1, P, P), np.nan))


def _noise(scene: Scene) -> float:
    return float(np.median(scene.noise_m))


def started_well(scene: Scene, fabric: Fabric) -> Scene:
    """The scene with the start that observation and force agree on, in place of the observed one."""
    first = slice(0, 9)
    zone = np.full(len(scene.x0), "free", dtype="U8")
    model = Model(Subject(scene.cloth, fabric, scene.collider, zone, scene.fps), scene.settings)
    motion = Motion(scene.collider_motion[first], scene.boundary_motion[first])
    known = states(model, motion, scene.observed[first], _noise(scene))
    return scene if known.ending != CONVERGED else replace(scene, x0=known.x[0], v0=known.v[0] * bool(scene.v0.any()))
