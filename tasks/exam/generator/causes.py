"""What a recording may have that the base model lacks: every effect of the library written a second time, in another way, and some that the
library does not have.

Forces of the air act on nodes, with the normal and area of the node. A cause changes the conditions of a recording; its strength has the
unit and the sign that the public names give it (docs of the diagnosis), so that an estimate can be compared.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.exam.generator.bending import hinge_stencils
from tasks.exam.generator.fabric import Fabric
from tasks.exam.generator.garments import Sheet
from tasks.exam.generator.stepper import Moment, NodeForce
from tasks.geometry.meshes import boundary_edges

Array = NDArray[np.float64]
AIR = 1.2  # kg/m³
WIND_DRAG = 8.0  # C_d/ρ̄ with which wind acts [m²/kg]
G = 9.81


@dataclass(frozen=True)
class Conditions:
    """Everything but the motion: the fabric, contact, gravity, forces on nodes; and how it is recorded.

    body_late [s]: the collider is recorded that late against the garment. slip [m/s]: the pinned nodes creep down, which is not recorded.
    smoothing [s]: standard deviation in time of the tracker's average.
    """

    sheet: Sheet
    fabric: Fabric
    friction: float = 0.2
    offset: float = 0.0
    gravity: tuple[float, float, float] = (0.0, -G, 0.0)
    forces: tuple[NodeForce, ...] = ()
    body_late: float = 0.0
    slip: float = 0.0
    smoothing: float = 0.0

    @property
    def density(self) -> float:
        """Areal density ρ̄ [kg/m²] of the base fabric."""
        return float(np.median(self.fabric.density))

    def acting(self, force: NodeForce) -> "Conditions":
        """With one more force on the nodes."""
        return replace(self, forces=(*self.forces, force))

    def made_of(self, **changes: object) -> "Conditions":
        """With another fabric."""
        return replace(self, fabric=self.fabric.with_(**changes))


@dataclass(frozen=True)
class Cause:
    """A strength in `unit`: a guess to begin with and the largest that is plausible, which the diagnosis may fit; `apply(conditions, θ)`.

    symmetric: the sign is drawn. moves: whether the cloth moves differently (otherwise only its recording does). local: where it acts is
    part of the question. touches: it acts where the body is. needs: kinds of garment that can show it. order: displacement grows with θ to
    this power. along: symbol of the strength that θ is, where the effect has several; None where θ is the size of them all.
    """

    name: str
    unit: str
    guess: float
    most: float
    apply: Callable[[Conditions, float], Conditions]
    symmetric: bool = False
    moves: bool = True
    local: bool = False
    touches: bool = False
    needs: tuple[str, ...] = ("skirt", "curtain", "cape", "sleeve")
    order: float = 1.0
    along: str | None = None


def _block(c: Array, n: Array) -> Array:
    """c n nᵀ [V, 3, 3]."""
    return c[:, None, None] * n[:, :, None] * n[:, None, :]


def _along(c: Array, n: Array) -> Array:
    """c (I − n nᵀ) [V, 3, 3]."""
    return c[:, None, None] * np.eye(3) - _block(c, n)


def normal_drag(c: float) -> NodeForce:
    """c = C_d [1]: −½ ρ_a c A |v·n| (v·n) n."""

    def force(m: Moment) -> tuple[Array, Array]:
        u = np.sum(m.v * m.normal, 1)
        k = 0.5 * AIR * c * m.area * np.abs(u)
        return -(k * u)[:, None] * m.normal, _block(2 * k / m.s, m.normal)

    return force


def tangential_drag(c: float) -> NodeForce:
    """c = C_t [1]: −½ ρ_a c A |v_t| v_t."""

    def force(m: Moment) -> tuple[Array, Array]:
        v = m.v - np.sum(m.v * m.normal, 1)[:, None] * m.normal
        k = 0.5 * AIR * c * m.area * np.linalg.norm(v, axis=1)
        return -k[:, None] * v, _along(1.5 * k / m.s, m.normal)

    return force


def linear_drag(c: float) -> NodeForce:
    """c [N s/m³]: −c A (v·n) n."""

    def force(m: Moment) -> tuple[Array, Array]:
        k = c * m.area
        return -(k * np.sum(m.v * m.normal, 1))[:, None] * m.normal, _block(k / m.s, m.normal)

    return force


def lift(c: float) -> NodeForce:
    """c = C_l [1]: −½ ρ_a c A (v·n) (|v| n − (v·n) v/|v|)."""

    def force(m: Moment) -> tuple[Array, Array]:
        speed = np.maximum(np.linalg.norm(m.v, axis=1), 1e-9)
        u = np.sum(m.v * m.normal, 1)
        f = -(0.5 * AIR * c * m.area * u)[:, None] * (speed[:, None] * m.normal - (u / speed)[:, None] * m.v)
        return f, _block(0.5 * AIR * c * m.area * speed / m.s, m.normal)

    return force


def added_mass(a: float) -> NodeForce:
    """a [kg/m²]: −a A (v̇·n) n."""

    def force(m: Moment) -> tuple[Array, Array]:
        k = a * m.area
        return -(k * np.sum(m.a * m.normal, 1))[:, None] * m.normal, _block(k / m.s**2, m.normal)

    return force


def wind(c: float, speed: Callable[[Array, float], Array]) -> NodeForce:
    """Drag c = C_d [1] of air that moves at speed(x, t) [V, 3] m/s less that of air at rest."""

    def force(m: Moment) -> tuple[Array, Array]:
        u = np.sum(m.v * m.normal, 1)
        w = u - np.sum(speed(m.x, m.t) * m.normal, 1)
        k = 0.5 * AIR * c * m.area
        return -(k * (np.abs(w) * w - np.abs(u) * u))[:, None] * m.normal, _block(
            k * 2 * np.maximum(np.abs(w) - np.abs(u), 0) / m.s, m.normal
        )

    return force


def mass_damping(α: float) -> NodeForce:
    """−α m v."""

    def force(m: Moment) -> tuple[Array, Array]:
        return -α * m.mass[:, None] * m.v, (α * m.mass / m.s)[:, None, None] * np.eye(3)

    return force


def pressure(p: float) -> NodeForce:
    """p [Pa] from within."""

    def force(m: Moment) -> tuple[Array, Array]:
        return (p * m.area)[:, None] * m.normal, np.zeros((len(m.x), 3, 3))

    return force


def cling(strength: float) -> NodeForce:
    """Attraction to the body: acceleration `strength` [m/s²] that fades over 1 cm."""

    def force(m: Moment) -> tuple[Array, Array]:
        d, n = m.body.distance(m.x)
        k = d.argmin(0)
        d, n = d[k, np.arange(len(k))], n[k, np.arange(len(k))]
        return -(strength * m.mass * np.exp(-np.maximum(d, 0) / 0.01))[:, None] * n, np.zeros((len(m.x), 3, 3))

    return force


def _steady(w: float, angle: float) -> Callable[[Array, float], Array]:
    direction = w * np.array([np.cos(angle), 0, np.sin(angle)])
    return lambda x, t: np.broadcast_to(direction, x.shape)


def _gusts(w: float) -> Callable[[Array, float], Array]:
    """Puffs of wind that pass over the garment."""

    def speed(x: Array, t: float) -> Array:
        along = x @ np.array([0.8, 0.2, 0.6])
        strength = w * np.maximum(np.sin(2 * np.pi * (1.7 * t - 1.3 * along)), 0) ** 2 * np.sin(2 * np.pi * 0.61 * t + 0.5)
        return strength[:, None] * np.array([0.6, 0.1, 0.8])

    return speed


def tilted(θ: float, angle: float = 0.4) -> tuple[float, float, float]:
    """Gravity turned by θ about a horizontal axis."""
    axis = np.array([np.cos(angle), 0, np.sin(angle)])
    down = np.array([0, -1.0, 0])
    g = G * (np.cos(θ) * down + np.sin(θ) * np.cross(axis, down))
    return tuple(float(v) for v in g)


def _scaled(c: Conditions, s: float) -> Conditions:
    """In metres that are e^-s of a metre: rest lengths and gravity are e^s of what they should be, and what is recorded needs no change."""
    return replace(c.made_of(rest_scale=np.exp(s) - 1), gravity=(0.0, -G * np.exp(s), 0.0))


def relative_density(sheet: Sheet, g: float) -> Array:
    """1 + g η [F], η from the mean height of the sheet upwards in units of its whole height."""
    y = sheet.rest[sheet.faces, 1].mean(1)
    return 1 + g * (y - np.average(y, weights=sheet.areas)) / np.ptp(sheet.rest[:, 1])


def hem_mass(sheet: Sheet, per_length: float) -> Array:
    """Mass [V] kg of a border that weighs `per_length` [kg/m], where nothing carries it."""
    border = boundary_edges(sheet.faces)
    pinned = np.zeros(len(sheet.rest), bool)
    pinned[sheet.pinned] = True
    border = border[~pinned[border].all(1)]
    length = np.linalg.norm(sheet.rest[border[:, 0]] - sheet.rest[border[:, 1]], axis=1)
    return np.bincount(border.ravel(), np.repeat(length / 2, 2), minlength=len(pinned)) * per_length


def _graded(c: Conditions, g: float) -> Conditions:
    return c.made_of(density=c.fabric.density * relative_density(c.sheet, g))


def _hemmed(c: Conditions, width: float) -> Conditions:
    return c.made_of(line_mass=c.fabric.line_mass + hem_mass(c.sheet, width * c.density))


def _sewn(c: Conditions, r: float) -> Conditions:
    n = len(c.sheet.rest)
    keys = {int(min(e)) * n + int(max(e)) for e in c.sheet.seam}
    on_seam = np.array([int(min(h[:2])) * n + int(max(h[:2])) in keys for h in hinge_stencils(c.sheet.faces)])
    return c.made_of(bending=c.fabric.bending * np.where(on_seam, np.exp(r), 1.0))


def _printed(c: Conditions, r: float) -> Conditions:
    """A stiff print on a disc of the garment: stretch and bending times e^r there."""
    centre = np.array([c.sheet.rest[:, 0].max() * 0.6, np.quantile(c.sheet.rest[:, 1], 0.4), c.sheet.rest[:, 2].max()])
    near = np.linalg.norm(c.sheet.rest - centre, axis=1)
    inside = near < np.quantile(near, 0.35)
    on_face = inside[c.sheet.faces].all(1)
    on_hinge = inside[hinge_stencils(c.sheet.faces)[:, :2]].all(1)
    return c.made_of(
        stretch=c.fabric.stretch * np.where(on_face, np.exp(r / 2), 1.0), bending=c.fabric.bending * np.where(on_hinge, np.exp(r), 1.0)
    )


SEWN = ("skirt", "cape", "sleeve")
BODIES = ("skirt", "cape", "sleeve", "curtain")
UPRIGHT = ("skirt", "curtain", "cape")

CAUSES = {
    c.name: c
    for c in (
        Cause("air_normal_drag", "m2/kg", 8.0, 25.0, lambda c, θ: c.acting(normal_drag(θ * c.density))),
        Cause("air_tangential_drag", "m2/kg", 2.0, 4.0, lambda c, θ: c.acting(tangential_drag(θ * c.density))),
        Cause("air_linear_drag", "1/s", 2.0, 4.0, lambda c, θ: c.acting(linear_drag(θ * c.density))),
        Cause("air_lift", "m2/kg", 5.0, 15.0, lambda c, θ: c.acting(lift(θ * c.density))),
        Cause("air_added_mass", "1", 1.0, 5.0, lambda c, θ: c.acting(added_mass(θ * c.density))),
        Cause("air_wind", "m/s", 0.5, 2.0, lambda c, θ: c.acting(wind(WIND_DRAG * c.density, _steady(θ, 0.7))), order=2.0),
        Cause("fabric_membrane_damping", "s", 1e-2, 2e-2, lambda c, θ: c.made_of(membrane_viscosity=θ)),
        Cause("fabric_bending_damping", "s", 3e-2, 2e-1, lambda c, θ: c.made_of(bending_viscosity=θ)),
        Cause("fabric_mass_damping", "1/s", 1.0, 3.0, lambda c, θ: c.acting(mass_damping(θ))),
        Cause("fabric_bending_hysteresis", "m3/s2", 1.5e-3, 7e-3, lambda c, θ: c.made_of(bending_friction=θ * c.density)),
        Cause("fabric_shear_hysteresis", "m2/s2", 5.0, 25.0, lambda c, θ: c.made_of(shear_friction=θ * c.density)),
        Cause("fabric_orthotropy", "1", 0.8, 1.2, lambda c, θ: c.made_of(orthotropy=θ), symmetric=True, needs=("curtain",)),
        Cause("fabric_stiffening", "1", 1000.0, 1e4, lambda c, θ: c.made_of(stiffening=θ)),
        Cause("fabric_density_gradient", "1", 0.5, 1.0, _graded, symmetric=True, needs=UPRIGHT),
        Cause("fabric_hem_mass", "m", 0.05, 0.25, _hemmed, local=True),
        Cause("fabric_seam_stiffness", "1", 2.0, 3.0, _sewn, local=True, needs=SEWN),
        Cause("fabric_rest_scale", "1", 0.02, 0.1, lambda c, θ: c.made_of(rest_scale=np.exp(θ) - 1), symmetric=True),
        Cause("fabric_rest_curvature", "1/m", 5.0, 20.0, lambda c, θ: c.made_of(rest_curvature=θ), symmetric=True, along="κ₀"),
        Cause("fabric_crease", "1", 0.5, 1.0, lambda c, θ: c.made_of(crease=θ)),
        Cause("contact_friction", "1", 0.4, 1.0, lambda c, θ: replace(c, friction=c.friction + θ), local=True, touches=True, needs=BODIES),
        Cause("contact_thickness", "m", 0.004, 0.01, lambda c, θ: replace(c, offset=c.offset + θ), local=True, touches=True, needs=BODIES),
        Cause("body_offset", "m", 0.006, 0.02, lambda c, θ: replace(c, offset=c.offset + θ), local=True, touches=True, needs=BODIES),
        Cause("body_lag", "s", 0.033, 0.1, lambda c, θ: replace(c, body_late=θ), local=True, touches=True, needs=BODIES),
        Cause("boundary_slip", "m/s", 0.008, 0.02, lambda c, θ: replace(c, slip=θ), needs=("skirt", "cape", "curtain"), along="u"),
        Cause("observation_delay", "s", 0.033, 0.1, lambda c, θ: replace(c, body_late=-θ), local=True, touches=True, needs=BODIES),
        Cause("observation_smoothing", "s2", 2e-3, 0.01, lambda c, θ: replace(c, smoothing=np.sqrt(θ)), moves=False),
        Cause("observation_scale", "1", 0.01, 0.05, _scaled, symmetric=True),
        Cause("gravity_tilt", "rad", 0.03, 0.09, lambda c, θ: replace(c, gravity=tilted(θ))),
        # what the library does not have
        Cause("wind_gusts", "m/s", 1.2, 5.0, lambda c, θ: c.acting(wind(WIND_DRAG * c.density, _gusts(θ))), order=1.5),
        Cause("print_stiffness", "1", 2.0, 5.0, _printed, local=True),
        Cause("sleeve_pressure", "Pa", 0.3, 5.0, lambda c, θ: c.acting(pressure(θ)), needs=("sleeve", "skirt")),
        Cause("static_cling", "m/s2", 3.0, 40.0, lambda c, θ: c.acting(cling(θ)), touches=True, needs=SEWN),
    )
}
OUTSIDE = ("wind_gusts", "print_stiffness", "sleeve_pressure", "static_cling")
LIBRARY = tuple(name for name in CAUSES if name not in OUTSIDE)
