"""SMPL-X: a human of shape β, expression ψ and pose θ, by linear blend skinning. Reads any .npz in the layout of SMPLX_NEUTRAL.npz.

    x_s(β, ψ) = x̄ + Σ β_s S_s + Σ ψ_e E_e                 shaped rest vertices
    J(β, ψ)   = 𝒥 x_s                                       joints
    x_p       = x_s + P (R(θ) − I)                          pose correctives
    x         = Σ_j w_j A_j(θ, J) x_p + t                   A_j: rest position to posed position of bone j

Source: Loper et al., "SMPL" (2015), eq. 2-4 and 8-10; Pavlakos et al., "Expressive Body Capture" (2019). Held by test to the `smplx`
package. Limits: 10 shape and 10 expression coefficients unless asked for more; pose angles count from the flat hand (`flat_hand_mean=True`
in smplx); rotation is about the pelvis joint, not the origin (EasyMocap files differ, see their `Rh`, `Th`).
"""

import zlib
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from tasks.body.skeleton import JOINT_NAMES
from tasks.geometry.faults import Fault, refuse
from tasks.geometry.meshes import components
from tasks.geometry.rotations import matrix_from_axis_angle

Array = NDArray[np.float64]
JOINTS = len(JOINT_NAMES)
POSE_FEATURES = 9 * (JOINTS - 1)
WIDE_SHAPE_SPACE = 300  # files with 400 directions keep expressions after 300 shapes, files with 20 after 10
REMEDY = (
    "Point body.model at an SMPL-X file (SMPLX_NEUTRAL.npz from https://smpl-x.is.tue.mpg.de), or leave the setting out for the demo body."
)
ARRAYS = {  # key -> shape, with None for sizes that differ between files
    "v_template": (None, 3),
    "f": (None, 3),
    "weights": (None, JOINTS),
    "shapedirs": (None, 3, None),
    "posedirs": (None, 3, POSE_FEATURES),
    "J_regressor": (JOINTS, None),
    "kintree_table": (2, JOINTS),
    "hands_componentsl": (45, 45),
    "hands_componentsr": (45, 45),
    "hands_meanl": (45,),
    "hands_meanr": (45,),
    "lmk_faces_idx": (51,),
    "lmk_bary_coords": (51, 3),
    "dynamic_lmk_faces_idx": (None, 17),
    "dynamic_lmk_bary_coords": (None, 17, 3),
}


@dataclass(frozen=True)
class Posed:
    """vertices [..., V, 3] m; joints [..., 55, 3] m; transforms [..., 55, 4, 4] from rest to world, translation included."""

    vertices: Array
    joints: Array
    transforms: Array


@dataclass(frozen=True)
class BodyModel:
    """template [V,3] m; faces [F,3]; weights [V,55]; shape_directions [V,3,S] and expression_directions [V,3,E] m; pose_directions
    [V,3,486] m or None (no correctives); joint_regressor [55,V] sparse; parents [55] (−1 at the pelvis); hand_components [2,45,45] and
    hand_mean [2,45] rad (left, right); landmark_faces [68] and landmark_barycentric [68,3] in iBUG order; vertex_ids {name: vertex};
    skin [V] bool: vertices of the closed outer surface (False for eyeballs)."""

    template: Array
    faces: NDArray[np.int32]
    weights: Array
    shape_directions: Array
    expression_directions: Array
    pose_directions: Array | None
    joint_regressor: csr_array
    parents: NDArray[np.int64]
    hand_components: Array
    hand_mean: Array
    landmark_faces: NDArray[np.int64]
    landmark_barycentric: Array
    vertex_ids: dict[str, int]
    skin: NDArray[np.bool_]

    @staticmethod
    def load(path: Path | str, *, shapes: int = 10, expressions: int = 10) -> "BodyModel":
        """Read an SMPL-X .npz. Raises BadInput naming every key that is missing or misshapen."""
        arrays = _read(Path(path))
        first = WIDE_SHAPE_SPACE if arrays["shapedirs"].shape[2] >= WIDE_SHAPE_SPACE + 100 else 10
        directions = np.asarray(arrays["shapedirs"], dtype=float)
        correctives = arrays["posedirs"] if arrays["posedirs"].any() else None
        parents = np.asarray(arrays["kintree_table"][0]).astype(np.int64)
        parents[0] = -1  # stored as 2³² − 1
        faces = np.asarray(arrays["f"]).astype(np.int32)
        return BodyModel(
            template=np.asarray(arrays["v_template"], dtype=float),
            faces=faces,
            weights=np.asarray(arrays["weights"], dtype=float),
            shape_directions=directions[:, :, : min(shapes, first)],
            expression_directions=directions[:, :, first : first + expressions],
            pose_directions=None if correctives is None else correctives.astype(float),
            joint_regressor=csr_array(np.asarray(arrays["J_regressor"], dtype=float)),
            parents=parents,
            hand_components=np.stack([arrays["hands_componentsl"], arrays["hands_componentsr"]]).astype(float),
            hand_mean=np.stack([arrays["hands_meanl"], arrays["hands_meanr"]]).astype(float),
            # row 0 of the contour table is the one for a head seen from the front
            landmark_faces=np.concatenate([arrays["dynamic_lmk_faces_idx"][0], arrays["lmk_faces_idx"]]).astype(np.int64),
            landmark_barycentric=np.concatenate([arrays["dynamic_lmk_bary_coords"][0], arrays["lmk_bary_coords"]]).astype(float),
            vertex_ids=_vertex_ids(arrays),
            skin=_skin(arrays, faces),
        )

    def pose(self, shape: Array, expression: Array, pose: Array, translation: Array) -> Posed:
        """Posed body for shape [..., S], expression [..., E], axis-angles pose [..., 55, 3] rad, translation [..., 3] m.

        Leading axes broadcast. Fewer shape or expression coefficients than the model has count as zeros after them.
        """
        x = self.template + _along(self.shape_directions, shape) + _along(self.expression_directions, expression)
        joints = np.stack([self.joint_regressor @ part for part in x.reshape(-1, *self.template.shape)]).reshape(*x.shape[:-2], JOINTS, 3)
        R = matrix_from_axis_angle(pose)
        if self.pose_directions is not None:
            x = x + np.einsum("vcp,...p->...vc", self.pose_directions, pose_feature(R), optimize=True)
        G = world_transforms(R, joints, self.parents)
        A = from_rest(G, joints)
        moved = np.einsum("vj,...jab->...vab", self.weights, A[..., :3, :], optimize=True)
        t = np.asarray(translation, dtype=float)[..., None, :]
        vertices = np.einsum("...vab,...vb->...va", moved[..., :3], x, optimize=True) + moved[..., 3] + t
        A = A.copy()
        A[..., :3, 3] += t
        return Posed(vertices, G[..., :3, 3] + t, A)


def pose_feature(R: Array) -> Array:
    """What pose correctives are linear in: R − I of all joints but the pelvis, [..., 55, 3, 3] -> [..., 486]."""
    return (R[..., 1:, :, :] - np.eye(3)).reshape(*R.shape[:-3], POSE_FEATURES)


def world_transforms(R: Array, joints: Array, parents: NDArray[np.int64]) -> Array:
    """Bone frames G [..., 55, 4, 4] in the world, from joint rotations R [..., 55, 3, 3] and rest joints [..., 55, 3] m."""
    batch = np.broadcast_shapes(R.shape[:-3], joints.shape[:-2])
    G = np.zeros((*batch, JOINTS, 4, 4))
    G[..., 3, 3] = 1
    for j, parent in enumerate(parents):
        if parent < 0:
            G[..., j, :3, :3], G[..., j, :3, 3] = R[..., j, :, :], joints[..., j, :]
        else:
            G[..., j, :3, :3] = G[..., parent, :3, :3] @ R[..., j, :, :]
            offset = (joints[..., j, :] - joints[..., parent, :])[..., None]
            G[..., j, :3, 3] = (G[..., parent, :3, :3] @ offset)[..., 0] + G[..., parent, :3, 3]
    return G


def from_rest(G: Array, joints: Array) -> Array:
    """A_j [..., 55, 4, 4]: takes a rest point to where bone j carries it."""
    A = G.copy()
    A[..., :3, 3] -= np.einsum("...jab,...jb->...ja", G[..., :3, :3], joints)
    return A


def _along(directions: Array, coefficients: Array) -> Array:
    coefficients = np.asarray(coefficients, dtype=float)
    return np.einsum("vcs,...s->...vc", directions[:, :, : coefficients.shape[-1]], coefficients, optimize=True)


def _read(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        refuse([Fault(str(path), "no such file", REMEDY)])
    if not is_zipfile(path):
        refuse([Fault(str(path), "not an .npz", REMEDY)])
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {key: stored[key] for key in (*ARRAYS, "vertex_ids", "vertex_id_names") if key in stored}
    except (ValueError, OSError, EOFError, BadZipFile, zlib.error) as error:  # whatever a cut or altered archive makes numpy raise
        refuse([Fault(str(path), f"not a readable .npz of plain arrays ({error})", REMEDY)])
    refuse(_faults(arrays, str(path)))
    return arrays


def _faults(arrays: dict[str, np.ndarray], where: str) -> list[Fault]:
    missing = [key for key in ARRAYS if key not in arrays]
    faults = [Fault(where, f"not an SMPL-X model: {', '.join(missing)} missing", REMEDY)] if missing else []
    for key, shape in ARRAYS.items():
        found = arrays[key].shape if key in arrays else shape
        if len(found) != len(shape) or any(want not in (None, have) for want, have in zip(shape, found, strict=False)):
            faults.append(Fault(where, f"not an SMPL-X model: {key} is {found}, expected {shape} (None: any)", REMEDY))
    counts = {key: arrays[key].shape[0] for key in ("v_template", "weights", "shapedirs", "posedirs") if key in arrays}
    if "J_regressor" in arrays and arrays["J_regressor"].ndim == 2:
        counts["J_regressor"] = arrays["J_regressor"].shape[1]
    if len(set(counts.values())) > 1:
        faults.append(Fault(where, f"numbers of vertices differ: {counts}", REMEDY))
    return faults


def _vertex_ids(arrays: dict[str, np.ndarray]) -> dict[str, int]:
    if "vertex_ids" in arrays:
        return dict(zip(arrays["vertex_id_names"].tolist(), arrays["vertex_ids"].tolist(), strict=True))
    from smplx.vertex_ids import vertex_ids  # imports torch; a licensed file uses the numbers of its own mesh

    return vertex_ids["smplx"]


def _skin(arrays: dict[str, np.ndarray], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """The largest connected piece: SMPL-X's eyeballs, and ours, are pieces of their own."""
    label = components(faces, len(arrays["v_template"]))
    return label == np.argmax(np.bincount(label))
