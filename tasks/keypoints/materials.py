"""Procedural surface colours for training pictures: skin, cloth, hair, walls.

    colour(p) = tint · [c₁ + (c₂ − c₁) · pattern(k·p)] · (1 + a · noise(p/ℓ)),   p a point of the rest shape [m] (a solid texture)

Solid textures need no UV map (Perlin 1985). Limits: no photographs, no prints, no transparency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PATTERNS = ("solid", "stripes", "checks", "blotches", "dots")


@dataclass(frozen=True)
class Material:
    """Two linear RGB colours in [0,1], the pattern between them, its wave vector [rad/m], and the grain: amplitude and size [m]."""

    first: tuple[float, float, float]
    second: tuple[float, float, float]
    pattern: int = 0  # index into PATTERNS
    wave: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grain: float = 0.0
    grain_size: float = 0.05
    gloss: float = 0.0

    def row(self) -> np.ndarray:
        """The thirteen numbers that the shader reads."""
        return np.array([*self.first, *self.second, self.pattern, *self.wave, self.grain, self.grain_size, self.gloss], np.float32)


def cloth(random: np.random.Generator) -> Material:
    """Any colour, half of them plain, patterns of 1 to 20 cm."""
    direction = random.normal(0, 1, 3) * random.choice([(1, 0.05, 0.05), (0.05, 1, 0.05), (1, 1, 1)])
    return Material(
        first=_colour(random),
        second=_colour(random),
        pattern=int(random.choice(len(PATTERNS), p=(0.5, 0.17, 0.11, 0.14, 0.08))),
        wave=tuple(direction / np.linalg.norm(direction) * 2 * np.pi / np.exp(random.uniform(np.log(0.012), np.log(0.2)))),
        grain=random.choice([0.0, random.uniform(0, 0.5)]),
        grain_size=np.exp(random.uniform(np.log(0.01), np.log(0.15))),
        gloss=random.choice([0.0, random.uniform(0, 0.4)]),
    )


def skin_material(random: np.random.Generator) -> Material:
    """From very light to very dark, along the line of measured skin reflectances (sRGB 255,219,172 to 60,35,20), linear."""
    s = random.uniform(0, 1)
    srgb = np.array([250, 215, 190]) * (1 - s) ** 0.8 + np.array([60, 38, 25]) * s**1.2
    linear = np.clip((srgb + random.normal(0, 8, 3)) / 255, 0.02, 1) ** 2.2
    return Material(
        tuple(linear), tuple(linear), grain=random.uniform(0, 0.25), grain_size=random.uniform(0.01, 0.08), gloss=random.uniform(0, 0.35)
    )


def hair_material(random: np.random.Generator) -> Material:
    """Black, brown, blond, grey, seldom dyed; dark strands through it."""
    natural = np.array([(0.01, 0.008, 0.006), (0.05, 0.025, 0.012), (0.15, 0.07, 0.03), (0.4, 0.26, 0.12), (0.3, 0.3, 0.3)])
    colour = natural[random.integers(5)] * random.uniform(0.6, 1.4) if random.random() < 0.92 else np.array(_colour(random))
    wave = random.normal(0, 300, 3)
    return Material(
        tuple(colour), tuple(0.6 * colour), pattern=1, wave=tuple(wave), grain=0.4, grain_size=0.01, gloss=random.uniform(0, 0.3)
    )


def wall(random: np.random.Generator) -> Material:
    """Something to stand before: larger patterns, greyer colours than cloth."""
    material = cloth(random)
    grey = random.uniform(0.05, 0.9)
    mute = random.uniform(0, 1)
    first, second = (tuple(mute * grey + (1 - mute) * np.array(c)) for c in (material.first, material.second))
    scale = np.exp(random.uniform(np.log(2), np.log(12)))
    return Material(
        first, second, material.pattern, tuple(np.array(material.wave) / scale), material.grain, material.grain_size * scale, 0.0
    )


def _colour(random: np.random.Generator) -> tuple[float, float, float]:
    if random.random() < 0.3:  # white, grey and black clothes are commoner than chance would have it
        return (float(random.uniform(0, 1) ** 2),) * 3
    return tuple(float(c) for c in random.uniform(0.05, 1, 3) ** 2.2)
