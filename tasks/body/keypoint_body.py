"""The body reduced to its keypoints: positions and exact derivatives, without ever posing the other ten thousand vertices.

    p_q = t + Σ_k A_k m_qk,    m_qk = Σ_c b_qc w_ck (x_c, 1)

A_k moves bone k from rest, b are barycentric shares of keypoint q in vertices c, w their skin weights. The moments m are linear in shape
and expression. With world rotation vectors ω_j = R_parent(j) L(θ_j) δθ_j (L the left Jacobian of SO(3)):

    ∂p_q = ω_j × Σ_{k below j} (A_k m_qk − μ_qk g_j),      g_j the joint, μ_qk the last entry of m_qk
    ∂p_q/∂β = Σ_k R_k ∂x_qk/∂β + μ_qk (∂g_k/∂β − R_k ∂J_k/∂β)

Source: derivation here; held by test to finite differences and to `BodyModel.pose`. L(θ): Barfoot, "State Estimation for Robotics" (2017),
eq. 7.77.
Limit: the derivative leaves out the pose correctives (millimetres, licensed models only); the positions include them.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.body.model import JOINTS, Array, BodyModel, from_rest, pose_feature, world_transforms
from tasks.body.wholebody import placement
from tasks.geometry.rotations import matrix_from_axis_angle, skew


@dataclass(frozen=True)
class KeypointBody:
    """first [q,55,3], first_by_shape [q,55,3,S+E] m and zeroth [q,55]: the moments m and their derivative; joints [55,3] and
    joints_by_shape [55,3,S+E] m; correctives [q,55,3,486] m or None; below [55,55] bool: bone k hangs on joint j."""

    first: Array
    first_by_shape: Array
    zeroth: Array
    joints: Array
    joints_by_shape: Array
    correctives: Array | None
    parents: NDArray[np.int64]
    below: NDArray[np.bool_]

    def at(self, coefficients: Array, pose: Array, translation: Array) -> "PosedKeypoints":
        """Keypoints for shape and expression in one vector [S+E], pose [55,3] rad, translation [3] m."""
        R = matrix_from_axis_angle(pose)
        first, joints = self.first + self.first_by_shape @ coefficients, self.joints + self.joints_by_shape @ coefficients
        if self.correctives is not None:
            first = first + self.correctives @ pose_feature(R)
        G = world_transforms(R, joints, self.parents)
        A = from_rest(G, joints)
        carried = np.einsum("kab,qkb->qka", A[:, :3, :3], first) + self.zeroth[..., None] * A[:, :3, 3]
        return PosedKeypoints(carried.sum(axis=1) + translation, carried, G, pose, self)

    def shaped(self, coefficients: Array, free: slice) -> "KeypointBody":
        """The same body with this shape and expression [S+E] built in; only the coefficients `free` can still be varied, from there."""
        first, joints = self.first + self.first_by_shape @ coefficients, self.joints + self.joints_by_shape @ coefficients
        by_shape, joints_by_shape = self.first_by_shape[..., free], self.joints_by_shape[..., free]
        return replace(self, first=first, joints=joints, first_by_shape=by_shape, joints_by_shape=joints_by_shape)

    def subset(self, keypoints: NDArray[np.int64]) -> "KeypointBody":
        """The same body with these keypoints only."""
        correctives = None if self.correctives is None else self.correctives[keypoints]
        first, by_shape = self.first[keypoints], self.first_by_shape[keypoints]
        return replace(self, first=first, first_by_shape=by_shape, zeroth=self.zeroth[keypoints], correctives=correctives)


@dataclass(frozen=True)
class PosedKeypoints:
    """p [q,3] m, and their derivatives on demand; carried [q,55,3] m: what each bone contributes."""

    p: Array
    carried: Array
    G: Array
    pose: Array
    body: KeypointBody

    def by_pose(self) -> Array:
        """∂p/∂θ [q,3,165] m/rad."""
        body, G = self.body, self.G
        arm = body.below.astype(float) @ self.carried - (body.zeroth @ body.below.T)[..., None] * G[:, :3, 3]
        frame = np.where(body.parents[:, None, None] >= 0, G[body.parents, :3, :3], np.eye(3)) @ left_jacobian(self.pose)
        a, ω = np.moveaxis(arm, 2, 0)[..., None], np.moveaxis(frame, 1, 0)[:, None]  # [3, q, 55, 1], [3, 1, 55, column]
        turned = [ω[1] * a[2] - ω[2] * a[1], ω[2] * a[0] - ω[0] * a[2], ω[0] * a[1] - ω[1] * a[0]]  # ω × a
        return np.stack(turned, axis=1).reshape(len(self.p), 3, -1)

    def by_shape(self) -> Array:
        """∂p/∂(β, ψ) [q,3,S+E] m."""
        R, body = self.G[:, :3, :3], self.body
        moved = np.zeros_like(body.joints_by_shape)  # of the posed joints
        for j, parent in enumerate(body.parents):
            moved[j] = body.joints_by_shape[j]
            if parent >= 0:
                moved[j] = moved[parent] + R[parent] @ (body.joints_by_shape[j] - body.joints_by_shape[parent])
        moved = moved - R @ body.joints_by_shape
        return np.einsum("kab,qkbs->qas", R, body.first_by_shape, optimize=True) + np.einsum("qk,kas->qas", body.zeroth, moved)


def keypoint_body(model: BodyModel) -> KeypointBody:
    """The 133 keypoints of a model."""
    place = placement(model)
    body = surface_points(model, place.vertices, place.barycentric)
    for q in np.flatnonzero(place.joint >= 0):  # a joint is a point carried by its own bone
        j = place.joint[q]
        body.zeroth[q], body.first[q], body.first_by_shape[q] = 0, 0, 0
        body.zeroth[q, j], body.first[q, j], body.first_by_shape[q, j] = 1, body.joints[j], body.joints_by_shape[j]
        if body.correctives is not None:
            body.correctives[q] = 0
    return body


def surface_points(model: BodyModel, vertices: NDArray[np.int64], barycentric: Array) -> KeypointBody:
    """Points of the surface: corners [q, 3] of their faces and barycentric [q, 3]."""
    directions = np.concatenate([model.shape_directions, model.expression_directions], axis=2)
    joints = model.joint_regressor @ model.template
    joints_by_shape = (model.joint_regressor @ directions.reshape(len(directions), -1)).reshape(JOINTS, 3, -1)
    share = barycentric[..., None] * model.weights[vertices]  # [q, corner, bone]
    first = np.einsum("qck,qca->qka", share, model.template[vertices])
    first_by_shape = np.einsum("qck,qcas->qkas", share, directions[vertices], optimize=True)
    correctives = None
    if model.pose_directions is not None:
        correctives = np.einsum("qck,qcap->qkap", share, model.pose_directions[vertices], optimize=True)
    return KeypointBody(
        first, first_by_shape, share.sum(axis=1), joints, joints_by_shape, correctives, model.parents, _below(model.parents)
    )


def left_jacobian(r: Array) -> Array:
    """L(r) [..., 3, 3] with exp(r + δ) ≈ exp(L δ) exp(r); r [..., 3] rad."""
    θ = np.linalg.norm(r, axis=-1)[..., None, None]
    K = skew(r)
    small = θ < 1e-3
    safe = np.where(small, 1.0, θ)
    c = np.where(small, 1 / 6 - θ**2 / 120, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + np.sinc(θ / (2 * np.pi)) ** 2 / 2 * K + c * (K @ K)


def _below(parents: NDArray[np.int64]) -> NDArray[np.bool_]:
    below = np.eye(JOINTS, dtype=bool)
    for k in range(JOINTS):
        j = parents[k]
        while j >= 0:
            below[j, k] = True
            j = parents[j]
    return below
