"""The generator's own physics against closed forms."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tasks.exam.generator.bending import bend, hinge_angles, hinge_stencils, hinge_weights
from tasks.exam.generator.bodies import Body
from tasks.exam.generator.causes import CAUSES, Conditions
from tasks.exam.generator.fabric import Elements, Fabric
from tasks.exam.generator.garments import Cut, Garment, tailor
from tasks.exam.generator.matrix import _times
from tasks.exam.generator.membrane import biot_strain, membrane
from tasks.exam.generator.pattern_mesh import Pattern
from tasks.exam.generator.stepper import Moment, Stepper, World
from tasks.geometry.meshes import face_areas, vertex_normals

G = 9.81
NOTHING = Body(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int32))


def still(_: float) -> tuple[np.ndarray, np.ndarray]:
    return np.eye(3)[None], np.zeros((1, 3))


def panel(vertices: int = 60, width: float = 0.2, height: float = 0.4) -> Garment:
    return tailor(Cut("curtain", Pattern(width, height), "plane", "top"), vertices, 2.0, np.random.default_rng(0))


def world(garment: Garment, fabric: Fabric, body: Body = NOTHING, pose: Callable = still) -> World:
    pinned = garment.fine.rest[garment.fine.pinned]
    return World(garment.fine, fabric, body, pose, lambda t: pinned)


def noisy(garment: Garment, amplitude: float) -> np.ndarray:
    return garment.fine.rest + amplitude * np.random.default_rng(1).normal(size=garment.fine.rest.shape)


def test_biot_strain_is_the_polar_decompositions():
    garment = panel()
    x = noisy(garment, 5e-3)
    E = Elements(garment.fine, Fabric.even(garment.fine, 0.1, 100, 1e-5))
    e = biot_strain(x, E.faces, E.gradients, 1.0)
    for f in (0, 7, 31):
        F = np.einsum("ia,id->da", E.gradients[f], x[E.faces[f]])
        _, s, Vt = np.linalg.svd(F, full_matrices=False)
        U = Vt.T @ np.diag(s) @ Vt
        assert e[f] == pytest.approx([U[0, 0] - 1, U[1, 1] - 1, 2 * U[0, 1]], abs=1e-12)


@pytest.mark.parametrize("stiffening", [0.0, 500.0])
def test_membrane_force_is_the_slope_of_the_energy_and_its_matrix_the_slope_of_the_force(stiffening):
    garment = panel(20)
    E = Elements(garment.fine, Fabric.even(garment.fine, 0.1, 100, 1e-5).with_(orthotropy=0.3))
    stepper = Stepper(world(garment, Fabric.even(garment.fine, 0.1, 100, 1e-5)))
    x = noisy(garment, 2e-3)

    def force(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        f, data = np.zeros_like(x), np.zeros(stepper.matrix.entries)
        z = np.zeros(len(E.faces))
        s0 = np.zeros((len(E.faces), 2))
        e0 = np.zeros((len(E.faces), 3))
        membrane(x, E.faces, E.gradients, E.area, 1.0, E.D, stiffening, 0.0, e0, 1.0, z, s0, f, stepper.matrix.slots[0], data, False)
        return f, data

    def energy(x: np.ndarray) -> float:
        e = biot_strain(x, E.faces, E.gradients, 1.0)
        q = np.einsum("fa,fab,fb->f", e, E.D, e) / 100
        return float(np.sum(E.area * 100 * q * (1 + stiffening * q / 2)) / 2)

    free = stepper.matrix.free
    step = np.zeros_like(x)
    step[free] = np.random.default_rng(2).normal(size=(len(free), 3))
    h = 1e-6
    assert -np.sum(force(x)[0] * step) == pytest.approx((energy(x + h * step) - energy(x - h * step)) / (2 * h), rel=1e-5)
    slope = (force(x + h * step)[0] - force(x - h * step)[0])[free].ravel() / (2 * h)
    product = _times(stepper.matrix._indptr, stepper.matrix._indices, force(x)[1], step[free].ravel())
    assert np.linalg.norm(product + slope) < 1e-5 * np.linalg.norm(slope)


def test_hinge_force_is_the_slope_of_the_energy():
    garment = panel(20)
    E = Elements(garment.fine, Fabric.even(garment.fine, 0.1, 100, 1e-5))
    x, H = noisy(garment, 4e-3), len(E.hinges)
    f = np.zeros_like(x)
    slots = np.full((H, 12, 12), -1, np.int32)
    bend(x, E.hinges, E.rigidity, E.rest_fold, 0.0, np.zeros(H), 1.0, np.zeros(H), np.ones(H), np.zeros((H, 2)), f, slots, np.zeros(1))
    step, h = np.random.default_rng(2).normal(size=x.shape), 1e-6

    def energy(x: np.ndarray) -> float:
        return float(E.rigidity @ (hinge_angles(x, E.hinges) - E.rest_fold) ** 2) / 2

    assert -np.sum(f * step) == pytest.approx((energy(x + h * step) - energy(x - h * step)) / (2 * h), rel=1e-5)


def test_a_rolled_up_sheet_has_the_bending_energy_of_a_cylinder():
    garment = panel(400, 0.4, 0.5)
    rest, stencil = garment.fine.rest, hinge_stencils(garment.fine.faces)
    weights, R = hinge_weights(rest, garment.fine.faces, stencil), 0.5
    shares = []
    for angle in np.linspace(0, np.pi, 9)[:-1]:
        u = rest[:, 0] * np.cos(angle) + rest[:, 1] * np.sin(angle)
        v = rest[:, 1] * np.cos(angle) - rest[:, 0] * np.sin(angle)
        rolled = np.stack([R * np.sin(u / R), v, R * np.cos(u / R)], -1)
        shares.append(weights @ hinge_angles(rolled, stencil) ** 2 / (face_areas(rest, garment.fine.faces).sum() / R**2))
    assert np.mean(shares) == pytest.approx(1.0, abs=0.03)
    assert np.std(shares) < 0.05


def test_a_hanging_sheet_stretches_by_its_weight():
    garment = panel(80)
    stretch, density = 60.0, 0.2
    stepper = Stepper(world(garment, Fabric.even(garment.fine, density, stretch, 1e-6)))
    sag = (garment.fine.rest - stepper.rest(garment.fine.rest).x)[:, 1]
    hem = garment.fine.t > 0.999
    assert sag[hem].mean() == pytest.approx(density * G * 0.4**2 / (2 * stretch), rel=0.02)


def test_a_stiff_panel_swings_like_a_physical_pendulum():
    """A rigid plate on a hinge along its top: ω² = 3g/2L for small swings; two crossings of the middle are half a period apart."""
    garment = panel(40, 0.15, 0.3)
    stepper = Stepper(world(garment, Fabric.even(garment.fine, 0.2, 2000.0, 3e-2)))
    rest, hem = garment.fine.rest, garment.fine.t > 0.999
    start = stepper.rest(rest)
    start.x = np.stack([rest[:, 0], rest[:, 1] * np.cos(0.1), rest[:, 1] * np.sin(0.1)], -1)
    start.memory = stepper.elements.memory(start.x)
    times = np.arange(46) / 30
    z = np.array([s.x[hem, 2].mean() for s in stepper.frames(start, times, 2)])
    k = np.flatnonzero(z[:-1] * z[1:] < 0)
    crossings = times[k] - z[k] * (times[k + 1] - times[k]) / (z[k + 1] - z[k])
    assert np.diff(crossings) == pytest.approx(np.pi / np.sqrt(1.5 * G / 0.3), rel=0.01)
    assert np.abs(z).max() < 0.0301 and np.abs(z[-12:]).max() > 0.0295


def test_damped_swing_loses_what_mass_damping_takes():
    garment = panel(40, 0.15, 0.3)
    plain = world(garment, Fabric.even(garment.fine, 0.2, 2000.0, 3e-2))
    α = 1.5
    damped = replace(plain, forces=CAUSES["fabric_mass_damping"].apply(Conditions(garment.fine, plain.fabric), α).forces)
    rest = garment.fine.rest
    x = np.stack([rest[:, 0], rest[:, 1] * np.cos(0.1), rest[:, 1] * np.sin(0.1)], -1)
    hem, swings = garment.fine.t > 0.999, []
    ω = np.sqrt(1.5 * G / 0.3 - α**2 / 4)
    for w in (plain, damped):
        stepper = Stepper(w)
        start = stepper.rest(rest)
        start.x, start.memory = x, stepper.elements.memory(x)
        swings.append(list(stepper.frames(start, [0.0, 2 * np.pi / ω], 60))[-1].x[hem, 2].mean() / x[hem, 2].mean())
    assert swings[1] / swings[0] == pytest.approx(np.exp(-α / 2 * 2 * np.pi / ω), rel=0.03)


@pytest.mark.parametrize(("slope", "slides"), [(0.1, False), (0.3, True)])
def test_a_patch_slides_on_a_sphere_only_where_it_is_steeper_than_friction(slope, slides):
    """On a sphere of 5 m it accelerates by g (sin − μ cos); where tan(slope) < μ it stays."""
    garment = tailor(Cut("curtain", Pattern(0.04, 0.04), "plane", "top"), 12, 2.0, np.random.default_rng(0))
    fine = replace(garment.fine, pinned=np.zeros(0, np.int32))
    μ, R = 0.2, 5.0
    body = Body(np.zeros((1, 3)), np.zeros((1, 3)), np.array([R]), np.zeros(1, np.int32))
    top, along = np.array([np.sin(slope), np.cos(slope), 0]), np.array([np.cos(slope), -np.sin(slope), 0])
    x = (R + 1e-3) * top + fine.rest[:, :1] * along + (fine.rest[:, 1:2] + 0.02) * np.array([0, 0, 1.0])
    stepper = Stepper(World(fine, Fabric.even(fine, 0.2, 300, 1e-4), body, still, lambda t: np.zeros((0, 3)), friction=μ))
    start = stepper.rest(x, seconds=0.3, damping=200.0)
    v = [(s.v @ along).mean() for s in stepper.frames(start, [0.0, 0.05, 0.1], 40)]
    assert (v[2] - v[1]) / 0.05 == pytest.approx(G * (np.sin(slope) - μ * np.cos(slope)), rel=0.03) if slides else abs(v[2]) < 2e-3


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("air_normal_drag", lambda v, n, ρ, θ: -0.6 * θ * ρ * np.abs(v @ n) * (v @ n) * n),
        ("air_linear_drag", lambda v, n, ρ, θ: -θ * ρ * (v @ n) * n),
        ("air_tangential_drag", lambda v, n, ρ, θ: -0.6 * θ * ρ * np.linalg.norm(v - (v @ n) * n) * (v - (v @ n) * n)),
        ("fabric_mass_damping", lambda v, n, ρ, θ: -θ * ρ * v),
        ("air_lift", lambda v, n, ρ, θ: -0.6 * θ * ρ * (v @ n) * (np.linalg.norm(v) * n - (v @ n) * v / np.linalg.norm(v))),
    ],
)
def test_air_on_a_flat_sheet_in_uniform_motion(name, expected):
    garment = panel()
    ρ, θ, v = 0.2, 2.0, np.array([0.3, 0.5, -0.7])
    stepper = Stepper(world(garment, Fabric.even(garment.fine, ρ, 100, 1e-5)))
    force = CAUSES[name].apply(Conditions(garment.fine, stepper.world.fabric), θ).forces[0]
    E, x = stepper.elements, garment.fine.rest
    n = vertex_normals(x, E.faces)
    m = Moment(x, np.tile(v, (len(x), 1)), 0 * x, 0.0, 0.01, n, E.node_area, E.mass, NOTHING.placed(still, 0.0))
    assert force(m)[0].sum(0) / E.area.sum() == pytest.approx(expected(v, n[0], ρ, θ), rel=1e-9)


def test_tracked_points_lie_on_the_smooth_surface():
    """A sheet rolled up, tracked on the coarse mesh: flat triangles lie inside the roll by their sagitta, the points of a tracker do not."""
    garment, R = panel(280, 0.4, 0.5), 0.2

    def rolled(x):
        return np.stack([R * np.sin(x[:, 0] / R), x[:, 1], R * np.cos(x[:, 0] / R)], 1)

    fine, true = rolled(garment.fine.rest), rolled(garment.coarse.rest)
    flat, smooth = (np.linalg.norm(y - true, axis=1) for y in (garment.resampled(fine), garment.tracked(fine)))
    assert np.median(flat) > 5e-5
    assert np.median(smooth) < 0.1 * np.median(flat)
    assert smooth.max() < flat.max()
