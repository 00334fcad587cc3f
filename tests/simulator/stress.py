"""Stress runs: a seeded figure in one of four garments, moved as cloth dislikes.

The figure is the smooth union of capsules about bones, meshed by a surface net and posed by linear blending, so that it crosses itself
where arms are pressed in, knees are bent and legs cross, as parametric bodies do: by less than a limb's radius, for what is swallowed whole
leaves cloth no place that half of it would open. Top and trousers are parts of the surface 15 mm further out, skirt and cape are sheets of
rows. Every frame is examined by what the simulator does not use: ipctk's exact test for crossings, and the figure's own penetration.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import closest_points, inside
from tasks.geometry.meshes import boundary_edges, components, face_normals, submesh, vertex_normals
from tasks.geometry.rotations import matrix_from_axis_angle
from tasks.simulator import Cloth, Collider, Fabric, Settings, simulate
from tests.simulator.scenes import crosses

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
Distance = Callable[[Array], Array]
Where = Callable[[Array], NDArray[np.bool_]]
GARMENTS = ("skirt", "trousers", "top", "cape")
ACTS = ("turn", "crouch", "press", "cross", "all")
FRAMES, FPS = 14, 25.0
EASE = 0.015  # [m] between skin and garment at rest
BLEND = 60.0  # [1/m] of the smooth union
BONES = {  # parent, head, tail [m], radius [m]; y is up, the figure looks along z; the left side is mirrored below
    "pelvis": ("", (-0.05, 1.0, 0), (0.05, 1.0, 0), 0.115),
    "chest": ("pelvis", (0, 1.12, 0), (0, 1.34, 0), 0.12),
    "arm": ("chest", (0.15, 1.37, 0), (0.38, 1.14, 0), 0.05),
    "forearm": ("arm", (0.38, 1.14, 0), (0.56, 0.96, 0), 0.042),
    "thigh": ("pelvis", (0.095, 0.94, 0), (0.12, 0.52, 0), 0.07),
    "shin": ("thigh", (0.12, 0.52, 0), (0.13, 0.12, 0), 0.052),
}
SIDED = ("arm", "forearm", "thigh", "shin")


@dataclass(frozen=True)
class Bone:
    """Capsule from head to tail [3] m; parent: index, −1 for none."""

    name: str
    parent: int
    head: Array
    tail: Array
    radius: float

    def distance(self, x: Array) -> Array:
        """Signed distance [...] m of points [..., 3] from its capsule."""
        along = self.tail - self.head
        share = np.clip((x - self.head) @ along / (along @ along), 0, 1)
        return np.linalg.norm(x - self.head - share[..., None] * along, axis=-1) - self.radius


@dataclass(frozen=True)
class Case:
    """One run: cloth, fabric, collider faces, motions [T, C, 3], [T, B, 3] m."""

    cloth: Cloth
    fabric: Fabric
    collider: Collider
    collider_motion: Array
    boundary_motion: Array


@dataclass(frozen=True)
class Outcome:
    """How a run ended, frames in which something crossed, the largest yield and by how much it passed its bound [m], processor time [s].

    The bound: half the figure's own penetration, or as deep as the skin covers a prescribed node or edge, and the clearance.
    """

    ending: str
    crossing: tuple[int, ...]
    yielded: float
    beyond: float
    seconds: float


def names() -> list[tuple[str, str, int]]:
    """The sixty runs: garment, act, seed."""
    return list(product(GARMENTS, ACTS, range(3)))


def examine(garment: str, act: str, seed: int) -> Outcome:
    """Simulate one case in the base model and look at every frame."""
    case, settings = build(garment, act, seed), Settings()
    clearance = 2 * settings.barrier_distance + settings.contact_offset
    crossing, depth, beyond, seconds = [], 0.0, 0.0, 0.0
    frame = None
    motions = {"collider_motion": case.collider_motion, "boundary_motion": case.boundary_motion}
    for frame in simulate(case.cloth, case.fabric, case.collider, fps=FPS, settings=settings, **motions):
        seconds += frame.seconds
        if crosses(frame, case.cloth, case.collider.faces):
            crossing.append(frame.index)
        if frame.yielded:
            skin = case.collider_motion[frame.index], case.collider.faces
            bound = max(penetration(*skin) / 2, covering(_held(case, frame.index), *skin)) + clearance
            depth, beyond = max(depth, frame.yielded.depth.max()), max(beyond, frame.yielded.depth.max() - bound)
    assert frame is not None
    ending = frame.ending if frame.converged else f"frame {frame.index}: {frame.ending}"
    return Outcome(ending, tuple(crossing), float(depth), float(beyond), seconds)


def penetration(x: Array, faces: Indices) -> float:
    """Deepest place [m] of a surface in itself: distance of covered vertices from the nearest skin that looks elsewhere."""
    normals, away = vertex_normals(x, faces), face_normals(x, faces)
    covered = np.flatnonzero(inside(x + 1e-4 * normals, x, faces))
    deep = [closest_points(x[[v]], x, faces[away @ normals[v] <= 0.5]).distance[0] for v in covered]
    return float(max(deep, default=0.0))


def covering(points: Array, x: Array, faces: Indices) -> float:
    """How deep [m] the skin covers points [P, 3]: distance of those inside from the nearest face that they lie behind."""
    away = face_normals(x, faces)
    deep = [
        closest_points(q[None], x, faces[np.sum(away * (x[faces[:, 0]] - q), 1) > 0]).distance[0] for q in points[inside(points, x, faces)]
    ]
    return float(max(deep, default=0.0))


def _held(case: Case, frame: int) -> Array:
    """Points [P, 3] of the prescribed edges, an eighth of them apart."""
    ends = case.boundary_motion[frame][case.cloth.held_edges]
    share = np.linspace(0, 1, 9)[:, None, None]
    return ((1 - share) * ends[:, 0] + share * ends[:, 1]).reshape(-1, 3)


def build(garment: str, act: str, seed: int) -> Case:
    """The garment on the figure, with a fabric and a motion drawn from the seed."""
    rng = np.random.default_rng([seed, GARMENTS.index(garment), ACTS.index(act)])
    bones = figure(rng.uniform(0.9, 1.1))
    skin, faces = surface_net(lambda x: union(bones, x), 0.03)
    x, cloth_faces, pins = DRESS[garment](bones)
    fabric = Fabric(rng.uniform(200, 600), rng.uniform(1, 8), rng.uniform(1, 50), rng.uniform(0, 0.6))
    poses = [transforms(bones, pose) for pose in motion(act, rng)]
    pinned = weights(bones, x[pins])
    skin_weights = weights(bones, skin)
    return Case(
        Cloth(x, cloth_faces, pins),
        fabric,
        Collider(faces),
        np.stack([blend(skin, skin_weights, G) for G in poses]),
        np.stack([blend(x[pins], pinned, G) for G in poses]),
    )


# --- the figure


def figure(stout: float) -> list[Bone]:
    """Bones, parents first; `stout` multiplies the radii of the limbs."""
    bones: list[Bone] = []
    place = {"": -1}
    for name, (parent, head, tail, radius) in BONES.items():
        for side, sign in (("", 1.0), ("left ", -1.0)) if name in SIDED else (("", 1.0),):
            mirror = np.array([sign, 1, 1])
            above = side + parent if parent in SIDED else parent
            place[side + name] = len(bones)
            size = radius * (stout if name in SIDED else 1.0)
            bones.append(Bone(side + name, place[above], mirror * head, mirror * tail, size))
    return bones


def union(bones: list[Bone], x: Array) -> Array:
    """Signed distance [...] m from the blended capsules."""
    return -np.log(sum(np.exp(-BLEND * b.distance(x)) for b in bones)) / BLEND


def weights(bones: list[Bone], x: Array) -> Array:
    """Weights [P, bones] of linear blending."""
    w = np.exp(-np.stack([b.distance(x) for b in bones], 1) / 0.02)
    return w / w.sum(1, keepdims=True)


def transforms(bones: list[Bone], pose: dict[str, tuple[float, float, float]]) -> Array:
    """Rigid motions [bones, 3, 4]: each bone turned about its head by its axis-angle [rad]; "root" shifts the figure [m]."""
    G = np.zeros((len(bones), 3, 4))
    for i, bone in enumerate(bones):
        R = matrix_from_axis_angle(np.array(pose.get(bone.name, (0.0, 0.0, 0.0))))
        above = G[bone.parent] if bone.parent >= 0 else np.column_stack([np.eye(3), pose.get("root", (0.0, 0.0, 0.0))])
        G[i, :, :3] = above[:, :3] @ R
        G[i, :, 3] = above[:, :3] @ (bone.head - R @ bone.head) + above[:, 3]
    return G


def blend(x: Array, w: Array, G: Array) -> Array:
    """Points [P, 3] by linear blending."""
    return np.einsum("pb,bij,pj->pi", w, G[:, :, :3], x) + w @ G[:, :, 3]


def motion(act: str, rng: np.random.Generator) -> list[dict[str, tuple[float, float, float]]]:
    """Poses of all frames: at rest, then within 7 to 10 frames to the extreme, and a little back."""
    reach = rng.integers(7, 11)
    share = np.sin(np.pi / 2 * np.clip(np.arange(FRAMES) / reach, 0, 1.3)) ** 2
    acts = ("turn", "crouch", "press") if act == "all" else (act,)
    turn, knee, arm, leg, lean = (
        rng.uniform(1.2, 2.4),
        rng.uniform(0.7, 1.2),
        rng.uniform(0.6, 0.66),
        rng.uniform(0.35, 0.5),
        rng.normal(0, 0.2),
    )
    poses = []
    for s in share:
        pose: dict[str, tuple[float, float, float]] = {"chest": (lean * s, 0.0, 0.0)}
        if "turn" in acts:
            pose["pelvis"] = (0.0, turn * s, 0.0)
        if "crouch" in acts:
            pose |= {side + "thigh": (-knee * s, 0.0, 0.0) for side in ("", "left ")}
            pose |= {side + "shin": (1.7 * knee * s, 0.0, 0.0) for side in ("", "left ")}
            pose["root"] = (0.0, -0.42 * (1 - np.cos(knee * s)), 0.0)
        if "press" in acts:
            pose |= {"arm": (0.0, 0.0, -arm * s), "left arm": (0.0, 0.0, arm * s)}
        if "cross" in acts:
            pose |= {"thigh": (-0.3 * s, 0.0, -leg * s), "left thigh": (0.3 * s, 0.0, leg * s)}
            pose |= {"forearm": (0.0, -1.6 * s, -0.4 * s), "left forearm": (0.0, 1.6 * s, 0.4 * s)}
        poses.append(pose)
    return poses


# --- surfaces


def surface_net(distance: Distance, spacing: float) -> tuple[Array, Indices]:
    """Surface distance(x) = 0 as vertices [V, 3], faces [F, 3]: one vertex per grid cell that it crosses (Gibson 1998)."""
    axes = [np.arange(a, b, spacing) for a, b in ((-0.75, 0.8), (-0.05, 1.65), (-0.3, 0.35))]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    d = distance(grid)
    total, count, quads = np.zeros(grid.shape), np.zeros(d.shape), []
    for a in range(3):
        b, c = np.eye(3, dtype=int)[[(a + 1) % 3, (a + 2) % 3]]
        step = np.eye(3, dtype=int)[a]
        low, high = (np.delete(d < 0, drop, a) for drop in (-1, 0))
        i = np.argwhere(low != high)
        at, to = d[tuple(i.T)], d[tuple((i + step).T)]
        point = grid[tuple(i.T)] + (at / (at - to) * spacing)[:, None] * step
        around = [i - b - c, i - c, i, i - b]
        for cell in around:
            np.add.at(total, tuple(cell.T), point)
            np.add.at(count, tuple(cell.T), 1)
        quad = np.stack([np.ravel_multi_index(tuple(cell.T), d.shape) for cell in around], 1)
        quads.append(np.where((at < 0)[:, None], quad, quad[:, ::-1]))
    used = np.flatnonzero(count)
    x = total.reshape(-1, 3)[used] / count.ravel()[used, None]
    number = np.full(d.size, -1)
    number[used] = np.arange(len(used))
    return _onto(distance, x), _halves(x, number[np.concatenate(quads)])


def _onto(distance: Distance, x: Array) -> Array:
    """x [P, 3] moved onto distance = 0 by two Newton steps along its gradient."""
    for _ in range(2):
        slope = np.stack([(distance(x + e) - distance(x - e)) / 2e-4 for e in 1e-4 * np.eye(3)], 1)
        x = x - (distance(x) / np.sum(slope**2, 1))[:, None] * slope
    return x


def _halves(x: Array, quads: Array) -> Indices:
    """Quads [Q, 4] -> faces, cut along the shorter diagonal."""
    a, b, c, d = quads.T
    short = (np.linalg.norm(x[a] - x[c], axis=1) < np.linalg.norm(x[b] - x[d], axis=1))[:, None, None]
    one = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1)
    other = np.stack([np.stack([a, b, d], 1), np.stack([b, c, d], 1)], 1)
    return np.where(short, one, other).reshape(-1, 3).astype(np.int32)


def _part(bones: list[Bone], keep: Where, pinned: Where) -> tuple[Array, Indices, Indices]:
    """The part of the eased surface where keep(x) holds: vertices, faces, and its border vertices where pinned(x) holds."""
    x, faces = surface_net(lambda x: union(bones, x) - EASE, 0.05)
    kept, old = submesh(faces, keep(x))
    label = components(kept, len(old))
    kept, chosen = submesh(kept, label == np.bincount(label).argmax())
    x = x[old[chosen]]
    border = np.unique(boundary_edges(kept))
    return x, kept, border[pinned(x[border])].astype(np.int32)


def _near(bones: list[Bone], x: Array, *wanted: str) -> NDArray[np.bool_]:
    nearest = np.stack([b.distance(x) for b in bones]).argmin(0)
    return np.array([any(b.name.endswith(w) for w in wanted) for b in bones])[nearest]


def _top(bones: list[Bone]) -> tuple[Array, Indices, Indices]:
    """Torso and upper arms, pinned around the neck."""

    def keep(x: Array) -> NDArray[np.bool_]:
        neck = (np.abs(x[:, 0]) < 0.07) & (x[:, 1] > 1.4)
        return _near(bones, x, "pelvis", "chest", " arm", "arm") & ~_near(bones, x, "forearm") & (x[:, 1] > 1.0) & ~neck

    return _part(bones, keep, lambda x: x[:, 1] > 1.35)


def _trousers(bones: list[Bone]) -> tuple[Array, Indices, Indices]:
    """Pelvis and legs, pinned around the waist."""
    wanted = ("pelvis", "chest", "thigh", "shin")
    return _part(bones, lambda x: _near(bones, x, *wanted) & (x[:, 1] < 1.12) & (x[:, 1] > 0.3), lambda x: x[:, 1] > 1.0)


def _skirt(bones: list[Bone]) -> tuple[Array, Indices, Indices]:
    """Rings from the waist down, opening by a quarter of their height, pinned at the first."""
    core = [b for b in bones if "arm" not in b.name]
    rings, columns = 13, 32
    φ = 2 * np.pi * np.arange(columns) / columns
    out = np.stack([np.sin(φ), 0 * φ, np.cos(φ)], 1)
    reach = np.linspace(0.02, 0.45, 400)
    radius, x = np.zeros(columns), []
    for k, y in enumerate(np.linspace(1.06, 0.5, rings)):
        far = union(core, reach[:, None, None] * out + [0, y, 0]) > EASE
        bare = np.where(far, reach[0], reach[:, None]).max(0)
        radius = np.maximum(np.full(columns, bare.max()), radius + 0.012) if k else bare
        x.append(radius[:, None] * out + [0, y, 0])
    return np.concatenate(x), _rows(rings, columns, closed=True), np.arange(columns, dtype=np.int32)


def _cape(bones: list[Bone]) -> tuple[Array, Indices, Indices]:
    """A sheet down the back, pinned along the shoulders."""
    rows, columns = 18, 15
    x = [[(0.17 + 0.18 * t) * u for u in np.linspace(-1, 1, columns)] for t in np.linspace(0, 1, rows)]
    down = np.linspace(1.4, 0.6, rows)
    X = np.array(x)
    return (
        np.stack([X, np.repeat(down[:, None], columns, 1), np.full_like(X, -0.155)], -1).reshape(-1, 3),
        _rows(rows, columns, closed=False),
        np.arange(columns, dtype=np.int32),
    )


def _rows(rows: int, columns: int, *, closed: bool) -> Indices:
    """Faces between rows of vertices, diagonals alternating."""
    i = np.arange(rows * columns).reshape(rows, columns)
    right = np.roll(i, -1, 1) if closed else i[:, 1:]
    i = i if closed else i[:, :-1]
    a, b, c, d = (v.ravel() for v in (i[:-1], i[1:], right[1:], right[:-1]))
    odd = (np.add.outer(np.arange(rows - 1), np.arange(i.shape[1])) % 2).ravel().astype(bool)[:, None, None]
    one = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1)
    other = np.stack([np.stack([a, b, d], 1), np.stack([b, c, d], 1)], 1)
    return np.where(odd, one, other).reshape(-1, 3).astype(np.int32)


DRESS = {"skirt": _skirt, "trousers": _trousers, "top": _top, "cape": _cape}
