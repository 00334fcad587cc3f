"""Training pictures: a random dressed person, seen from anywhere around, with the truth of all 133 keypoints.

    person = body(shape, pose) + outfit;     scene = person + furniture + other people + room or backdrop;     picture = render(scene)

Each picture is framed as the detector will frame it: the box around the person, padded by a quarter, fills the middle 192 x 256 of
256 x 320 pixels. A keypoint is visible when no surface lies in front of it by more than the thickness of the body there.

Limits: the faces and clothes of computer graphics; one body family; no fur, glass, motion blur of limbs or text. What that costs on
photographs is measured in the folder's README, not assumed away.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from tasks.body.wholebody import keypoints133
from tasks.geometry.meshes import vertex_normals
from tasks.geometry.rotations import matrix_from_axis_angle
from tasks.keypoints.crop import INPUT_SIZE
from tasks.keypoints.materials import skin_material
from tasks.keypoints.poses import random_pose
from tasks.keypoints.shading import look_at, render
from tasks.keypoints.surroundings import furniture, painted_backdrop, random_light, random_room, stick_figure
from tasks.keypoints.wardrobe import Piece, Regions, dress, regions

SIZE = (256, 320)  # width, height [px] of a picture; the middle 192 x 256 is the detector's view
PADDING = 1.25  # box to crop, as in RTMPose
SUPERSAMPLING = 1.25
# [m] from the skin in front of a keypoint to it: nose, eyes, ears, shoulders, elbows, wrists, hips, knees, ankles; feet; face; hands
THICKNESS = np.array(
    [0.03, *2 * [0.03], *2 * [0.05], *2 * [0.12], *2 * [0.08], *2 * [0.06], *2 * [0.16], *2 * [0.1], *2 * [0.08]]
    + 6 * [0.06]
    + 68 * [0.03]
    + 42 * [0.03]
)


class Body(Protocol):
    """What is asked of a body model (`tasks.body.model.BodyModel`)."""

    faces: np.ndarray
    weights: np.ndarray

    def pose(self, shape, expression, pose, translation):
        """Posed body with vertices [V,3] and joints [55,3]."""


@dataclass(frozen=True)
class Person:
    """Meshes of a dressed person who stands on y = 0 at the origin, and keypoints [133,3] m."""

    pieces: list[Piece]
    keypoints: np.ndarray


@dataclass(frozen=True)
class Picture:
    """RGB image [320,256,3] uint8; keypoints [133,2] px (pixel centres at half integers), also where hidden or outside; visible [133]."""

    image: np.ndarray
    keypoints: np.ndarray
    visible: np.ndarray


class Studio:
    """Makes pictures of one body model; keeps what does not change from picture to picture, and the last few people as bystanders."""

    def __init__(self, body: Body, *, shapes: int, expressions: int):
        self.body, self.shapes, self.expressions = body, shapes, expressions
        rest = body.pose(np.zeros(shapes), np.zeros(expressions), np.zeros((55, 3)), np.zeros(3))
        self.regions: Regions = regions(rest.vertices, rest.joints, body.weights)
        self.paint = _paint_masks(rest.vertices, keypoints133(body, rest.vertices, rest.joints), body.weights)
        self.bystanders: list[Person] = []

    def person(self, random: np.random.Generator) -> Person:
        """A random person in a random pose and outfit."""
        shape = np.clip(random.normal(0, 1, self.shapes), -2.5, 2.5)
        expression = random.normal(0, 0.7, self.expressions)
        posed = self.body.pose(shape, expression, random_pose(random), np.zeros(3))
        shift = [posed.joints[0, 0], posed.vertices[:, 1].min(), posed.joints[0, 2]]
        x = posed.vertices - shift
        skin = skin_material(random)
        tint = _painted_skin(self.paint, np.array(skin.first), random)
        body = Piece(x, self.body.faces, vertex_normals(x, self.body.faces), self.regions.x, tint, skin)
        person = Person(
            [body, *dress(x, self.body.faces, self.regions, random)], keypoints133(self.body, posed.vertices, posed.joints) - shift
        )
        self.bystanders = [*self.bystanders[-5:], person]
        return person

    def picture(self, person: Person, random: np.random.Generator) -> Picture:
        """The person seen by a random camera, in random surroundings and light."""
        middle = np.array([0, 0.5 * person.keypoints[:17, 1].max(), 0]) + random.normal(0, 0.1, 3)
        eye = _random_eye(middle, random)
        roll = np.deg2rad(np.clip(random.normal(0, 7), -20, 20))
        R, t = look_at(eye, middle, roll)
        K = _framing(np.concatenate([piece.vertices for piece in person.pieces]) @ R.T + t)
        pieces = [*person.pieces, *furniture(eye, random), *self._others(eye, random)]
        size = tuple(int(SUPERSAMPLING * n) for n in SIZE)
        scaled = K * np.array([SUPERSAMPLING, SUPERSAMPLING, 1])[:, None]
        linear, depth, piece = render(pieces, scaled, R, t, size, random_light(random), random_room(eye, random))
        own = (piece >= 0) & (piece < len(person.pieces))
        if random.random() < 0.35:
            linear[piece < 0] = painted_backdrop(size, random)[piece < 0]
        p = person.keypoints @ R.T + t
        uv = p[:, :2] / p[:, 2:] * K[[0, 1], [0, 1]] + K[:2, 2]
        return Picture(_developed(linear, own, random), uv, _visible(uv * SUPERSAMPLING, p[:, 2], depth))

    def _others(self, eye: np.ndarray, random: np.random.Generator) -> list[Piece]:
        """Bystanders and now and then a stick figure; seldom in front of the person."""
        pieces = []
        for _ in range(random.choice(3, p=(0.62, 0.28, 0.1))):
            angle, distance = random.uniform(0, 2 * np.pi), random.uniform(0.7, 4.5)
            place = distance * np.array([np.cos(angle), 0, np.sin(angle)])
            if place @ eye > 0.3 * distance * np.linalg.norm(eye) and random.random() < 0.8:
                continue
            other = self.bystanders[random.integers(len(self.bystanders))]
            turn = matrix_from_axis_angle(np.array([0, random.uniform(0, 2 * np.pi), 0]))
            if random.random() < 0.2:
                pieces += stick_figure(other.keypoints @ turn.T + place)
            else:
                pieces += [
                    replace(piece, vertices=piece.vertices @ turn.T + place, normals=piece.normals @ turn.T) for piece in other.pieces
                ]
        return pieces


def _random_eye(middle: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """0.3 to 3 m above the floor, as far as a lens of 25° to 60° needs to hold the person."""
    distance = 1.1 / np.tan(np.deg2rad(random.uniform(25, 60)) / 2) * random.uniform(0.95, 1.3)
    angle, height = random.uniform(0, 2 * np.pi), random.choice([random.uniform(0.3, 3.0), random.normal(1.4, 0.3)])
    return middle * [1, 0, 1] + np.array([distance * np.cos(angle), max(height, 0.25), distance * np.sin(angle)])


def _framing(p: np.ndarray) -> np.ndarray:
    """K that puts the padded box around points p [V,3] (camera axes) into the middle 192 x 256 of the picture."""
    q = p[:, :2] / p[:, 2:]
    low, high = q.min(0), q.max(0)
    focal = 1 / (PADDING * np.max((high - low) / INPUT_SIZE))
    centre = np.array(SIZE) / 2 - focal * (low + high) / 2
    return np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])


def _visible(uv: np.ndarray, z: np.ndarray, depth: np.ndarray) -> np.ndarray:
    height, width = depth.shape
    i, j = np.floor(uv).astype(int).T
    inside = (i >= 0) & (j >= 0) & (i < width) & (j < height)
    return inside & (depth[np.clip(j, 0, height - 1), np.clip(i, 0, width - 1)] > z - THICKNESS)


def _developed(linear: np.ndarray, own: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Linear light to an 8-bit picture, exposed for the person more or less well, with noise of the sensor."""
    level = linear[own].mean() if own.any() else linear.mean()
    exposed = linear * np.float32(np.exp(random.normal(np.log(0.18), 0.45)) / max(level, 1e-4))
    small = cv2.resize(exposed, SIZE, interpolation=cv2.INTER_AREA)
    srgb = np.clip(small, 0, 1) ** np.float32(1 / random.uniform(1.8, 2.5))
    if random.random() < 0.5:
        channels = 1 if random.random() < 0.5 else 3
        srgb += random.uniform(0, 0.05) * random.standard_normal((*small.shape[:2], channels), np.float32)
    return np.clip(255 * srgb, 0, 255).astype(np.uint8)


def _paint_masks(x: np.ndarray, keypoints: np.ndarray, weights: np.ndarray) -> dict[str, np.ndarray]:
    """Share [V] by which each vertex belongs to brows, lips, eyeballs, irises, jaw (a beard)."""

    def near(points: np.ndarray, σ: float) -> np.ndarray:
        return np.exp(-(np.linalg.norm(x[:, None] - points[None], axis=2).min(1) ** 2) / (2 * σ**2))

    face = keypoints[23:91]
    eyeball = weights[:, 23:25].sum(1) > 0.9
    front = max(x[eyeball, 2].max(), -np.inf) if eyeball.any() else 0.0
    return {
        "brow": near(face[17:27], 0.005),
        "lip": near(face[48:68], 0.006),
        "beard": near(face[3:14], 0.025),
        "eyeball": eyeball.astype(float),
        "iris": (eyeball & (x[:, 2] > front - 0.004)).astype(float),
    }


def _painted_skin(paint: dict[str, np.ndarray], skin: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Factors [V,3] on the skin colour that draw the features of a face."""
    tint = np.ones((len(paint["brow"]), 3))
    layers = [("brow", random.uniform(0.1, 0.9) * np.ones(3)), ("lip", np.array([random.uniform(0.7, 1.1), *random.uniform(0.35, 0.8, 2)]))]
    if random.random() < 0.25:
        layers.append(("beard", random.uniform(0.15, 0.7) * np.ones(3)))
    layers += [("eyeball", 0.75 / skin), ("iris", random.uniform(0.01, 0.15, 3) / skin)]
    for name, colour in layers:
        share = paint[name][:, None]
        tint = tint * (1 - share) + colour * share
    return tint
