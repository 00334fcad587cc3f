"""Scenes: a garment on a body that moves. What the body is made of, which motions suit it, and what carries the pinned nodes.

Motions start from rest, last a little over a second, and never come alone: each has a slow drift and turn with it, as nobody moves along
one axis. They give the poses of the body's bones; bone 0 carries the garment.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator.bodies import Body, Pose
from tasks.geometry.rotations import matrix_from_axis_angle

Array = NDArray[np.float64]
RAMP = 0.35  # s from rest to full swing
MOTIONS = {
    "skirt": ("sway", "turn", "bounce", "walk"),
    "curtain": ("sway", "turn", "bounce", "ball"),
    "cape": ("sway", "turn", "bounce", "arms"),
    "sleeve": ("sway", "raise", "bounce", "elbow"),
}


@dataclass(frozen=True)
class Scene:
    """Body and, by name of the motion, its pose over time."""

    body: Body
    pose: Pose
    motion: str

    def carried(self, rest: Array) -> Callable[[float], Array]:
        """t -> places [..., 3] of points that bone 0 carries, `rest` in its frame."""

        def places(t: float) -> Array:
            R, p = self.pose(t)
            return rest @ R[0].T + p[0]

        return places


def body_of(kind: str, rng: np.random.Generator) -> Body:
    """A body that fits inside (or hangs beside) a garment of this kind."""
    u = rng.uniform
    if kind == "skirt":
        hip, knee = u(0.045, 0.055), u(0.058, 0.064)
        a = [[-0.045, -0.11, 0], [-hip, -0.13, 0], [hip, -0.13, 0]]
        b = [[0.045, -0.11, 0], [-hip - 0.01, -0.5, 0], [hip + 0.01, -0.5, 0]]
        return _body(a, b, [u(0.092, 0.098), knee, knee], [0, 1, 2])
    if kind == "curtain":
        r, x, y = u(0.07, 0.11), u(-0.08, 0.08), u(-0.42, -0.28)
        z = -r - u(0.012, 0.04)
        if u() < 0.5:
            return _body([[x, y, z]], [[x, y, z]], [r], [1])
        return _body([[-0.3, y, z]], [[0.3, y + u(-0.06, 0.06), z]], [r], [1])
    if kind == "cape":
        x, y = u(0.1, 0.115), u(-0.15, -0.13)
        # a cone of slope 0.55 falls by 0.835 where it widens by 0.55: shoulders end 8 mm below it
        r = -((x - 0.095) * 0.835 + y * 0.55) - 0.008
        a = [[0, -0.05, 0], [-x, y, 0], [0, -0.2, 0], [-x, y, 0], [x, y, 0]]
        b = [[0, -0.15, 0], [x, y, 0], [0, -0.4, 0], [-x - 0.05, y - 0.3, 0], [x + 0.05, y - 0.3, 0]]
        return _body(a, b, [0.07, r, u(0.09, 0.1), 0.7 * r, 0.7 * r], [0, 0, 0, 1, 2])
    r = u(0.042, 0.05)
    return _body([[-0.08, 0, 0], [0.27, 0, 0]], [[0.27, 0, 0], [0.62, 0, 0]], [r, 0.9 * r], [0, 1])


def scene(kind: str, body: Body, motion: str, rng: np.random.Generator, *, vigour: float = 1.0, tilt: float = 0.7) -> Scene:
    """The body in one of `MOTIONS[kind]` with amplitudes, rates and phases drawn at random; vigour scales amplitudes; a sleeve hangs
    by `tilt` [rad] below level."""
    bones = int(body.bone.max()) + 1
    u = rng.uniform
    move = {
        "sway": lambda: _translation(vigour * u(0.07, 0.12) * _level(rng), u(0.9, 1.3)),
        "bounce": lambda: _translation(vigour * u(0.04, 0.06) * np.array([0, 1.0, 0]), u(1.4, 2.0)),
        "turn": lambda: _rotation(vigour * (0.6 if kind == "curtain" else 1.0) * u(0.5, 0.9) * np.array([0, 1.0, 0]), u(0.8, 1.1)),
        "walk": lambda: _translation(vigour * np.array([u(0.03, 0.05), u(0.01, 0.02), 0]), u(0.9, 1.1)),
        "ball": lambda: _still,
        "arms": lambda: _rotation(vigour * u(0.15, 0.3) * np.array([0, 1.0, 0]), u(0.8, 1.1)),
        "raise": lambda: _rotation(vigour * u(0.35, 0.6) * np.array([0, 0, 1.0]), u(0.8, 1.1)),
        "elbow": lambda: _rotation(vigour * u(0.1, 0.2) * np.array([0, 0, 1.0]), u(0.8, 1.1)),
    }[motion]()
    drift, drifting = (
        _translation(vigour * u(0.03, 0.05) * _level(rng), u(0.6, 0.9)),
        _rotation(vigour * u(0.1, 0.25) * np.array([0, 1.0, 0]), u(0.5, 0.8)),
    )
    limbs = _limbs(kind, motion, body, rng, vigour)
    hang = matrix_from_axis_angle(np.array([0, 0, -tilt])) if kind == "sleeve" else np.eye(3)

    aside = {1} if kind == "curtain" else set()  # what stands beside a curtain does not hang on its rod

    def pose(t: float) -> tuple[Array, Array]:
        R0, p0 = move(t)
        R0, p0 = drifting(t)[0] @ R0 @ hang, p0 + drift(t)[1]
        R, p = np.empty((bones, 3, 3)), np.empty((bones, 3))
        for k in range(bones):
            Rk, pk = limbs[k](t) if k in limbs else (np.eye(3), np.zeros(3))
            R[k], p[k] = (Rk, pk) if k in aside else (R0 @ Rk, R0 @ pk + p0)
        return (R, p)

    return Scene(body, pose, motion)


def _limbs(kind: str, motion: str, body: Body, rng: np.random.Generator, vigour: float) -> dict[int, Callable]:
    """Motion of bones 1, 2 … relative to bone 0."""
    u = rng.uniform
    if kind == "curtain":
        reach = vigour * (u(0.1, 0.16) if motion == "ball" else u(0.0, 0.04))
        return {1: _translation(np.array([0, 0, 1.0]) * reach, u(0.8, 1.1))}
    if kind == "skirt" and motion == "walk":
        swing, rate = vigour * u(0.3, 0.45), u(0.9, 1.1)
        return {k: _about(body.a[k], sign * swing * np.array([1.0, 0, 0]), rate) for k, sign in ((1, 1), (2, -1))}
    if kind == "cape" and motion == "arms":
        lift, swing, rate = vigour * u(0.2, 0.4), vigour * u(0.3, 0.5), u(0.8, 1.1)
        return {k: _about(body.a[k + 2], np.array([side * swing, 0, side * lift]), rate) for k, side in ((1, -1), (2, 1))}
    if kind == "sleeve" and motion == "elbow":
        return {1: _about(body.a[1], vigour * u(0.6, 1.0) * np.array([0, 0.3, 1.0]), u(0.7, 1.0))}
    return {}


def _body(a: list, b: list, radius: list, bone: list) -> Body:
    return Body(np.array(a, float), np.array(b, float), np.array(radius, float), np.array(bone, np.int32))


def _level(rng: np.random.Generator) -> Array:
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), 0, np.sin(angle)])


def _wave(t: float, rate: float) -> float:
    """A sine of `rate` Hz whose amplitude grows smoothly from 0 over RAMP."""
    y = min(max(t / RAMP, 0.0), 1.0)
    return float(y**3 * (10 - 15 * y + 6 * y * y) * np.sin(2 * np.pi * rate * t))


def _translation(amplitude: Array, rate: float) -> Callable:
    return lambda t: (np.eye(3), amplitude * _wave(t, rate))


def _rotation(amplitude: Array, rate: float) -> Callable:
    return lambda t: (matrix_from_axis_angle(amplitude * _wave(t, rate)), np.zeros(3))


def _about(centre: Array, amplitude: Array, rate: float) -> Callable:
    def pose(t: float) -> tuple[Array, Array]:
        R = matrix_from_axis_angle(amplitude * _wave(t, rate))
        return R, centre - R @ centre

    return pose


def _still(_: float) -> tuple[Array, Array]:
    return np.eye(3), np.zeros(3)
