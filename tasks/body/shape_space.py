"""Linear spaces of the demo body: shape, expression, hands, and joints as weighted means of vertices.

    shape       x − x̄ ≈ Σ_s β_s σ_s u_s          σ_s u_s principal components of random adults about the average one
    expression  e ≈ Σ_e ψ_e σ_e w_e              the same of facial actions about the neutral face
    joints      J = 𝒥 x,  𝒥 ≥ 0,  Σ_v 𝒥_jv = 1   least squares over all those adults (Loper et al. 2015, section 4.2.2)

Limits: the adults are drawn from MakeHuman's traits, not from a survey of people; the spread of β says nothing about a population.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from tasks.body.skeleton import FINGERS, PARENTS

COMPONENTS = 10  # of shape and of expression, as smplx reads from small files
ADULTS = 100
HEIGHT = 0.375  # trait of height that makes the average adult 1.70 m tall
NOT_EXPRESSIONS = ("jaw", "eyeLook", "tongue")  # jaw and eyes turn by joints; there is no tongue
CARRIERS = 300  # vertices that may carry a joint, drawn from all within REACH times the distance from joint to skin
REACH = 6.0
TIE = 1e-6  # relative difference up to which two entries are alike: last bits depend on the processor


@dataclass(frozen=True)
class Person:
    """vertices [V,3] m and joints [55,3] m in the T-pose, pelvis at the origin."""

    vertices: np.ndarray
    joints: np.ndarray


def random_traits(count: int = ADULTS, *, seed: int = 0, height: float = HEIGHT) -> list[dict]:
    """Traits of random adults for `MakeHuman.shape`: young rather than old, of every build, 1.7 m tall give or take 0.1."""
    rng = np.random.default_rng(seed)
    normal = {"muscle": (0.5, 0.2), "weight": (0.5, 0.2), "height": (height, 0.08), "proportions": (0.5, 0.25)}
    return [
        {name: np.clip(rng.normal(mean, spread), 0, 1) for name, (mean, spread) in normal.items()}
        | {"gender": rng.uniform(), "age": min(abs(rng.normal(0, 0.3)), 1), "race": rng.dirichlet(np.ones(3))}
        for _ in range(count)
    ]


def shape_space(average: Person, adults: list[Person]) -> np.ndarray:
    """Displacements [V,3,10] m per unit of β."""
    return _principal(np.array([adult.vertices for adult in adults]) - average.vertices)


def expression_space(actions: dict[str, np.ndarray]) -> np.ndarray:
    """Displacements [V,3,10] m per unit of ψ, from facial actions {name: [V,3] m} each taken to its full strength."""
    return _principal(np.array([offset for name, offset in actions.items() if not name.startswith(NOT_EXPRESSIONS)]))


def joint_regressor(average: Person, people: list[Person], weights: np.ndarray) -> np.ndarray:
    """Weights [55,V] ≥ 0, each row summing to 1, on vertices near the joint of the average person and moved by it or its parent.

    The people should be of height 0.5: away from it MakeHuman's bone heads slide along the skin, by 4 cm at the knee for 0.2.
    """
    regressor = np.zeros((len(PARENTS), len(average.vertices)))
    rng = np.random.default_rng(0)
    for j, parent in enumerate(PARENTS):
        moved = weights[:, j] + (weights[:, parent] if parent >= 0 else 0) > 0.1
        distance = np.where(moved, np.linalg.norm(average.vertices - average.joints[j], axis=1), np.inf)
        around = np.flatnonzero(distance < REACH * distance.min())  # all round the limb, not only where vertices are dense
        near = rng.permutation(around)[:CARRIERS]
        from_joint = np.concatenate([(person.vertices[near] - person.joints[j]).T for person in people])
        A = np.concatenate([from_joint, np.ones((1, len(near)))])  # last row: Σ w = 1, exact after normalising since the others ask for 0
        w, _ = nnls(A, np.append(np.zeros(len(from_joint)), 1.0))
        regressor[j, near] = w / w.sum()
    return regressor


def hand_space(samples: int = 2000, seed: int = 0) -> dict[str, np.ndarray]:
    """Principal components [45,45] and mean [45] of random hand poses (fingers curl together, then apart), keys as in SMPL-X.

    A hand lies along ±x with its palm down: fingers curl about ∓z, spread about ±y; the thumb curls mostly about its own axis frame.
    """
    rng = np.random.default_rng(seed)
    curl = rng.normal(0.4, 0.5, (samples, 1)) + rng.normal(0, 0.35, (samples, len(FINGERS)))  # [rad] at the first joint
    spread = rng.normal(0, 0.12, (samples, len(FINGERS)))
    pose = np.zeros((samples, len(FINGERS), 3, 3))
    pose[..., 2] = -curl[:, :, None] * np.array([1.0, 1.1, 0.7])
    pose[:, :, 0, 1] = spread
    thumb = FINGERS.index("thumb")
    pose[:, thumb, :, 1], pose[:, thumb, :, 2] = pose[:, thumb, :, 2] * 0.6, pose[:, thumb, :, 2] * 0.3  # it curls across the palm
    pose += rng.normal(0, 0.03, pose.shape)
    left = pose.reshape(samples, 45)
    components = np.linalg.svd(left - left.mean(axis=0), full_matrices=False)[2]
    mirror = np.tile([1.0, -1.0, -1.0], 15)  # of an axial vector in the plane x = 0
    mean = left.mean(axis=0)
    return {"hands_componentsl": components, "hands_meanl": mean, "hands_componentsr": components * mirror, "hands_meanr": mean * mirror}


def _principal(samples: np.ndarray) -> np.ndarray:
    """Components [V,3,10] of samples [n,V,3] about zero, each times its root mean square coefficient."""
    n = len(samples)
    _, σ, directions = np.linalg.svd(samples.reshape(n, -1), full_matrices=False)
    scaled = σ[:COMPONENTS, None] / np.sqrt(n) * directions[:COMPONENTS]
    size = np.abs(scaled)
    # singular vectors come with either sign; x of mirrored vertices ties with opposite signs, so the first of the largest decides
    sign = np.sign(scaled[np.arange(COMPONENTS), np.argmax(size > (1 - TIE) * size.max(axis=1, keepdims=True), axis=1)])
    return (sign[:, None] * scaled).T.reshape(*samples.shape[1:], COMPONENTS)
