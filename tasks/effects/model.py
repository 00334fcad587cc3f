"""The base model with effects at given strengths: one simulation, with the tangents of any effect, hooks and potentials alike."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tasks.effects.effect import Effect, Motion, Subject
from tasks.simulator import Settings, simulate
from tasks.simulator.simulate import Frame

Array = NDArray[np.float64]
STEP = 1e-3  # of a typical strength, in central differences of hooks


@dataclass(frozen=True)
class Drive:
    """What drives the cloth of a model: `motion` as its effects make it of what was recorded, the derivative of that by column, and the
    recorded collider's first frame `rest` [C, 3] m, by which areas of contact go.

    Effects that know the time, a creep since the first frame or a body that is late, are asked about whole recordings: of a cut one they
    would take the first frame for the beginning.
    """

    motion: Motion
    rest: Array
    modes: Mapping[str, Motion] = field(default_factory=dict)

    def each(self, change: Callable[[Motion], Motion]) -> "Drive":
        """Motion and derivatives cut or interpolated alike; `change` is linear."""
        return replace(self, motion=change(self.motion), modes={column: change(mode) for column, mode in self.modes.items()})


@dataclass(frozen=True)
class Model:
    """A subject, numerical settings, and effects with their strengths; an effect at strength zero may be listed for its tangent's sake."""

    subject: Subject
    settings: Settings
    effects: tuple[Effect, ...] = ()
    strengths: Mapping[str, Array] = field(default_factory=dict)

    def joined(self, effects: Sequence[Effect], strengths: Mapping[str, Array]) -> "Model":
        """The model with further effects, and strengths of some of all."""
        return replace(self, effects=(*self.effects, *effects), strengths={**self.strengths, **strengths})

    def strength(self, effect: Effect) -> Array:
        """θ [K] of an effect, zero where it is not given."""
        return np.asarray(self.strengths.get(effect.name, np.zeros(len(effect.strengths))), float)

    def by_column(self, effects: Sequence[Effect]) -> dict[str, float]:
        """column -> strength of some effects."""
        return {c: float(θ) for e in effects for c, θ in zip(e.columns, self.strength(e), strict=True)}

    def run(self, motion: Motion, x0: Array, v0: Array, *, columns: bool = False) -> Iterator[Frame]:
        """`run_along` a whole recorded motion."""
        return self.run_along(self.drive(motion, columns=columns), x0, v0, columns=columns)

    def run_along(
        self,
        drive: Drive,
        x0: Array,
        v0: Array,
        *,
        parameters: Sequence[str] = (),
        start_modes: Mapping[str, tuple[Array, Array]] | None = None,
        columns: bool = False,
    ) -> Iterator[Frame]:
        """Frames of the cloth as it is (not as observed), from x0 [V, 3] m and v0 [V, 3] m/s, through a motion, part of it, or one that was
        interpolated.

        parameters: names of base parameters to differentiate; `columns`: also all columns of all effects that act through potentials,
        fabric or motion (of the last, those that `drive` has). What acts on the observation is differentiated by `observed_tangents`. Reruns
        on another mesh give its vertices, the given ones first.
        """
        subject, settings, terms = self.dressed(), self.settings, []
        for effect in self.effects:
            θ = self.strength(effect)
            settings = effect.settings(settings, θ)
            x0, v0 = effect.start(subject, x0, θ), effect.start(subject, v0, θ)
            subject = effect.subject(subject, θ)
        for effect in self.effects:
            terms += effect.potentials(subject, self.strength(effect))
        sums = self._sums() if columns else {}
        frames = simulate(
            subject.cloth,
            subject.fabric,
            subject.collider,
            collider_motion=drive.motion.collider,
            boundary_motion=drive.motion.boundary,
            fps=subject.fps,
            x0=x0,
            v0=v0,
            settings=settings,
            potentials=terms,
            tangents=tuple(dict.fromkeys([*parameters, *(name for names in sums.values() for name in names)])),
            start_modes=start_modes,
            motion_modes={column: (mode.collider, mode.boundary) for column, mode in drive.modes.items()},
            collider_rest=drive.rest,
        )
        return (_with_columns(frame, sums, parameters) for frame in frames)

    def dressed(self) -> Subject:
        """The subject in the fabric that the effects make of its own."""
        fabric = self.subject.fabric
        for effect in self.effects:
            fabric = effect.fabric(fabric, self.strength(effect))
        return replace(self.subject, fabric=fabric)

    def drive(self, motion: Motion, *, columns: bool = False) -> Drive:
        """What a recorded motion drives the cloth by; columns: with the derivatives of all effects that act through it."""
        return Drive(self.driven(motion), motion.given_way.collider[0], self._motion_modes(motion) if columns else {})

    def driven(self, motion: Motion) -> Motion:
        """What drives the cloth in truth, if the effects are right and `motion` is what was recorded of it."""
        return self._driven(self.dressed(), motion)

    def observed(self, x: Array) -> Array:
        """What the tracker reports [T, V, 3] m of cloth at x [T, V, 3] m."""
        for effect in self.effects:
            x = effect.observe(self.subject, x, self.strength(effect))
        return x

    def unobserved(self, y: Array) -> Array:
        """Cloth [T, V, 3] m that the tracker reports as y [T, V, 3] m: y − (observed(y) − y), to first order, for all of it would make noise explode."""
        return 2 * y - self.observed(y)

    def observed_tangents(
        self, x: Array, tangents: Mapping[str, Array], frames: slice = slice(None), *, columns: bool = True
    ) -> dict[str, Array]:
        """name -> ∂(observed)/∂θ at some frames of cloth x [T, V, 3] m, from its own ∂x/∂θ [frames, V, 3]; the other frames stand still.

        columns: also those of the effects on the observation.
        """
        seen = dict(tangents)
        if self.observes:
            for name, dx in tangents.items():
                moving = np.zeros_like(x)
                moving[frames] = dx
                seen[name] = self.observed_direction(x, moving)[frames]
        for column, own in (self.observation_columns(x) if columns else {}).items():
            seen[column] = seen.get(column, 0.0) + own[frames]
        return seen

    def observation_columns(self, x: Array) -> dict[str, Array]:
        """column -> ∂(observed)/∂θ [T, V, 3] at fixed x [T, V, 3] m of the effects on the observation, by central differences."""
        found = {}
        for effect in self.effects:
            if "observe" in effect.acts_through:
                for column, plus, minus, δ in self._neighbours(effect):
                    found[column] = (plus.observed(x) - minus.observed(x)) / (2 * δ)
        return found

    @property
    def observes(self) -> bool:
        """Whether any effect makes the tracker report something else than the cloth as it is."""
        return any("observe" in e.acts_through and self.strength(e).any() for e in self.effects)

    def observed_direction(self, x: Array, dx: Array) -> Array:
        """What the tracker reports of a small motion dx [T, V, 3] of cloth at x [T, V, 3] m; any unit."""
        size = np.abs(dx).max(initial=0.0)
        if not size:
            return dx
        δ = 1e-3 / size  # [m] of motion
        return (self.observed(x + δ * dx) - self.observed(x - δ * dx)) / (2 * δ)

    def _driven(self, subject: Subject, motion: Motion) -> Motion:
        yielded = motion.yielded
        for effect in self.effects:
            motion = effect.motion(subject, motion, self.strength(effect))
        return replace(motion, yielded=yielded).given_way

    def _sums(self) -> dict[str, tuple[str, ...]]:
        """column -> parameters of the simulator, for effects that act through potentials or fabric."""
        acting = [e for e in self.effects if e.acts_through & {"potentials", "fabric"}]
        return {column: names for effect in acting for column, names in effect.parameters.items()}

    def _motion_modes(self, motion: Motion) -> dict[str, Motion]:
        modes = {}
        for effect in self.effects:
            if "motion" in effect.acts_through and effect.kind != "rerun":
                for column, plus, minus, δ in self._neighbours(effect):
                    a, b = (m.driven(motion) for m in (plus, minus))
                    modes[column] = Motion((a.collider - b.collider) / (2 * δ), (a.boundary - b.boundary) / (2 * δ))
        return modes

    def _neighbours(self, effect: Effect) -> "Iterator[tuple[str, Model, Model, float]]":
        """column, the models at ±δ in that strength, δ."""
        θ = self.strength(effect)
        for i, (column, s) in enumerate(zip(effect.columns, effect.strengths, strict=True)):
            δ = STEP * abs(s.typical)
            step = np.eye(len(θ))[i] * δ
            plus, minus = (replace(self, strengths={**self.strengths, effect.name: θ + sign * step}) for sign in (1, -1))
            yield column, plus, minus, δ


def _with_columns(frame: Frame, sums: Mapping[str, tuple[str, ...]], parameters: Sequence[str]) -> Frame:
    """The frame with the simulator's tangents added up to columns."""
    if not sums:
        return frame
    used = {name for names in sums.values() for name in names} - set(parameters)
    kept = {name: t for name, t in frame.tangents.items() if name not in used}
    columns = {c: tuple(sum(frame.tangents[n][k] for n in names) for k in (0, 1)) for c, names in sums.items()}
    return replace(frame, tangents={**kept, **columns})
