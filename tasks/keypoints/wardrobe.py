"""Clothes, hair and shoes put on a posed body, for training pictures.

    x_cloth = x + (ease + wrinkle) n     over a region of the skin;     skirt: rings around the legs, radius = support of the legs · flare

Regions are cut in the rest pose by skin weights and by how far along a limb a vertex lies; shells move with the posed skin.
Limits: nothing hangs, swings or collides; a shell may cut through another part of the body; cloth in this project's sense (simulated)
comes from the simulator, this is decoration that teaches a detector to look past it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tasks.geometry.meshes import submesh, vertex_normals
from tasks.keypoints.materials import Material, cloth, hair_material

ARMS = ((13, 16, 18, 20, *range(25, 40)), (14, 17, 19, 21, *range(40, 55)))
LEGS = ((1, 4, 7, 10), (2, 5, 8, 11))
HEAD = (12, 15, 22, 23, 24)


@dataclass(frozen=True)
class Piece:
    """One mesh of a scene: vertices [V,3] m, faces [F,3], normals [V,3], texture [V,3] m (where the solid texture is read),
    tint [V,3] factor on the colour, and its material."""

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    texture: np.ndarray
    tint: np.ndarray
    material: Material


@dataclass(frozen=True)
class Regions:
    """Where each vertex of the body lies, in the rest pose: `arm`, `leg` [V] 0 at shoulder or hip, 1 at elbow or knee, 2 at wrist or
    ankle, −1 elsewhere; `height` [V] 0 at the hips, 1 at the neck; `head` [V] share of skin weight; `face` [V,3] m from between the eyes;
    `x` [V,3] m."""

    arm: np.ndarray
    leg: np.ndarray
    height: np.ndarray
    head: np.ndarray
    face: np.ndarray
    x: np.ndarray


def regions(x_rest: np.ndarray, joints: np.ndarray, weights: np.ndarray) -> Regions:
    """Regions of a body from rest vertices [V,3], rest joints [55,3] and skin weights [V,55]."""
    arm, leg = np.full(len(x_rest), -1.0), np.full(len(x_rest), -1.0)
    for limb in ARMS:
        on = weights[:, limb].sum(1) > 0.5
        arm[on] = np.interp(np.abs(x_rest[on, 0]), np.abs(joints[[limb[1], limb[2], limb[3]], 0]), (0, 1, 2))
    for limb in LEGS:
        on = weights[:, limb].sum(1) > 0.5
        leg[on] = np.interp(-x_rest[on, 1], -joints[[limb[0], limb[1], limb[2]], 1], (0, 1, 2))
    hips, neck = joints[[1, 2], 1].mean(), joints[12, 1]
    return Regions(
        arm=arm,
        leg=leg,
        height=(x_rest[:, 1] - hips) / (neck - hips),
        head=weights[:, HEAD].sum(1),
        face=x_rest - joints[[23, 24]].mean(0),
        x=x_rest,
    )


def dress(x: np.ndarray, faces: np.ndarray, where: Regions, random: np.random.Generator) -> list[Piece]:
    """A random outfit over the posed skin x [V,3]: something on the hips always, the rest by chance."""
    normals = vertex_normals(x, faces)
    worn: list[Piece] = []

    def shell(region: np.ndarray, ease: float, material: Material) -> None:
        worn.append(_shell(x, faces, normals, where, region, ease, material, random))

    body, skirted = where.head < 0.5, random.random() < 0.3
    suit = random.random() < 0.06
    waist = random.uniform(0.05, 0.3)
    fabric = cloth(random)
    if suit:  # one tight piece from neck to ankles, as in motion capture
        shell(body & (where.arm < 1.95) & (where.leg < 1.95), random.uniform(0.002, 0.006), fabric)
    else:
        bare = random.random() < 0.15
        if not bare:
            sleeve = random.choice([-0.5, random.uniform(0.3, 0.9), random.uniform(1.2, 2.0)])
            hem = random.uniform(-0.25, 0.35)
            top = body & (where.arm < sleeve) & (where.leg < 0.5) & (where.height > hem) & (where.height < random.uniform(0.85, 1.05))
            shell(top, random.choice([0.004, random.uniform(0.005, 0.03), random.uniform(0.02, 0.05)]), cloth(random))
        cuff = random.choice([random.uniform(0.1, 0.5), random.uniform(0.5, 1.0), random.uniform(1.5, 2.0), 1.95])
        if skirted:
            cuff = min(cuff, 0.3)
        trousers = (where.arm < 0) & (where.height < waist) & (where.leg < cuff)
        shell(trousers, random.choice([0.003, random.uniform(0.004, 0.02), random.uniform(0.015, 0.04)]), fabric)
    if skirted:
        worn.append(_skirt(x, where, random, fabric if random.random() < 0.5 else cloth(random)))
    if random.random() < 0.6:
        shell(where.leg > random.choice([1.93, random.uniform(1.6, 1.95)]), random.uniform(0.004, 0.015), cloth(random))
    _head_wear(shell, where, random)
    return worn


def _head_wear(shell, where: Regions, random: np.random.Generator) -> None:
    face, head = where.face, where.head > 0.5
    hairline = 0.05 + 0.85 * (face[:, 2] - 0.01) + random.uniform(-0.03, 0.02)  # falls from forehead to nape
    scalp = head & (face[:, 1] > hairline)
    colour = hair_material(random)
    style = random.random()
    if style < 0.12:
        return
    if style > 0.7:  # long hair: the back of head, neck and shoulders too
        low = random.uniform(-0.45, -0.1)
        scalp |= (face[:, 2] < -0.06) & (np.abs(face[:, 0]) < 0.12) & (face[:, 1] > low) & (where.arm < 0.2)
    shell(scalp, random.uniform(0.004, 0.035), colour)
    if random.random() < 0.22:  # cap, hat or swimming cap
        shell(
            head & (face[:, 1] > random.uniform(0.03, 0.06) + random.uniform(0, 0.5) * face[:, 2]),
            random.uniform(0.01, 0.04),
            cloth(random),
        )


def _shell(x, faces, normals, where, region, ease, material, random) -> Piece:
    part, kept = submesh(faces, region)
    wave = random.normal(0, 25, (3, 3))  # [1/m] three plane waves, wavelength about 15 cm
    wrinkle = np.sin(where.x[kept] @ wave.T + random.uniform(0, 2 * np.pi, 3)).mean(1)
    offset = ease * (1 + 0.6 * wrinkle)
    shifted = x[kept] + offset[:, None] * normals[kept]
    return Piece(shifted, part, vertex_normals(shifted, part), where.x[kept], np.ones((len(kept), 3)), material)


def _skirt(x: np.ndarray, where: Regions, random: np.random.Generator, material: Material, *, columns: int = 40, rows: int = 12) -> Piece:
    """Rings from the waist downwards that contain the legs: support radius per sector, smoothed, flared, with folds."""
    low = x[(where.arm < 0) & (where.height < 0.35) & (where.head < 0.5)]
    waist = x[(where.arm < 0) & (np.abs(where.height - 0.2) < 0.06)].mean(0)
    thighs = x[(where.leg > 0.1) & (where.leg < 0.9)].mean(0) - waist
    down = thighs / np.linalg.norm(thighs) + np.array([0, -1.0, 0])
    down /= np.linalg.norm(down)
    side = np.cross(down, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    front = np.cross(side, down)
    length, flare, fold = random.uniform(0.25, 0.95), random.choice([0.0, random.uniform(0, 0.5)]), random.uniform(0, 0.12)
    q = low - waist
    h, a, b = q @ down, q @ side, q @ front
    row = np.clip((h / length * (rows - 1)).astype(int), 0, rows - 1)
    column = ((np.arctan2(b, a) / (2 * np.pi)) % 1 * columns).astype(int) % columns
    radius = np.zeros((rows, columns))
    inside = (h > -0.02) & (h < length * 1.05)
    np.maximum.at(radius, (row[inside], column[inside]), np.hypot(a, b)[inside])
    radius = np.maximum.reduce([np.roll(radius, k, 1) * np.cos(2 * np.pi * k / columns) for k in range(-4, 5)])
    radius = np.maximum.accumulate(radius, 0)
    radius = (np.roll(radius, 1, 1) + 2 * radius + np.roll(radius, -1, 1)) / 4 + 0.01
    θ, s = np.meshgrid((np.arange(columns) + 0.5) / columns * 2 * np.pi, np.linspace(0, 1, rows))
    radius = radius * (1 + fold * s * np.sin(random.integers(5, 14) * θ + random.uniform(0, 6))) + flare * length * s
    x_skirt = waist + (s * length)[..., None] * down + (radius * np.cos(θ))[..., None] * side + (radius * np.sin(θ))[..., None] * front
    i = np.arange(rows * columns).reshape(rows, columns)
    p, q, r, u = i[:-1], np.roll(i, -1, 1)[:-1], i[1:], np.roll(i, -1, 1)[1:]
    faces = np.concatenate([np.stack([p, r, q], -1).reshape(-1, 3), np.stack([q, r, u], -1).reshape(-1, 3)]).astype(np.int32)
    vertices = x_skirt.reshape(-1, 3)
    texture = np.stack([0.25 * θ, -s * length, 0.0 * s], -1).reshape(-1, 3)
    return Piece(vertices, faces, vertex_normals(vertices, faces), texture, np.ones_like(vertices), material)
