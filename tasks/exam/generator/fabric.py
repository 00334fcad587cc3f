"""The cloth of the generator: its numbers per element, and what it remembers."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator.bending import hinge_angles, hinge_stencils, hinge_weights
from tasks.exam.generator.garments import Sheet
from tasks.exam.generator.membrane import biot_strain, moduli

Array = NDArray[np.float64]
Indices = NDArray[np.int32]
YIELD = 20.0  # curvature beyond which folds stay [1/m]
REACH = 6.0  # curvature that builds up the friction of bending [1/m]


@dataclass(frozen=True)
class Fabric:
    """density [F] kg/m², stretch E·t [F] N/m, bending B [H] N·m; what follows is absent at zero.

    line_mass [V] kg on the nodes. orthotropy: ln of the root of the ratio of Young's moduli, weft over warp. stiffening c.
    rest_scale s − 1. rest_curvature [1/m]. membrane_viscosity, bending_viscosity β [s]. shear_friction [N/m], bending_friction [N·m/m] per
    length of fold. crease: share of a fold beyond YIELD that stays.
    """

    density: Array
    stretch: Array
    bending: Array
    line_mass: Array
    orthotropy: float = 0.0
    stiffening: float = 0.0
    rest_scale: float = 0.0
    rest_curvature: float = 0.0
    membrane_viscosity: float = 0.0
    bending_viscosity: float = 0.0
    shear_friction: float = 0.0
    bending_friction: float = 0.0
    crease: float = 0.0

    @classmethod
    def even(cls, sheet: Sheet, density: float, stretch: float, bending: float) -> "Fabric":
        """The same everywhere, nothing else."""
        F, H, V = len(sheet.faces), len(hinge_stencils(sheet.faces)), len(sheet.rest)
        return cls(np.full(F, density), np.full(F, stretch), np.full(H, bending), np.zeros(V))

    def with_(self, **changes: object) -> "Fabric":
        """A copy with these numbers changed."""
        return replace(self, **changes)


class Elements:
    """A sheet's triangles and hinges with the constants of their forces."""

    def __init__(self, sheet: Sheet, fabric: Fabric) -> None:
        self.faces = np.ascontiguousarray(sheet.faces)
        self.hinges = hinge_stencils(sheet.faces)
        self.fabric = fabric
        e1, e2 = sheet.flat[:, 1] - sheet.flat[:, 0], sheet.flat[:, 2] - sheet.flat[:, 0]
        inverse = np.linalg.inv(np.stack([e1, e2], -1))  # [F, 2 corners, 2 directions]
        self.gradients = np.ascontiguousarray(np.concatenate([-inverse.sum(1, keepdims=True), inverse], 1))
        self.area = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]) / 2
        self.D = moduli(fabric.stretch, fabric.orthotropy)
        self.scale = 1 + fabric.rest_scale
        self.rigidity = fabric.bending * hinge_weights(sheet.rest, sheet.faces, self.hinges)
        a, b, c, d = (sheet.rest[self.hinges[:, k]] for k in range(4))
        self.fold = np.linalg.norm(b - a, axis=1)  # length of each hinge's edge
        doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1) + np.linalg.norm(np.cross(b - a, d - a), axis=1)
        self.height = doubled / (2 * self.fold)  # half of the two heights: over which the fold is spread
        self.rest_fold = hinge_angles(sheet.rest, self.hinges) + fabric.rest_curvature * self.height
        self.shear_limit = np.full(len(self.faces), fabric.shear_friction)
        self.bend_limit = fabric.bending_friction * self.fold
        self.bend_reach = REACH * self.height
        corner = np.repeat(self.area * fabric.density / 3, 3)
        self.mass = np.bincount(self.faces.ravel(), corner, minlength=len(sheet.rest)) + fabric.line_mass
        self.node_area = np.bincount(self.faces.ravel(), np.repeat(self.area / 3, 3), minlength=len(sheet.rest))

    @property
    def remembers(self) -> bool:
        """Whether friction or creases keep a state."""
        f = self.fabric
        return bool(f.shear_friction or f.bending_friction or f.crease)

    def memory(self, x: Array) -> "Memory":
        """What the cloth remembers if it came to rest at x, unstressed by friction."""
        e, φ = biot_strain(x, self.faces, self.gradients, self.scale), hinge_angles(x, self.hinges)
        return Memory(
            e,
            np.zeros_like(e),
            φ,
            np.zeros_like(φ),
            np.stack([e[:, 2], 0 * e[:, 2]], 1),
            np.stack([φ, 0 * φ], 1),
            np.zeros_like(φ),
        )


@dataclass
class Memory:
    """Strain e [F, 3] and fold φ [H] with their rates, last (shear, stress) [F, 2], last (fold, moment) [H, 2],
    and the fold [H] beyond yield."""

    e: Array
    e_rate: Array
    φ: Array
    φ_rate: Array
    shear: Array
    fold: Array
    yielded: Array

    def creased(self, elements: Elements) -> Array:
        """Folds beyond yield after this state: a play of ±YIELD around them."""
        limit = YIELD * elements.height
        over = self.φ - elements.rest_fold - self.yielded
        return self.yielded + np.sign(over) * np.maximum(np.abs(over) - limit, 0)

    def rest_fold(self, elements: Elements) -> Array:
        """φ̄ [H] with what stays of earlier folds."""
        return elements.rest_fold + elements.fabric.crease * self.yielded
