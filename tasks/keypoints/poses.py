"""Random poses of a whole body within the reach of human joints, for training pictures.

A family (standing, walking, one-leg balance, crouching, sitting, bending, star) is drawn for trunk and legs, and an arm gesture for each
arm. Upper arms are aimed by direction (elevation from hanging, azimuth from sideways to forwards) and twisted about their length; thighs
by flexion, abduction and twist; hinges (elbow, knee, fingers) bend one way only.

Ranges: American Academy of Orthopaedic Surgeons' normal joint motion, narrowed a little.
Limits: body parts may run through one another; no contact with the ground beyond the lowest point standing on it; nobody lies down.
"""

from __future__ import annotations

import numpy as np

from tasks.geometry.rotations import axis_angle_from_matrix, matrix_from_axis_angle, rotation_between

JOINTS = 55
SIDES = ((1.0, 13, 16, 18, 20, 25), (-1.0, 14, 17, 19, 21, 40))  # sign of x, collar, shoulder, elbow, wrist, first finger joint
LEGS = ((1.0, 1, 4, 7, 10), (-1.0, 2, 5, 8, 11))  # sign of x, hip, knee, ankle, foot
SPINE = (3, 6, 9)
NECK, HEAD, JAW, EYES = 12, 15, 22, (23, 24)
X, Y, Z = np.eye(3)  # rest pose: x to the left of the body, y up, z to the front; arms along ±x, palms down
GESTURES = {  # degrees: elevation of the upper arm, azimuth, twist, flexion of the elbow; each drawn evenly in its range
    "hang": ((0, 25), (-30, 60), (-30, 40), (0, 35)),
    "swing": ((5, 45), (60, 100), (-30, 30), (5, 90)),
    "behind": ((5, 40), (-90, -40), (-60, 10), (0, 60)),
    "side": ((50, 110), (-15, 30), (-60, 60), (0, 60)),
    "forward": ((50, 120), (50, 110), (-60, 60), (0, 110)),
    "overhead": ((120, 175), (-10, 80), (-60, 60), (0, 100)),
    "hip": ((25, 55), (-30, 20), (40, 90), (70, 120)),
    "folded": ((10, 45), (30, 90), (40, 90), (80, 135)),
    "any": ((0, 175), (-40, 120), (-80, 80), (0, 140)),
}
GESTURE_SHARES = {"hang": 4, "swing": 3, "behind": 0.7, "side": 2, "forward": 2, "overhead": 1.7, "hip": 1, "folded": 1, "any": 3}
FAMILIES = {"stand": 4, "walk": 5, "balance": 3, "crouch": 1.5, "sit": 0.8, "bend": 1.5, "star": 1}


def random_pose(random: np.random.Generator) -> np.ndarray:
    """Axis-angle pose [55,3] rad in SMPL-X joint order; the root leans a little but does not turn."""
    R = np.tile(np.eye(3), (JOINTS, 1, 1))
    family = _draw(random, FAMILIES)
    _legs(R, family, random)
    _trunk(R, family, random)
    for side in SIDES:
        _arm(R, side, _draw(random, GESTURE_SHARES), random)
        _hand(R, side, random)
    return axis_angle_from_matrix(R)


def _legs(R: np.ndarray, family: str, random: np.random.Generator) -> None:
    """Flexion, abduction, twist of the hips and flexion of knees and ankles, degrees; the first leg of `order` does the act."""
    flex, out, knee = random.uniform(-8, 12, 2), random.uniform(-3, 12, 2), random.uniform(0, 15, 2)
    act = random.integers(2)
    if family == "walk":
        stride = random.uniform(10, 35)
        flex[act], flex[1 - act] = stride, -0.7 * stride
        knee = np.array([random.uniform(0, 25), random.uniform(0, 70)])[[act, 1 - act]]
    elif family == "balance":
        flex[act], out[act], knee[act] = random.uniform(-30, 100), random.uniform(-10, 45), random.uniform(0, 130)
    elif family == "crouch":
        depth = random.uniform(0.3, 1)
        flex, knee = depth * random.uniform(70, 115, 2), depth * random.uniform(80, 135, 2)
        out = random.uniform(0, 35, 2)
    elif family == "sit":
        flex, knee, out = random.uniform(70, 95, 2), random.uniform(50, 110, 2), random.uniform(-3, 25, 2)
    elif family == "star":
        out = random.uniform(10, 40, 2)
    for (sign, hip, shin, ankle, foot), f, o, k in zip(LEGS, flex, out, knee):
        R[hip] = _turn(Z, sign * o) @ _turn(X, -f) @ _turn(Y, sign * random.uniform(-15, 35))
        R[shin] = _turn(X, k)
        R[ankle] = _turn(X, random.uniform(-20, 25)) @ _turn(Z, random.uniform(-12, 12))
        R[foot] = _turn(X, random.choice([0, 0, -random.uniform(0, 40)]))


def _trunk(R: np.ndarray, family: str, random: np.random.Generator) -> None:
    flex = {"bend": random.uniform(25, 85), "crouch": random.uniform(0, 60), "sit": random.uniform(-5, 35)}.get(family, random.normal(4, 9))
    lean, twist = random.normal(0, 14 if family in ("balance", "bend") else 7), random.normal(0, 14)
    for joint in SPINE:
        R[joint] = _turn(X, flex / 3) @ _turn(Z, lean / 3) @ _turn(Y, twist / 3)
    for joint in (NECK, HEAD):
        pitch, roll, yaw = np.clip(random.normal((4, 0, 0), (10, 6, 18)), (-25, -15, -38), (28, 15, 38))
        R[joint] = _turn(Y, yaw) @ _turn(X, pitch) @ _turn(Z, roll)
    hinge = random.uniform(0, 60) if family == "bend" else random.normal(0, 6)
    R[0] = _turn(Z, random.normal(0, 18 if family == "balance" else 5)) @ _turn(X, hinge)
    if family == "bend":  # the hips fold, the legs stay under the body
        for _, hip, *_ in LEGS:
            R[hip] = _turn(X, -hinge) @ R[hip]
    R[JAW] = _turn(X, max(0.0, random.normal(2, 6)))
    gaze = _turn(Y, random.normal(0, 10)) @ _turn(X, random.normal(0, 6))
    for eye in EYES:
        R[eye] = gaze


def _arm(R: np.ndarray, side: tuple, gesture: str, random: np.random.Generator) -> None:
    sign, collar, shoulder, elbow, wrist, _ = side
    raised, azimuth, twist, bend = (np.deg2rad(random.uniform(*span)) for span in GESTURES[gesture])
    aim = np.array([sign * np.sin(raised) * np.cos(azimuth), -np.cos(raised), np.sin(raised) * np.sin(azimuth)])
    # a third of the elevation beyond 60° comes from the shoulder blade, as in scapulohumeral rhythm (Inman 1944)
    R[collar] = _turn(Z, sign * (np.rad2deg(max(raised - 1.05, 0.0)) / 3 + random.normal(0, 4))) @ _turn(Y, random.normal(0, 5))
    along = sign * X
    R[shoulder] = R[collar].T @ rotation_between(along, aim) @ matrix_from_axis_angle(twist * X)
    R[elbow] = _turn(Y, -sign * np.rad2deg(bend)) @ _turn(X, random.uniform(-70, 70))
    R[wrist] = _turn(Z, random.normal(0, 22)) @ _turn(Y, random.normal(0, 10))


def _hand(R: np.ndarray, side: tuple, random: np.random.Generator) -> None:
    """Fingers curl about the line of knuckles: from spread flat to a fist, each a little on its own; the thumb less."""
    sign, *_, first = side
    curl = random.choice([random.uniform(0, 25), random.uniform(0, 90)])
    for finger in range(5):
        own = np.clip(curl + random.normal(0, 12), -5, 95) * (0.35 if finger == 4 else 1.0)
        spread = _turn(Y, random.normal(0, 5))
        for segment in range(3):
            R[first + 3 * finger + segment] = _turn(Z, -sign * own) @ (spread if segment == 0 else np.eye(3))


def _turn(axis: np.ndarray, degrees: float) -> np.ndarray:
    return matrix_from_axis_angle(np.deg2rad(degrees) * axis)


def _draw(random: np.random.Generator, shares: dict[str, float]) -> str:
    p = np.array(list(shares.values()))
    return list(shares)[random.choice(len(p), p=p / p.sum())]
