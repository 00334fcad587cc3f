"""Motion of the cloth in time by TR-BDF2: a trapezoidal stage and a BDF2 stage per step, second order and L-stable.

Both stages have the form x = x̂ + s v, v = v̂ + s a with s = (1 − 1/√2) h, and are solved for M a = f(x, v, t) by Newton's method on the
balance of forces (no energy is minimised, so forces need no potential).
Source: Bank et al. 1985; Hosea & Shampine 1996.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator.bending import bend
from tasks.exam.generator.bodies import Body, Placed, Pose
from tasks.exam.generator.body_contact import BodyContact
from tasks.exam.generator.fabric import Elements, Fabric, Memory
from tasks.exam.generator.garments import Sheet
from tasks.exam.generator.matrix import Indefinite, Matrix
from tasks.exam.generator.membrane import membrane
from tasks.exam.generator.self_contact import SelfContact
from tasks.geometry.meshes import vertex_normals

Array = NDArray[np.float64]
GAMMA = 2 - np.sqrt(2)
SHARE = 1 - 1 / np.sqrt(2)  # s/h
TOLERANCE = 0.2  # m/s², root mean square of the accelerations that are left over
STANDSTILL = 5e-6  # m: a Newton step so small ends a stage too, if what is left over is below ten tolerances
ITERATIONS = 40
EXACT_BELOW = 30.0  # m/s², left over: nearer to a solution the exact matrix is used, as long as it gains a factor of two
HALVINGS = 4


class Diverged(ArithmeticError):
    """A step had no solution, however short."""


@dataclass(frozen=True)
class Moment:
    """Where forces on nodes are asked for: x, v, a [V, 3], time t [s], stage size s [s], normals [V, 3] at the last state, areas and masses [V]."""

    x: Array
    v: Array
    a: Array
    t: float
    s: float
    normal: Array
    area: Array
    mass: Array
    body: Placed


NodeForce = Callable[[Moment], tuple[Array, Array]]  # force [V, 3] and −∂f/∂x [V, 3, 3] with velocity's over s and acceleration's over s²


@dataclass(frozen=True)
class World:
    """All that acts on a sheet: fabric, friction with the body, how far the body stands out [m], gravity [3], forces on nodes, motion.

    pinned(t) -> [B, 3] m places of the pinned nodes. begins [s]: until then everything is still.
    """

    sheet: Sheet
    fabric: Fabric
    body: Body
    pose: Pose
    pinned: Callable[[float], Array]
    friction: float = 0.2
    offset: float = 0.0
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    forces: tuple[NodeForce, ...] = ()
    begins: float = 0.0


@dataclass
class State:
    """Place, velocity, acceleration [V, 3], time, and what the fabric remembers."""

    x: Array
    v: Array
    a: Array
    t: float
    memory: Memory


class Stepper:
    """Steps one world."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.elements = Elements(world.sheet, world.fabric)
        self.matrix = Matrix(len(world.sheet.rest), world.sheet.pinned, (self.elements.faces, self.elements.hinges))
        self.contact = BodyContact(self.elements.mass, world.friction, world.offset)
        density = float(self.elements.mass.sum() / self.elements.area.sum())
        self.self_contact = SelfContact(world.sheet.rest, self.elements.faces, density)
        self.fixed = np.zeros(len(world.sheet.rest), bool)
        self.fixed[world.sheet.pinned] = True

    def rest(self, x: Array, *, seconds: float = 1.2, damping: float = 6.0) -> State:
        """Hanging still when the world begins, from x [V, 3]: backward Euler under heavy damping, with everything held where it is then."""
        t = self.world.begins
        still = replace(self.world, forces=(*self.world.forces, _brake(damping)))
        settling, self.world = self.world, still
        state = State(x.copy(), np.zeros_like(x), np.zeros_like(x), t, self.elements.memory(x))
        h, done = 0.005, 0.0
        try:
            while done < seconds:
                state = self._stage(state, state.x, state.v, self._kept(state, 0.0), h, t)
                done += h
                h = min(1.2 * h, 0.03)
        finally:
            self.world = settling
        at_rest = self.elements.memory(state.x) if not self.elements.remembers else replace(state.memory)
        at_rest.e_rate, at_rest.φ_rate = 0 * at_rest.e_rate, 0 * at_rest.φ_rate
        return State(state.x, np.zeros_like(x), np.zeros_like(x), t, at_rest)

    def frames(self, start: State, times: Sequence[float], steps: int) -> Iterator[State]:
        """The state at every one of `times`, the first of which is the start's; `steps` between two of them."""
        yield start
        state = start
        for t in times[1:]:
            h = (t - state.t) / steps
            for _ in range(steps):
                state = self._step(state, h, HALVINGS)
            yield state

    def accelerations(self, state: State) -> Array:
        """f/m [V, 3] m/s² at a state of this or of another world with the same sheet."""
        m, s = state.memory, 0.01
        body = self.world.body.placed(self.world.pose, state.t)
        self.contact.remember(state.x, body)
        E = self.elements
        moment = Moment(state.x, state.v, state.a, state.t, s, vertex_normals(state.x, E.faces), E.node_area, E.mass, body)
        self.self_contact.watch(state.x)
        return self._balance(moment, (m.e - s * m.e_rate, m.φ - s * m.φ_rate), m, False)[0] / E.mass[:, None]

    def _step(self, old: State, h: float, halvings: int) -> State:
        force = self.contact.normal_force
        try:
            s = SHARE * h
            middle = self._stage(old, old.x + s * old.v, old.v + s * old.a, self._kept(old, s), s, old.t + GAMMA * h)
            c1, c2 = 1 / (GAMMA * (2 - GAMMA)), (1 - GAMMA) ** 2 / (GAMMA * (2 - GAMMA))
            m, o = middle.memory, old.memory
            kept = (c1 * m.e - c2 * o.e, c1 * m.φ - c2 * o.φ)
            return self._stage(middle, c1 * middle.x - c2 * old.x, c1 * middle.v - c2 * old.v, kept, s, old.t + h)
        except (Diverged, Indefinite):
            if not halvings:
                raise Diverged(f"no solution at t = {old.t:.3f} s") from None
            self.contact.normal_force = force
            return self._step(self._step(old, h / 2, halvings - 1), h / 2, halvings - 1)

    def _kept(self, state: State, s: float) -> tuple[Array, Array]:
        """ê, φ̂ of a stage that starts at `state`: with s = 0 backward Euler."""
        m = state.memory
        return m.e + s * m.e_rate, m.φ + s * m.φ_rate

    def _stage(self, old: State, x_hat: Array, v_hat: Array, kept: tuple[Array, Array], s: float, t: float) -> State:
        """Solve x = x̂ + s v, v = v̂ + s a, M a = f at time t."""
        E, w = self.elements, self.world
        body = w.body.placed(w.pose, t)
        x = x_hat + s * v_hat
        x[self.fixed] = w.pinned(t)
        x = self.contact.freed(x, body, self.fixed)
        x = self._uncrossed(old.x, x, body)
        normal = vertex_normals(old.x, E.faces)
        free = self.matrix.free
        before, stride, convex = np.inf, np.inf, True
        for _ in range(ITERATIONS):
            v = (x - x_hat) / s
            a = (v - v_hat) / s
            moment = Moment(x, v, a, t, s, normal, E.node_area, E.mass, body)
            f, data, extra, strain, fold, stress, moments = self._balance(moment, kept, old.memory, convex)
            r = f - E.mass[:, None] * a
            left = np.sqrt(np.sum(r[free] ** 2 / E.mass[free, None]) / E.mass[free].sum())
            if left < TOLERANCE or (left < 10 * TOLERANCE and stride < STANDSTILL):
                break
            try:
                p = self.matrix.solve(data, extra, r)
            except Indefinite:
                if convex:
                    raise
                convex = True
                continue
            convex = left > 0.5 * before or left > EXACT_BELOW
            before = left
            p *= min(1.0, 0.05 / max(np.abs(p).max(), 1e-12))
            p = self.contact.shortened(x, p, body)
            stride = np.abs(p).max()
            x = x + self.self_contact.largest_step(x, x + p) * p
            self.self_contact.watch(x)
        else:
            if left > 100 * TOLERANCE:
                raise Diverged
        self.contact.remember(x, body)
        memory = Memory(
            strain,
            (strain - kept[0]) / s,
            fold,
            (fold - kept[1]) / s,
            np.stack([strain[:, 2], stress], 1),
            np.stack([fold, moments], 1),
            old.memory.yielded,
        )
        if E.fabric.crease:
            memory.yielded = memory.creased(E)
        return State(x, v, a, t, memory)

    def _uncrossed(self, old: Array, guess: Array, body: Placed) -> Array:
        """The guess, or as much of the way to it as the cloth can go without passing through itself."""
        self.self_contact.watch(old)
        self.self_contact.watch(guess)
        if not self.self_contact.active:
            return guess
        share = self.self_contact.largest_step(old, guess)
        if share >= 1:
            return guess
        x = old + share * (guess - old)
        x[self.fixed] = guess[self.fixed]
        return self.contact.freed(x, body, self.fixed)

    def _balance(self, m: Moment, kept: tuple[Array, Array], memory: Memory, convex: bool):
        E, w = self.elements, self.world
        data = np.zeros(self.matrix.entries)
        f = E.mass[:, None] * np.array(w.gravity)
        F = E.fabric
        slots = self.matrix.slots
        strain, stress = membrane(
            m.x,
            E.faces,
            E.gradients,
            E.area,
            E.scale,
            E.D,
            F.stiffening,
            F.membrane_viscosity,
            kept[0],
            m.s,
            E.shear_limit,
            memory.shear,
            f,
            slots[0],
            data,
            convex,
        )
        fold, moments = bend(
            m.x,
            E.hinges,
            E.rigidity,
            memory.rest_fold(E),
            F.bending_viscosity,
            kept[1],
            m.s,
            E.bend_limit,
            E.bend_reach,
            memory.fold,
            f,
            slots[1],
            data,
        )
        H = (E.mass / m.s**2)[:, None, None] * np.eye(3)
        for force in (self._touch, *w.forces):
            df, dH = force(m)
            f += df
            H += dH
        self.matrix.add_nodes(data, H)
        df, extra = self.self_contact.forces(m.x)
        return f + df, data, extra, strain, fold, stress, moments

    def _touch(self, m: Moment) -> tuple[Array, Array]:
        return self.contact.forces(m.x, m.v, m.body, m.s)


def _brake(rate: float) -> NodeForce:
    """Damping of all motion, to come to rest."""

    def force(m: Moment) -> tuple[Array, Array]:
        return -rate * m.mass[:, None] * m.v, (rate * m.mass / m.s)[:, None, None] * np.eye(3)

    return force
