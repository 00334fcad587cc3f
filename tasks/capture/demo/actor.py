"""The actor: a body of seeded shape that performs a motion, and points of the surface that move with it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.model import BodyModel, Posed
from tasks.capture.demo.motion import Motion, dance
from tasks.geometry.distances import closest_points

Array = NDArray[np.float64]

SHAPE_SPREAD = 0.4  # standard deviation of the shape coefficients: within the crowd, so that the garments' cut fits


@dataclass(frozen=True)
class Actor:
    """model, shape [S], expression [E]; motion; rest (one body in the zero pose) and posed (all frames)."""

    model: BodyModel
    shape: Array
    expression: Array
    motion: Motion
    rest: Posed
    posed: Posed


@dataclass(frozen=True)
class Attached:
    """Points carried by the bones: rest [P, 3] m, weights [P, 55]."""

    rest: Array
    weights: Array

    def at(self, transforms: Array) -> Array:
        """Places [..., P, 3] m under bone transforms [..., 55, 4, 4]."""
        moved = np.einsum("pj,...jab->...pab", self.weights, transforms[..., :3, :], optimize=True)
        return np.einsum("...pab,pb->...pa", moved[..., :3], self.rest) + moved[..., 3]


def cast(model: BodyModel, *, frames: int, fps: float, energy: float, rng: np.random.Generator) -> Actor:
    """An actor of random shape who performs the dance of the demo."""
    shape = rng.normal(0, SHAPE_SPREAD, model.shape_directions.shape[2])
    expression = np.zeros(model.expression_directions.shape[2])
    rest = model.pose(shape, expression, np.zeros((55, 3)), np.zeros(3))
    motion = dance(rest.joints, model.parents, sole=rest.vertices[:, 1].min(), frames=frames, fps=fps, energy=energy)
    return Actor(model, shape, expression, motion, rest, model.pose(shape, expression, motion.pose, motion.translation))


def attach(points: Array, actor: Actor, *, frame: int | None = None) -> Attached:
    """Carry points [P, 3] m given at `frame` (None: in the rest pose) with the weights of the nearest point of the body."""
    posed = actor.rest if frame is None else Posed(*(a[frame] for a in (actor.posed.vertices, actor.posed.joints, actor.posed.transforms)))
    near = closest_points(points, posed.vertices, actor.model.faces)
    weights = np.einsum("pk,pkj->pj", near.barycentric, actor.model.weights[actor.model.faces[near.face]])
    moved = np.einsum("pj,jab->pab", weights, posed.transforms[:, :3])
    rest = np.linalg.solve(moved[..., :3], (points - moved[..., 3])[..., None])[..., 0]
    return Attached(rest, weights)
