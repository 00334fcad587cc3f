"""Twins: a short skirt on a swaying trunk, made on a finer mesh with half the time step, observed on a coarser one with 1 mm of noise.

The coarser mesh is that of a tracker: its vertices are points of the smooth surface through those of the finer one, in the pattern as in
every frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from tasks.cloth.scene import Scene
from tasks.cloth.start import start_velocity
from tasks.simulator import NO_COLLIDER, Cloth, Collider, Fabric, Settings, simulate
from tasks.simulator.settings import BASE
from tests.simulator.scenes import sheet

FPS = 25.0
NOISE = 1e-3
COARSE, FINE = (20, 40), (27, 54)  # rings, around: 800 and 1,458 vertices
SWING, LIFT, TURN = 0.04, 0.25, 0.25  # [m], of that, [rad]: hips in walking
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


def times(T: int, steps: int):
    """Instants [steps (T − 1) + 1] s of T frames with so many steps each."""
    return np.arange(steps * (T - 1) + 1) / (FPS * steps)


def sway(T: int, rng: np.random.Generator, steps: int = 1, reach: float = 1.0):
    """Rigid motion of the trunk, `reach` times that of hips in walking, from rest at `times(T, steps)`: rotations [n, 3, 3], translations [n, 3]."""
    t = times(T, steps)
    ease = np.clip(t / 0.3, 0, 1) ** 2 * (3 - 2 * np.clip(t / 0.3, 0, 1))
    f, phase = rng.uniform(0.8, 1.6, 4), rng.uniform(0, 2 * np.pi, 4)
    wave = [ease * np.sin(2 * np.pi * f[k] * t + phase[k]) for k in range(4)]
    c, s, zero = np.cos(TURN * reach * wave[0]), np.sin(TURN * reach * wave[0]), np.zeros(len(t))
    R = np.stack([c, zero, s, zero, zero + 1, zero, -s, zero, c], 1).reshape(-1, 3, 3)
    return R, reach * SWING * np.stack([wave[1], LIFT * wave[2], wave[3]], 1)


def true_fabric(rng: np.random.Generator) -> Fabric:
    """κ_s 0.5–4, κ_b 180–420 at 320 kg/m³: stretch of knits, bending lengths of 38 to 50 mm."""
    return Fabric(320.0, float(np.exp(rng.uniform(np.log(0.5), np.log(4)))), float(np.exp(rng.uniform(np.log(180), np.log(420)))))


def twin(
    seed: int,
    *,
    frames: int = 24,
    settings: Settings = BASE,
    coarse=COARSE,
    fine=FINE,
    fabric: Fabric | None = None,
    reach: float = 1.0,
) -> Twin:
    """One recording; `settings` are those of the fit. The truth takes twice the substeps, and its body moves smoothly between frames."""
    rng = np.random.default_rng(seed)
    fabric = fabric or true_fabric(rng)
    steps = 2 * settings.substeps
    R, shift = sway(frames + 1, rng, steps, reach)
    body, body_faces = trunk()

    def moved(x):
        return np.concatenate([np.tile(x, (SETTLE * steps, 1, 1)), np.einsum("tij,nj->tni", R, x) + shift[:, None]])

    x, faces = skirt(*fine)
    made = Cloth(x, faces, np.arange(fine[1]))
    walk = simulate(
        made,
        fabric,
        Collider(body_faces),
        collider_motion=moved(body),
        boundary_motion=moved(x[: fine[1]]),
        fps=FPS * steps,
        settings=replace(settings, substeps=1),
    )
    frames_ = list(walk)
    assert frames_[-1].converged, frames_[-1].ending
    truth = resampled(np.stack([f.x for f in frames_])[SETTLE * steps :: steps], fine, coarse)
    cloth = Cloth(resampled(x[None], fine, coarse)[0], skirt(*coarse)[1], np.arange(coarse[1]))
    observed = truth + NOISE * rng.standard_normal(truth.shape)
    scene = Scene(
        cloth,
        Collider(body_faces),
        moved(body)[SETTLE * steps :: steps],
        observed[:, : coarse[1]],
        observed[0],
        start_velocity(observed, FPS),
        observed,
        np.full(observed.shape[:2], NOISE),
        FPS,
        settings,
    )
    return Twin(scene, fabric, truth)


def resampled(x, fine, coarse):
    """The smooth surface through the fine cone's vertices [T, V, 3] at the vertices of the coarse one, by ring and angle: cubic splines.

    Points of its flat triangles would lie inside by up to |edge|² curvature/8, others in every ring: wrinkles as short as the mesh, for
    which nothing but bending could answer.
    """
    (R, A), (r, a) = fine, coarse
    g = x.reshape(len(x), R, A, 3)
    around = CubicSpline(np.arange(A + 1), np.concatenate([g, g[:, :, :1]], 2), axis=2, bc_type="periodic")(np.arange(a) * A / a)
    return CubicSpline(np.arange(R), around, axis=1)(np.linspace(0, R - 1, r)).reshape(len(x), -1, 3)


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
