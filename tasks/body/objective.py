"""What the body fit minimises, as energy, gradient and curvature of the unknowns of one frame: equations 2-3 of the supplement.

    L = Σ_q λ_q (N/C) Σ_c score d(e)  [reprojection.py]  +  Σ_i λ_i (z_i − z̄_i)²  (+ λ_β‖β‖² while the shape is free)
    z = (translation 3, pelvis to wrists 66, left hand 12, right hand 12 [, jaw 3, expression E])

`[…]` only when face points count. z̄ = 0, the rest pose, unless a pose is already known. Other points of the body compared with something
else than images take the place of the keypoints (`on_surface`). Equation 2 prints norms; squares are taken, as all of the SMPLify family
do: the pull of a plain norm does not fade at rest and would hold hands exactly at their mean until the images gain more than λ_m.
Limit: eyes do not turn.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tasks.body.keypoint_body import KeypointBody, PosedKeypoints, keypoint_body, surface_points
from tasks.body.model import JOINTS, Array, BodyModel
from tasks.body.reprojection import Sight
from tasks.body.skeleton import JOINT
from tasks.body.wholebody import BODY_AND_FEET, FACE_68, LEFT_HAND, NAMES, RIGHT_HAND
from tasks.geometry.cameras import Cameras
from tasks.geometry.rotations import axis_angle_from_matrix, matrix_from_axis_angle

HAND_COMPONENTS = 12
BODY_JOINTS = 22  # pelvis to wrists
NO_SHAPE = np.zeros(0)
FIRST_FINGER = (JOINT["left_index1"], JOINT["right_index1"])


@dataclass(frozen=True)
class FitWeights:
    """The λ of equations 2-3.

    `face` is the weight of the 68 face points, which equation 3 leaves out: at 0, jaw and expression stay at rest. `body_pose` is not the
    1e-3 of the supplement: that weighs a VPoser latent, which knows how joints go together (README.md has the sweep).
    """

    body: float = 1e-3
    hand: float = 1e-3
    face: float = 0.0
    hand_pose: float = 1.0
    body_pose: float = 0.3
    face_pose: float = 1e-1
    shape: float = 3e-2
    expression: float = 1e-1


class Comparison(Protocol):
    """What points of the body [q, 3] m are compared with in one frame: what cameras saw (`Sight`), or where skin was tracked."""

    def energy(self, p: Array) -> float:
        """E for points p [q, 3] m."""
        ...

    def expand(self, p: Array) -> tuple[float, Array, Array]:
        """E, its gradient [q, 3] 1/m and a curvature [q, 3, 3] 1/m² that is nowhere negative."""
        ...


@dataclass(frozen=True)
class Objective:
    """body: the keypoints that count, `used` [q] of 133 with `weight` [q]; rest [165] and basis [165,n−3−E] rad: pose = rest + basis z;
    prior [n]: λ_i; mean [n]: z̄; shape_prior: λ_β; shapes: how many coefficients of β are free (0 once it is frozen)."""

    body: KeypointBody
    used: NDArray[np.int64]
    weight: Array
    rest: Array
    basis: Array
    prior: Array
    mean: Array
    shape_prior: float
    shapes: int

    @staticmethod
    def of(model: BodyModel, weights: FitWeights) -> "Objective":
        """The objective with free shape."""
        face = weights.face > 0
        shapes, expressions = model.shape_directions.shape[2], model.expression_directions.shape[2] if face else 0
        weight = np.zeros(len(NAMES))
        weight[BODY_AND_FEET], weight[FACE_68], weight[LEFT_HAND], weight[RIGHT_HAND] = (
            weights.body,
            weights.face,
            weights.hand,
            weights.hand,
        )
        used = np.flatnonzero(weight)
        rest, basis = _pose_basis(model, jaw=face)
        pose_prior = [0.0] * 3 + [weights.body_pose] * 3 * (BODY_JOINTS - 1) + [weights.hand_pose] * 2 * HAND_COMPONENTS
        prior = [0.0] * 3 + pose_prior + face * ([weights.face_pose] * 3 + [weights.expression] * expressions)
        nothing = np.zeros(shapes + model.expression_directions.shape[2])
        body = keypoint_body(model).subset(used).shaped(nothing, slice(0, shapes + expressions))
        return Objective(body, used, weight[used], rest, basis, np.array(prior), np.zeros(len(prior)), weights.shape, shapes)

    def on_surface(self, model: BodyModel, vertices: NDArray[np.int64], barycentric: Array) -> "Objective":
        """The same for points of the surface, corners [q, 3] and barycentric [q, 3], with a face at rest."""
        nothing = np.zeros(self.shapes + model.expression_directions.shape[2])
        points = surface_points(model, vertices, barycentric).shaped(nothing, slice(0, self.shapes))
        return replace(self, body=points)

    def near(self, z: Array) -> "Objective":
        """The same drawn to z̄ = z [n]."""
        return replace(self, mean=z)

    def frozen(self, shape: Array) -> "Objective":
        """The same with the shape [S] built in."""
        free = self.body.joints_by_shape.shape[2]
        body = self.body.shaped(np.append(shape, np.zeros(free - self.shapes)), slice(self.shapes, free))
        return replace(self, body=body, shapes=0)

    def sight(self, cameras: Cameras, keypoints: Array, scores: Array) -> Sight:
        """One frame's detections [camera,133,2] px and scores [camera,133], the ones that count."""
        return Sight.of(cameras, keypoints[:, self.used], scores[:, self.used], self.weight)

    def energy(self, seen: Comparison, z: Array, shape: Array = NO_SHAPE) -> float:
        """L of one frame's unknowns z [n] and the free shape [S] (empty once frozen)."""
        return seen.energy(self._posed(z, shape).p) + self.prior @ (z - self.mean) ** 2 + self.shape_prior * (shape @ shape)

    def expand(self, seen: Comparison, z: Array, shape: Array = NO_SHAPE) -> tuple[float, Array, Array]:
        """L, gradient [S+n] and curvature [S+n,S+n] with respect to (shape, z)."""
        posed = self._posed(z, shape)
        E, g, C = seen.expand(posed.p)
        by_shape, by_pose = posed.by_shape(), posed.by_pose() @ self.basis
        move = np.broadcast_to(np.eye(3), (len(posed.p), 3, 3))
        J = np.concatenate([by_shape[..., : self.shapes], move, by_pose, by_shape[..., self.shapes :]], axis=2)
        λ, u = np.append(np.full(self.shapes, self.shape_prior), self.prior), np.append(shape, z - self.mean)
        n = J.shape[2]
        gradient = J.reshape(-1, n).T @ g.ravel() + 2 * λ * u
        curvature = J.reshape(-1, n).T @ (C @ J).reshape(-1, n) + 2 * np.diag(λ)
        return E + λ @ u**2, gradient, curvature

    def points(self, z: Array, shape: Array = NO_SHAPE) -> Array:
        """The keypoints that count [q,3] m."""
        return self._posed(z, shape).p

    def pose(self, z: Array) -> Array:
        """Axis-angles [55,3] rad."""
        return (self.rest + self.basis @ z[3 : 3 + self.basis.shape[1]]).reshape(JOINTS, 3)

    def expression(self, z: Array) -> Array:
        """ψ, empty when the face does not count."""
        return z[3 + self.basis.shape[1] :]

    def start(self, pose: Array, translation: Array) -> Array:
        """z [n] of a pose [55,3] and translation [3], with mean hands and a face at rest."""
        z = np.zeros(len(self.prior))
        z[:3], z[3 : 3 + 3 * BODY_JOINTS] = translation, pose[:BODY_JOINTS].ravel()
        return z

    def unknowns(self, pose: Array, translation: Array) -> Array:
        """z [n] of a fitted pose [55, 3] rad and translation [3] m."""
        z = np.zeros(len(self.prior))
        z[:3], z[3 : 3 + self.basis.shape[1]] = translation, self.basis.T @ (pose.ravel() - self.rest)
        return z

    def short_way(self, z: Array) -> Array:
        """The same pose with every angle at most π: rotation vectors grow past it while a body turns on."""
        z, at = z.copy(), slice(3, 3 + 3 * BODY_JOINTS)
        z[at] = axis_angle_from_matrix(matrix_from_axis_angle(z[at].reshape(-1, 3))).ravel()
        return z

    def _posed(self, z: Array, shape: Array) -> PosedKeypoints:
        return self.body.at(np.append(shape, self.expression(z)), self.pose(z), z[:3])


def _pose_basis(model: BodyModel, *, jaw: bool) -> tuple[Array, Array]:
    body, hands = 3 * BODY_JOINTS, 2 * HAND_COMPONENTS
    rest, basis = np.zeros(3 * JOINTS), np.zeros((3 * JOINTS, body + hands + 3 * jaw))
    basis[:body, :body] = np.eye(body)
    for side, first in enumerate(FIRST_FINGER):
        fingers, column = slice(3 * first, 3 * first + 45), body + side * HAND_COMPONENTS
        rest[fingers] = model.hand_mean[side]
        basis[fingers, column : column + HAND_COMPONENTS] = model.hand_components[side, :HAND_COMPONENTS].T
    if jaw:
        basis[3 * JOINT["jaw"] : 3 * JOINT["jaw"] + 3, -3:] = np.eye(3)
    return rest, basis
