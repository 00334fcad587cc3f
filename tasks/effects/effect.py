"""What an effect is: something that acts on cloth, on what drives it or on its observation, and that the base model leaves out.

An effect is one file whose `EFFECT` is an instance of `Effect`. It states what it is (name, kind, strengths, claims) and overrides the one
or two hooks through which it acts. At strength zero every hook must leave the base model as it was, bit for bit. Where a hook adds
potentials or changes the fabric, the derivative of the motion in a strength is the sum of the simulator's tangents named in `parameters`;
where it moves what drives the cloth or what is observed of it, `model` differentiates the hook.

The strength of an effect is its departure from the base model in SI units; without a weight, forces and masses count per areal density.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from tasks.simulator import Cloth, Collider, Fabric, Settings
from tasks.simulator.potential import Potential

Array = NDArray[np.float64]
Kind = Literal["potential", "force", "state", "collider", "observation", "rerun"]
STILL = 1e-3  # [m/s] a body that moves less tells nothing of time
Keeps = Literal["rest", "statics", "momentum", "energy", "shape", "gauge"]


@dataclass(frozen=True)
class Strength:
    """One number of an effect: symbol, SI unit, a typical strength and the plausible range; zero is always 0."""

    symbol: str
    unit: str
    typical: float
    low: float
    high: float


@dataclass(frozen=True)
class Subject:
    """What effects act on: the cloth, its fabric, the collider's faces, zone [V] of each vertex (free, hem, seam, contact, pinned), fps [1/s]."""

    cloth: Cloth
    fabric: Fabric
    collider: Collider
    zone: NDArray[np.str_]
    fps: float


@dataclass(frozen=True)
class Motion:
    """What drives the cloth: collider [T, C, 3] m and boundary nodes [T, B, 3] m; yielded [T, C, 3] m: by what the collider has given way
    (`cloth/yielded_collider.py`) where effects have moved it, which is not at the same time where they make it late.
    """

    collider: Array
    boundary: Array
    yielded: Array | None = None

    @property
    def given_way(self) -> "Motion":
        """The same with a collider that has."""
        return self if self.yielded is None else Motion(self.collider + self.yielded, self.boundary)

    def cut(self, frames: slice) -> "Motion":
        """Some of the frames."""
        return Motion(self.collider[frames], self.boundary[frames], None if self.yielded is None else self.yielded[frames])


@dataclass(frozen=True)
class MeshDoubt:
    """What a coarse mesh, and states from noisy frames, leave in doubt, as standard deviations: contact [m], where the body holds cloth;
    scale [1] of all lengths; calmed [s²]: τ² by which states are smoothed in time themselves.

    body_speed [m/s]: root mean square.
    """

    contact: float
    body_speed: float
    scale: float
    calmed: float = 0.0

    @property
    def arrival(self) -> float:
        """When the body meets cloth [s]."""
        return self.contact / max(self.body_speed, STILL)


class Effect:
    """A suspect. Subclasses set the class variables and override hooks.

    kind: potential (an energy or dissipation), force (lagged, without potential), state (has a memory), collider (moves what drives the
    cloth), observation (changes what is seen of it), rerun (has no tangent: computed anew, in another way).
    keeps: what it leaves as the base model has it: rest (cloth hanging still without contact), statics (any cloth at rest), gauge (motion
    depends on ratios to the density only); and of free flying cloth, if it moves that: momentum, energy (never adds any), shape (moves cloth
    only as a whole).
    confused_with: names of effects that some recordings cannot tell from it.
    """

    name: ClassVar[str]
    kind: ClassVar[Kind]
    strengths: ClassVar[tuple[Strength, ...]]
    keeps: ClassVar[frozenset[Keeps]] = frozenset()
    confused_with: ClassVar[frozenset[str]] = frozenset()

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the tangents, one per strength: the effect's own name, with the symbol after a dot where there are several."""
        if len(self.strengths) == 1:
            return (self.name,)
        return tuple(f"{self.name}.{s.symbol}" for s in self.strengths)

    @property
    def parameters(self) -> dict[str, tuple[str, ...]]:
        """column -> the simulator's parameters whose tangents add up to it: of its own potentials, unless it changes the fabric."""
        return {column: (column,) for column in self.columns}

    @property
    def typical(self) -> Array:
        """Typical strengths [K]."""
        return np.array([s.typical for s in self.strengths])

    def fabric(self, fabric: Fabric, θ: Sequence[float]) -> Fabric:
        """The fabric at strengths θ [K]."""
        return fabric

    def settings(self, settings: Settings, θ: Sequence[float]) -> Settings:
        """The numerical settings at strengths θ [K]."""
        return settings

    def potentials(self, subject: Subject, θ: Sequence[float]) -> tuple[Potential, ...]:
        """Terms beside the base model at strengths θ [K]; those of `columns` that they differentiate stand in their `parameters`."""
        return ()

    def motion(self, subject: Subject, motion: Motion, θ: Sequence[float]) -> Motion:
        """What drives the cloth if the motion given is wrong by θ [K]."""
        return motion

    def subject(self, subject: Subject, θ: Sequence[float]) -> Subject:
        """The subject computed in another way, on another mesh: the given vertices stay the first ones."""
        return subject

    def start(self, subject: Subject, x: Array, θ: Sequence[float]) -> Array:
        """A field [V, 3] of the given subject on the vertices of the other one."""
        return x

    def observe(self, subject: Subject, x: Array, θ: Sequence[float]) -> Array:
        """What a tracker with this fault reports [T, V, 3] m of cloth that is at x [T, V, 3] m."""
        return x

    def feigned(self, doubt: MeshDoubt) -> Array:
        """Standard deviations [K] of the strengths that a coarse mesh alone may feign."""
        return np.zeros(len(self.strengths))

    @property
    def acts_through(self) -> frozenset[str]:
        """The hooks that this effect overrides."""
        hooks = ("fabric", "settings", "potentials", "motion", "subject", "start", "observe")
        return frozenset(h for h in hooks if getattr(type(self), h) is not getattr(Effect, h))
