"""Twins: a short skirt on a swaying trunk, made on a finer mesh with half the time step, observed on a coarser one with 1 mm of noise."""

from dataclasses import dataclass

import numpy as np

from tasks.cloth.scene import Scene
from tasks.simulator import NO_COLLIDER, Cloth, Collider, Fabric, Settings, simulate
from tests.simulator.scenes import sheet

FPS = 25.0
NOISE = 1e-3
COARSE, FINE = (20, 40), (27, 54)  # rings, around: 800 and 1,458 vertices
SETTLE = 8  # frames at rest before the recording


@dataclass(frozen=True)
class Twin:
    """What was seen [T, V, 3] m of a true motion [T, V, 3] m, and what moved it."""

    scene: Scene
    fabric: Fabric
    truth: np.ndarray


def skirt(rings: int, around: int, *, length=0.34, waist=0.135, hem=0.21):
    """Cone: vertices [rings·around, 3] from the waist (y = 0) down, faces [F, 3]."""
    t, a = np.linspace(0, 1, rings), np.linspace(0, 2 * np.pi, around, endpoint=False)
    r = waist + (hem - waist) * t
    y = np.broadcast_to(-np.sqrt(length**2 - (hem - waist) ** 2) * t[:, None], (rings, around))
    x = np.stack([r[:, None] * np.cos(a), y, r[:, None] * np.sin(a)], -1).reshape(-1, 3)
    i = np.arange(rings * around).reshape(rings, around)
    p, q, s, u = i[:-1], np.roll(i[:-1], -1, 1), i[1:], np.roll(i[1:], -1, 1)
    odd = (np.add.outer(np.arange(rings - 1), np.arange(around)) % 2).astype(bool)[..., None, None]
    one = [np.stack([np.stack(a, -1), np.stack(b, -1)], -2) for a, b in (((p, q, u), (p, u, s)), ((p, q, s), (q, u, s)))]
    return x, np.where(odd, *one).reshape(-1, 3).astype(np.int32)


def trunk():
    """Ellipsoid of the hips: vertices, faces."""
    import trimesh

    mesh = trimesh.creation.icosphere(2, radius=1.0)
    return np.array(mesh.vertices) * (0.12, 0.28, 0.11) + (0, -0.14, 0), np.array(mesh.faces, np.int32)


def sway(T: int, rng: np.random.Generator):
    """Rigid motion of the trunk from rest: rotations [T, 3, 3], translations [T, 3]."""
    t = np.arange(T) / FPS
    ease = np.clip(t / 0.3, 0, 1) ** 2 * (3 - 2 * np.clip(t / 0.3, 0, 1))
    f, phase = rng.uniform(0.8, 1.6, 4), rng.uniform(0, 2 * np.pi, 4)
    wave = [ease * np.sin(2 * np.pi * f[k] * t + phase[k]) for k in range(4)]
    c, s, zero = np.cos(0.7 * wave[0]), np.sin(0.7 * wave[0]), np.zeros(T)
    R = np.stack([c, zero, s, zero, zero + 1, zero, -s, zero, c], 1).reshape(T, 3, 3)
    return R, np.stack([0.12 * wave[1], 0.03 * wave[2], 0.12 * wave[3]], 1)


def true_fabric(rng: np.random.Generator) -> Fabric:
    """κ_s 0.5–4, κ_b 180–420 at 320 kg/m³: stretch of knits, bending lengths of 38 to 50 mm."""
    return Fabric(320.0, float(np.exp(rng.uniform(np.log(0.5), np.log(4)))), float(np.exp(rng.uniform(np.log(180), np.log(420)))))


def twin(seed: int, *, frames: int = 24, settings: Settings = Settings(), coarse=COARSE, fine=FINE, fabric: Fabric | None = None) -> Twin:  # noqa: B008
    """One recording; `settings` are those of the fit, the truth takes twice the substeps."""
    rng = np.random.default_rng(seed)
    fabric = fabric or true_fabric(rng)
    R, shift = sway(frames + 1, rng)
    body, body_faces = trunk()

    def moved(x):
        return np.concatenate([np.tile(x, (SETTLE, 1, 1)), np.einsum("tij,nj->tni", R, x) + shift[:, None]])

    x, faces = skirt(*fine)
    made = Cloth(x, faces, np.arange(fine[1]))
    walk = simulate(
        made,
        fabric,
        Collider(body_faces),
        collider_motion=moved(body),
        boundary_motion=moved(x[: fine[1]]),
        fps=FPS,
        settings=Settings(integrator=settings.integrator, substeps=2 * settings.substeps),
    )
    frames_ = list(walk)
    assert frames_[-1].converged, frames_[-1].ending
    truth = resampled(np.stack([f.x for f in frames_])[SETTLE:], fine, coarse)
    cloth = Cloth(*skirt(*coarse), np.arange(coarse[1]))
    observed = truth + NOISE * rng.standard_normal(truth.shape)
    scene = Scene(
        cloth,
        Collider(body_faces),
        moved(body)[SETTLE:],
        observed[:, : coarse[1]],
        observed[0],
        np.zeros_like(observed[0]),
        observed,
        np.full(observed.shape[:2], NOISE),
        FPS,
        settings,
    )
    return Twin(scene, fabric, truth)


def resampled(x, fine, coarse):
    """The surface of the fine cone [T, V, 3] at the vertices of the coarse one, by ring and angle."""
    (R, A), (r, a) = fine, coarse
    u, w = np.linspace(0, R - 1, r), np.arange(a) * A / a
    i, j = np.minimum(u.astype(int), R - 2), w.astype(int)
    p, q = (u - i)[:, None, None], (w - j)[None, :, None]
    g = x.reshape(len(x), R, A, 3)
    corner = {(m, n): g[:, (i + m)[:, None], ((j + n) % A)[None, :]] for m in (0, 1) for n in (0, 1)}
    return ((1 - p) * ((1 - q) * corner[0, 0] + q * corner[0, 1]) + p * ((1 - q) * corner[1, 0] + q * corner[1, 1])).reshape(len(x), -1, 3)


def handkerchief(seed: int, *, frames: int = 24, settings: Settings, fabric: Fabric, coarse: int = 12, fine: int = 16) -> Twin:
    """A square of 0.1 m swung by its upper edge: small enough for the seed's range of bending to show on edges of 9 mm."""
    rng = np.random.default_rng(seed)
    R, shift = sway(frames + 1, rng)

    def square(n: int):
        x, faces = sheet(n, n, length=0.1, width=0.1)
        return x[:, [2, 0, 1]] * [1, -1, 1], faces[:, ::-1], np.arange(n)

    def simulated(n: int, s: Settings):
        x, faces, held = square(n)
        path = np.einsum("tij,nj->tni", R, x[held]) + shift[:, None]
        empty = np.zeros((frames + 1, 0, 3))
        walk = simulate(Cloth(x, faces, held), fabric, NO_COLLIDER, collider_motion=empty, boundary_motion=path, fps=FPS, settings=s)
        return np.stack([f.x for f in walk])

    x, faces, held = square(coarse)
    rows = np.linspace(0, fine - 1, coarse)
    i = np.minimum(rows.astype(int), fine - 2)
    p = rows - i
    along = np.zeros((coarse, fine))
    along[np.arange(coarse), i], along[np.arange(coarse), i + 1] = 1 - p, p
    made = simulated(fine, Settings(integrator=settings.integrator, substeps=2 * settings.substeps)).reshape(frames + 1, fine, fine, 3)
    truth = np.einsum("ai,bj,tijc->tabc", along, along, made).reshape(frames + 1, -1, 3)
    path = np.einsum("tij,nj->tni", R, x[held]) + shift[:, None]
    observed = truth + NOISE * rng.standard_normal(truth.shape)
    noise = np.full(observed.shape[:2], NOISE)
    empty = np.zeros((frames + 1, 0, 3))
    return Twin(Scene(Cloth(x, faces, held), NO_COLLIDER, empty, path, x, np.zeros_like(x), observed, noise, FPS, settings), fabric, truth)
