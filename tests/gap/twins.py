"""Twins: recordings of a skirt on a swaying, turning trunk, made by the project's own simulator on a finer mesh with half the step."""

from dataclasses import dataclass

import numpy as np

from tasks.effects.effect import Effect, Motion, Subject
from tasks.effects.model import Model
from tasks.simulator import Cloth, Collider, Fabric, Settings

FPS = 30.0


def skirt(rings: int, around: int, *, length=0.5, waist=0.14, hem=0.26):
    """Cone: vertices [rings·around, 3] from the waist (y = 0) down, faces [F, 3]."""
    t, a = np.linspace(0, 1, rings), np.linspace(0, 2 * np.pi, around, endpoint=False)
    r = waist + (hem - waist) * t
    drop = np.sqrt(length**2 - (hem - waist) ** 2) * t
    x = np.stack([r[:, None] * np.cos(a), np.broadcast_to(-drop[:, None], (rings, around)), r[:, None] * np.sin(a)], -1).reshape(-1, 3)
    i = np.arange(rings * around).reshape(rings, around)
    p, q, s, u = i[:-1], np.roll(i[:-1], -1, 1), i[1:], np.roll(i[1:], -1, 1)
    odd = (np.add.outer(np.arange(rings - 1), np.arange(around)) % 2).astype(bool)
    one = np.where(
        odd[..., None, None],
        np.stack([np.stack([p, q, u], -1), np.stack([p, u, s], -1)], -2),
        np.stack([np.stack([p, q, s], -1), np.stack([q, u, s], -1)], -2),
    )
    return x, one.reshape(-1, 3).astype(np.int32)


def trunk(rings: int = 9, around: int = 16):
    """Ellipsoid of the hips below the waist and two thighs as one closed surface: vertices, faces."""
    import trimesh

    mesh = trimesh.creation.icosphere(2, radius=1.0)
    x = np.array(mesh.vertices) * (0.125, 0.3, 0.115) + (0, -0.16, 0)
    return x, np.array(mesh.faces, np.int32)


def sway(T: int, seed: int, *, speed: float = 1.0):
    """Rigid motion of the trunk: rotations [T, 3, 3] and translations [T, 3], starting at rest."""
    rng = np.random.default_rng(seed)
    t = np.arange(T) / FPS
    ease = np.clip(t / 0.5, 0, 1) ** 2 * (3 - 2 * np.clip(t / 0.5, 0, 1))
    f = speed * rng.uniform(0.6, 1.2, 4)
    sign = rng.choice([-1, 1], 4)
    yaw = 0.6 * ease * sign[0] * np.sin(2 * np.pi * f[0] * t)
    shift = ease[:, None] * sign[1:] * (0.10, 0.02, 0.10) * np.sin(2 * np.pi * t[:, None] * f[1:])
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.zeros((T, 3, 3))
    R[:, 0, 0], R[:, 0, 2], R[:, 2, 0], R[:, 2, 2], R[:, 1, 1] = c, s, -s, c, 1
    return R, shift


@dataclass(frozen=True)
class Twin:
    subject: Subject
    motion: Motion
    truth: np.ndarray
    observed: np.ndarray
    noise: float


def twin(
    *,
    T=40,
    seed=0,
    mesh=(12, 28),
    fine=None,
    effects: dict[Effect, list[float]] | None = None,
    fabric=None,
    noise=1e-3,
    substeps=8,
    settle=20,
    membrane="stvk",
    speed=1.0,
) -> Twin:
    """Observed [T, V, 3] on `mesh` of a truth made on `fine` (default: the same mesh); the skirt settles first."""
    fabric = fabric or Fabric(density=450, membrane=12.0, bending=60.0)
    R, shift = sway(T, seed, speed=speed)
    bx, bf = trunk()
    place = lambda p: np.einsum("tij,nj->tni", R, p) + shift[:, None]  # noqa: E731

    def subject(shape):
        x, f = skirt(*shape)
        zone = np.full(len(x), "free", dtype="U8")
        zone[-shape[1] :], zone[: shape[1]] = "hem", "pinned"
        return Subject(Cloth(x, f, np.arange(shape[1]), rest_angles="worn"), fabric, Collider(bf), zone, FPS)

    made = subject(fine or mesh)
    rest = np.concatenate([np.tile(made.cloth.x_rest[made.cloth.boundary], (settle, 1, 1)), place(made.cloth.x_rest[made.cloth.boundary])])
    collider = np.concatenate([np.tile(bx, (settle, 1, 1)), place(bx)])
    model = Model(
        made,
        Settings(substeps=substeps, membrane=membrane),
        tuple(effects or ()),
        {e.name: np.array(s) for e, s in (effects or {}).items()},
    )
    frames = list(model.run(Motion(collider, rest), made.cloth.x_rest, np.zeros_like(made.cloth.x_rest)))
    assert frames[-1].converged, frames[-1].ending
    x = model.observed(np.stack([f.x for f in frames])[settle:])
    own = subject(mesh)
    truth = x if fine is None else resample(x, fine, mesh)
    rng = np.random.default_rng(seed + 1000)
    observed = truth + noise * rng.standard_normal(truth.shape)
    return Twin(own, Motion(place(bx), observed[:, own.cloth.boundary]), truth, observed, noise)


def resample(x, fine, mesh):
    """The surface of the fine cone at the vertices of the coarse one, by (ring, angle)."""
    (R, A), (r, a) = fine, mesh
    u, w = np.linspace(0, R - 1, r), np.arange(a) * A / a
    i, j = np.minimum(u.astype(int), R - 2), w.astype(int)
    p, q = (u - i)[:, None, None], (w - j)[None, :, None]
    g = x.reshape(len(x), R, A, 3)
    at = lambda di, dj: g[:, (i + di)[:, None], ((j + dj) % A)[None, :]]  # noqa: E731
    out = (1 - p) * ((1 - q) * at(0, 0) + q * at(0, 1)) + p * ((1 - q) * at(1, 0) + q * at(1, 1))
    return out.reshape(len(x), -1, 3)
