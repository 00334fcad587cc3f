"""Simulate cloth: a generator of frames, deterministic on one thread, that knows no disk."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import Fault, refuse
from tasks.simulator import cipc_newton, newton
from tasks.simulator.base_model import base_problem
from tasks.simulator.cloth import Cloth, Collider
from tasks.simulator.doubts import fabric_faults
from tasks.simulator.fabric import Fabric
from tasks.simulator.newton import CONVERGED, Problem, Solution
from tasks.simulator.potential import Potential, Step
from tasks.simulator.preflight import Separated, inspect, separate
from tasks.simulator.settings import BASE, Settings, settings_faults
from tasks.simulator.standing import Standing
from tasks.simulator.tangents import Modes, Tangents
from tasks.simulator.time_integration import Rule, State, known, rule
from tasks.simulator.yielding import Yielded, give_way

Array = NDArray[np.float64]
SOLVERS = {"exact": newton.solve, "cipc": cipc_newton.solve}


@dataclass(frozen=True)
class Frame:
    """One frame: cloth x [V, 3] m and v [V, 3] m/s; tangents: name -> (∂x/∂θ, ∂v/∂θ) [V, 3]; Newton iterations of its steps; how it ended.

    `ending` is "converged" or a reason; after a frame that did not converge no other follows, and x is the last state that was reached.
    `collider` [C, 3] is where the collider stood, `yielded` how far it gave way there where it pinched cloth (and not in substeps before);
    `moved` [m]: in frame 0, the largest move that freed the start from the collider. `seconds`: processor time.
    """

    index: int
    x: Array
    v: Array
    collider: Array
    tangents: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    newton_iterations: int = 0
    ending: str = CONVERGED
    yielded: Yielded = field(default_factory=lambda: Yielded(np.empty(0)))
    moved: float = 0.0
    seconds: float = 0.0

    @property
    def converged(self) -> bool:
        """Whether the frame may be used."""
        return self.ending == CONVERGED


def simulate(
    cloth: Cloth,
    fabric: Fabric,
    collider: Collider,
    *,
    collider_motion: Array,
    boundary_motion: Array,
    fps: float,
    x0: Array | None = None,
    v0: Array | None = None,
    settings: Settings = BASE,
    potentials: Sequence[Potential] = (),
    tangents: Sequence[str] = (),
    start_modes: Modes | None = None,
    motion_modes: Modes | None = None,
    collider_rest: Array | None = None,
    resume: Standing | None = None,
    on_standing: Callable[[Standing], None] = lambda standing: None,
) -> Iterator[Frame]:
    """Frames 0..T−1 of cloth driven by collider_motion [T, C, 3] m and boundary_motion [T, B, 3] m (order of cloth.boundary), at fps [1/s].

    Frame 0 is the start: x0 [V, 3] (default: at rest shape) and v0 [V, 3] (default: at rest). Between frames both motions are linear.
    potentials: further terms beside the base model. tangents: names of parameters of any term; start_modes: name -> (∂x0, ∂v0) [V, 3];
    motion_modes: name -> (∂collider_motion [T, C, 3], ∂boundary_motion [T, B, 3]). collider_rest [C, 3] (default: its first frame) gives
    the collider's areas of contact, which the derivatives hold fixed. on_standing hears, before each frame is yielded, where the simulation
    stands; with resume and all else as before only the frames after it are yielded, the same ones bit by bit. Raises BadInput when arrays
    do not fit one another; whatever goes wrong in a step ends the frames with a reason instead.
    """
    x0 = cloth.x_rest.copy() if x0 is None else np.array(x0, float)
    v0 = np.zeros_like(x0) if v0 is None else np.array(v0, float)
    collider_motion, boundary_motion = _motion(collider_motion), _motion(boundary_motion)
    faults = _faults(cloth, collider, collider_motion, boundary_motion, fps, x0, v0, resume)
    refuse([*faults, *settings_faults(settings), *fabric_faults(fabric)])
    areas_of = collider_motion[0] if collider_rest is None else collider_rest
    problem = base_problem(cloth, fabric, collider, areas_of, settings=settings, potentials=potentials)
    walk = _Walk(problem, cloth, collider, settings)
    walk.on_standing = on_standing
    return _frames(walk, collider_motion, boundary_motion, fps, x0, v0, tuple(tangents), start_modes or {}, motion_modes or {}, resume)


def _frames(
    walk: "_Walk",
    collider_motion: Array,
    boundary_motion: Array,
    fps: float,
    x0: Array,
    v0: Array,
    names: tuple[str, ...],
    modes: Modes,
    motions: Modes,
    resume: Standing | None,
) -> Iterator[Frame]:
    clock = time.process_time()
    x0[walk.problem.boundary] = boundary_motion[0]
    start = walk.start(x0, v0, collider_motion[0]) if resume is None else None
    if names or modes or motions:
        walk.columns = Tangents(walk.problem, names, modes, motions, walk.now if resume is None else resume.now)
        if start is not None and start.by is not None:
            walk.columns.free(walk.now.x, *start.by)
    if resume is not None:
        walk.take(resume)
    if start is not None:
        yield walk.report(0, start.ending, 0, clock, moved=start.moved)
        if start.ending != CONVERGED:
            return
    for i in range(1 if resume is None else resume.index + 1, len(collider_motion)):
        clock = time.process_time()
        ending, iterations = walk.frame(i, collider_motion[i - 1 : i + 1], boundary_motion[i - 1 : i + 1], 1 / fps)
        yield walk.report(i, ending, iterations, clock)
        if ending != CONVERGED:
            return


class _Walk:
    """Where the simulation stands: the last two states and the last step."""

    on_standing: Callable[[Standing], None]
    columns: Tangents | None = None
    h_previous: float | None = None

    def __init__(self, problem: Problem, cloth: Cloth, collider: Collider, settings: Settings) -> None:
        self.problem, self.cloth, self.collider, self.settings = problem, cloth, collider, settings

    def start(self, x: Array, v: Array, collider: Array) -> Separated:
        """Take the first state, freed from the collider [C, 3] where it must be."""
        self.now = State(x, v, collider)
        collider = self._yielded(collider, x[self.cloth.boundary])
        free = (
            separate(self.problem, self.cloth, self.collider, x, collider) if self.settings.separate_start else self._checked(x, collider)
        )
        self.now = self.before = State(free.x, v, collider)
        for potential in self.problem.potentials:
            potential.begin(free.x)
        return free

    def report(self, index: int, ending: str, iterations: int, clock: float, moved: float = 0.0) -> Frame:
        """The frame as it stands."""
        if ending == CONVERGED:
            self.on_standing(self._standing(index))
        now, named = self.now, self.columns.named() if self.columns else {}
        seconds = time.process_time() - clock
        return Frame(index, now.x, now.v, now.collider, named, iterations, ending, self.yielded, moved, seconds)

    def _standing(self, index: int) -> Standing:
        memories = {(i, name): getattr(p, name) for i, p in enumerate(self.problem.potentials) for name in p.memory}
        columns = self.columns.columns if self.columns else {}
        return Standing(index, self.now, self.before, self.h_previous, self.problem.system.pattern, memories, columns)

    def take(self, standing: Standing) -> None:
        """Stand where another walk through the same simulation stood."""
        self.now, self.before, self.h_previous = standing.now, standing.before, standing.h_previous
        self.problem.system.take(standing.pattern)
        for (i, name), value in standing.memories.items():
            setattr(self.problem.potentials[i], name, value)
        if self.columns:
            self.columns.take(standing.columns)

    def frame(self, index: int, collider: Array, boundary: Array, duration: float) -> tuple[str, int]:
        """Go on to frame `index` along collider [2, C, 3] and boundary [2, B, 3]; (ending, Newton iterations)."""
        self.index, n = index, self.settings.substeps
        iterations = 0
        for k in range(n):
            a, b = k / n, (k + 1) / n
            # skin that is free of itself in two frames may enter itself between them
            end = self._yielded(_between(collider, b), _between(boundary, b))
            way = np.stack(
                [self.now.collider - a / (b - a) * (end - self.now.collider), end + (1 - b) / (b - a) * (end - self.now.collider)]
            )
            ending, used = self._interval(way, boundary, duration, a, b, self.settings.halvings)
            iterations += used
            if ending != CONVERGED:
                return f"{ending} (at {duration * (index - 1 + b):.4g} s)", iterations
        return CONVERGED, iterations

    def _yielded(self, collider: Array, pins: Array) -> Array:
        self.yielded = Yielded(np.zeros(len(collider)))
        if self.settings.yield_collider:
            clearance = 2 * self.settings.barrier_distance + self.settings.contact_offset
            collider, self.yielded = give_way(
                collider, self.collider.faces, cloth=self.now.x, pins=pins, clearance=clearance, held_edges=self.cloth.held_edges
            )
        return collider

    def _checked(self, x: Array, collider: Array) -> Separated:
        touching = self.problem.surface.offset * (1 + 1e-9)  # what is nearer than contact can push apart
        faults = inspect(self.problem, self.cloth, self.collider, x, collider, least=touching)
        return Separated(x, 0.0, "; ".join(map(str, faults)) or CONVERGED)

    def _interval(self, collider: Array, boundary: Array, duration: float, a: float, b: float, halvings: int) -> tuple[str, int]:
        """One step from share a to share b of the frame, or two of half its length if it fails."""
        solution = self._step(_between(collider, b), _between(boundary, b), b, duration * (b - a), duration * (self.index - 1 + b))
        if solution.converged or not halvings:
            return solution.ending, solution.iterations
        iterations = solution.iterations
        for left, right in ((a, (a + b) / 2), ((a + b) / 2, b)):
            ending, used = self._interval(collider, boundary, duration, left, right, halvings - 1)
            iterations += used
            if ending != CONVERGED:
                return ending, iterations
        return CONVERGED, iterations

    def _step(self, collider: Array, boundary: Array, share: float, h: float, time: float) -> Solution:
        r = rule(self.settings.integrator, h, self.h_previous)
        step = known(r, self.now, self.before, collider, time)
        self.problem.system.renew()
        self._look_ahead(step)
        solution = SOLVERS[self.settings.solver](self.problem, self.now.x, step, boundary_target=boundary)
        if solution.collider is not None:
            step = replace(step, collider=solution.collider)
        if solution.converged:
            self._accept(solution, step, r, share)
        return solution

    def _look_ahead(self, step: Step) -> None:
        """Ask for contacts where the cloth goes if it keeps its velocity. What earlier steps found is dropped, so that a resumed run sums
        in the same order.
        """
        surface = self.problem.surface
        surface.forget()
        surface.prepare(surface.join(step.x_n, step.collider_n), surface.join(step.x_n + step.h * step.v_n, step.collider))

    def _accept(self, solution: Solution, step: Step, r: Rule, share: float) -> None:
        if self.columns:
            self.columns.advance(solution.x, step, r, frame=self.index, share=share)
        for potential in self.problem.potentials:
            potential.accept(solution.x, step)
        self.before, self.now = self.now, State(solution.x, step.velocity(solution.x), step.collider)
        self.h_previous = r.h


def _between(pair: Array, share: float) -> Array:
    return pair[1] if share == 1 else (1 - share) * pair[0] + share * pair[1]


def _motion(given: Array) -> Array:
    """[T, N, 3]; what cannot be one stays as it is, to be refused."""
    given = np.asarray(given, float)
    return given.reshape(len(given), -1, 3) if len(given) and given.size % (3 * len(given)) == 0 else given


def _faults(
    cloth: Cloth, collider: Collider, motion: Array, boundary: Array, fps: float, x0: Array, v0: Array, resume: Standing | None
) -> list[Fault]:
    V, B, named = len(cloth.x_rest), len(cloth.boundary), collider.faces
    C = motion.shape[1] if motion.ndim == 3 else int(named.max(initial=-1)) + 1
    wanted = {
        "x0": (x0, (V, 3)),
        "v0": (v0, (V, 3)),
        "boundary_motion": (boundary, (len(motion), B, 3)),
        "collider_motion": (motion, (len(boundary), C, 3)),
    }
    faults = [Fault(name, f"shape {a.shape}", f"Give {shape}.") for name, (a, shape) in wanted.items() if a.shape != shape]
    if resume is not None and (resume.now.x.shape != (V, 3) or resume.now.collider.shape != (C, 3)):
        faults.append(Fault("resume", "it is not of this cloth and collider", "Begin anew."))
    faults += [Fault(name, "values that are not finite", "Repair them.") for name, (a, _) in wanted.items() if not np.isfinite(a).all()]
    wild = named[(named < 0) | (named >= C)]
    if len(wild):
        faults.append(Fault("collider.faces", f"they name vertex {wild[0]} of {C}", "Give the faces of collider_motion."))
    if not len(motion):
        faults.append(Fault("collider_motion", "it has no frames", "Give at least the start."))
    if not 0 < fps < np.inf:
        faults.append(Fault("fps", f"{fps}", "Give frames per second."))
    return faults
