"""A small avatar to export: a bent tube on a chain of joints, with a texture seam and a garment that moves on its own."""

from typing import NamedTuple

import numpy as np

from tasks.export.gltf import Garment
from tasks.export.skeleton import Skeleton
from tasks.export.surface import Surface
from tasks.geometry.rotations import matrix_from_axis_angle

FPS = 25.0


class Avatar(NamedTuple):
    surface: Surface
    skeleton: Skeleton
    weights: np.ndarray
    transforms: np.ndarray
    texture: np.ndarray
    garment: Garment


def tube(rows: int = 9, around: int = 8) -> Surface:
    """A tube along y of radius 0.1 m, closed around; its texture is cut along one side."""
    j, i = np.meshgrid(np.arange(rows), np.arange(around), indexing="ij")
    angle = 2 * np.pi * i / around
    vertices = np.stack([0.1 * np.cos(angle), 0.1 * j, 0.1 * np.sin(angle)], axis=-1).reshape(-1, 3)
    v, u = np.meshgrid(np.arange(rows) / (rows - 1), np.arange(around + 1) / around, indexing="ij")
    quads = [(r, c) for r in range(rows - 1) for c in range(around)]
    corner = lambda r, c, n: r * n + c % n  # noqa: E731
    faces = [
        f
        for r, c in quads
        for f in _two(corner(r, c, around), corner(r, c + 1, around), corner(r + 1, c, around), corner(r + 1, c + 1, around))
    ]
    uv_faces = [f for r, c in quads for f in _two(*((r + a) * (around + 1) + c + b for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))))]
    return Surface(vertices, np.array(faces), np.stack([u, v], axis=-1).reshape(-1, 2), np.array(uv_faces))


def _two(a, b, c, d):
    return (a, c, b), (b, c, d)


def avatar(*, frames: int = 5, joints: int = 6, scale: float = 1.0, seed: int = 0) -> Avatar:
    """Random poses of a branching skeleton, random smooth weights on all joints, transforms composed from parent to child."""
    random = np.random.default_rng(seed)
    surface = tube()
    parents = np.array([-1, 0, 1, 1, 3, 0][:joints])
    at_rest = np.stack([np.zeros(joints), np.linspace(0, 0.8, joints), 0.02 * np.arange(joints)], axis=1)
    R = matrix_from_axis_angle(random.normal(scale=0.8, size=(frames, joints, 3)))
    G = np.tile(np.eye(4), (frames, joints, 1, 1))
    for j in range(joints):
        L = np.tile(np.eye(4), (frames, 1, 1))
        L[:, :3, :3] = R[:, j] * (scale if j == 0 else 1)
        L[:, :3, 3] = at_rest[j] - (at_rest[parents[j]] if j else 0) + (random.normal(size=(frames, 3)) if j == 0 else 0)
        G[:, j] = G[:, parents[j]] @ L if j else L
    to_joint = np.tile(np.eye(4), (joints, 1, 1))
    to_joint[:, :3, 3] = -at_rest
    index = np.flatnonzero(surface.vertices[:, 1] > 0.45)
    x = surface.vertices[index] + random.normal(scale=0.05, size=(frames, len(index), 3))
    return Avatar(
        surface,
        Skeleton(tuple(f"joint_{j}" for j in range(joints)), parents, at_rest),
        random.dirichlet(np.ones(joints), len(surface.vertices)),
        G @ to_joint,
        random.integers(0, 256, (16, 32, 3), dtype=np.uint8),
        Garment("skirt", index, x),
    )


def skinned(weights, transforms, vertices) -> np.ndarray:
    """Linear blend skinning, slow and obvious: Σⱼ wⱼ Tⱼ (x, 1) for every frame and vertex."""
    moved = np.zeros((len(transforms), len(vertices), 3))
    for frame, T in enumerate(transforms):
        for vertex, x in enumerate(vertices):
            moved[frame, vertex] = sum(w * (Tj @ [*x, 1])[:3] for w, Tj in zip(weights[vertex], T, strict=True))
    return moved
