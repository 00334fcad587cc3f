"""Fabrics: the seed's units (ρ, κ_s, κ_b) of one reference cloth, or plain SI values.

    E t = E₀ t κ_s,      k = E₀ t³ / (24 (1 − ν²)) κ_b,      areal density ρ̄ = ρ t
    E₀ = 0.076 MPa, t = 0.328 mm, ν = 0.071      (95 % wool, 5 % lycra)

k is the constant of the hinge energy k (θ − θ̄)² |ē|/h̄. A sheet of regular triangles with it bends with the rigidity B = 6k [N·m] (a test
rolls one up), three times that of the plate E t³/(12 (1 − ν²)) of the same E, t, ν: B, not κ_b, is what a cantilever test measures.
κ_b is independent of κ_s; in the released code of PhysAvatar k carries κ_s as well (`Settings.bending = "coupled"`).

Source: Wang, O'Brien, Ramamoorthi 2011 (measured fabrics) as tabulated in Codim-IPC; PhysAvatar, supplement A.3.
"""

from dataclasses import dataclass
from typing import Self

YOUNG = 0.076e6  # E₀ [Pa]
THICKNESS = 0.328e-3  # t [m]
POISSON = 0.071  # ν [-]


@dataclass(frozen=True)
class Fabric:
    """density ρ [kg/m³], membrane κ_s, bending κ_b, friction μ against the collider, self_friction (None: as friction).

    orthotropy a: Young's moduli E e^a along weft (u) and E e^−a along warp (v); rest_scale: rest lengths relative to the rest mesh.
    """

    density: float = 320.0
    membrane: float = 1.0
    bending: float = 1.0
    friction: float = 0.2
    self_friction: float | None = None
    orthotropy: float = 0.0
    rest_scale: float = 1.0
    poisson: float = POISSON

    @classmethod
    def from_si(cls, *, areal_density: float, stretch: float, bending_rigidity: float, **others: float) -> Self:
        """areal_density ρ̄ [kg/m²], stretch E·t [N/m], bending_rigidity B [N·m] as measured on the cloth."""
        unit = cls(**others).bending_rigidity
        return cls(density=areal_density / THICKNESS, membrane=stretch / (YOUNG * THICKNESS), bending=bending_rigidity / unit, **others)

    @property
    def areal_density(self) -> float:
        """ρ̄ [kg/m²]."""
        return self.density * THICKNESS

    @property
    def stretch_stiffness(self) -> float:
        """E t [N/m]."""
        return YOUNG * THICKNESS * self.membrane

    @property
    def hinge_constant(self) -> float:
        """k [N·m]."""
        return YOUNG * THICKNESS**3 / (24 * (1 - self.poisson**2)) * self.bending

    @property
    def bending_rigidity(self) -> float:
        """B = 6k [N·m], exact for regular triangles."""
        return 6 * self.hinge_constant
