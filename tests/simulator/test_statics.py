"""Equilibria with closed forms: uniaxial tension, the heavy elastica, the catenary."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from tasks.simulator import Blocks, Cloth, Fabric, Potential, Settings
from tasks.simulator.hinge_bending import HingeBending
from tests.simulator.scenes import free, run, sheet, still

WEIGHTLESS = Settings(integrator="backward_euler", substeps=1, gravity=(0, 0, 0), acceleration_tolerance=1e-6)
SLOW = 1.0  # frames per second: steps so long that inertia is no more than a regulariser


class Pull(Potential):
    """A constant force f [V, 3] N on the nodes: P = −f·x. As an author of an effect would write it."""

    def __init__(self, force):
        self.force = force

    def energy(self, x, step):
        return -float(np.sum(self.force * x))

    def gradient(self, x, step):
        return -self.force

    def hessian(self, x, step, *, convex):
        return Blocks(np.empty((0, 1), np.int32), np.empty((0, 3, 3)))


@pytest.mark.parametrize(("orthotropy", "along"), [(0.0, 0), (0.5, 0), (0.5, 1)])
def test_uniaxial_tension(orthotropy, along):
    """StVK: T = λ₁ Eᵤt (λ₁² − 1)/2 per width, and E₂₂ = −ν_uv E₁₁ with ν_uv = ν e^±a."""
    x, faces = sheet(5, 5, length=0.2, width=0.2)
    uv = x[faces][:, :, [0, 2]] if along == 0 else x[faces][:, :, [2, 0]]
    cloth, fabric = Cloth(x, faces, uv=uv), Fabric(membrane=2.0, orthotropy=orthotropy, poisson=0.2)
    share = np.full(5, 0.25)
    share[[0, -1]] = 0.125
    T = 12.0  # N/m
    force = np.zeros_like(x)
    force[20:, 0], force[:5, 0] = T * 0.2 * share, -T * 0.2 * share
    end = run(cloth, fabric, free(12), fps=SLOW, settings=WEIGHTLESS, potentials=(Pull(force),))[-1].x
    λ1, λ2 = (np.ptp(end[:, k]) / 0.2 for k in (0, 2))
    a = orthotropy if along == 0 else -orthotropy
    modulus = fabric.stretch_stiffness * np.exp(a)
    expected = brentq(lambda λ: modulus * λ * (λ**2 - 1) / 2 - T, 1, 2)
    assert λ1 == pytest.approx(expected, rel=1e-6) and λ1 > 1.1
    assert (λ2**2 - 1) / (λ1**2 - 1) == pytest.approx(-0.2 * np.exp(a), rel=1e-6)


def equilateral(rows, columns, edge):
    """Strip of equilateral triangles, one family of edges across it."""
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    x = np.stack([i * edge * np.sqrt(3) / 2, 0 * i, (j + 0.5 * (i % 2)) * edge], -1).reshape(-1, 3)
    faces, at = [], lambda r, c: r * columns + c
    for r in range(rows - 1):
        for c in range(columns - 1):
            p, q, s, t = at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)
            faces += [[p, q, s], [q, t, s]] if r % 2 == 0 else [[p, t, s], [p, q, t]]
    return x, np.array(faces, np.int32)


def rigidity(cloth, fabric):
    """½ B κ² per area of the sheet rolled to a cylinder of small curvature."""
    κ, x = 0.5, cloth.x_rest
    rolled = np.stack([np.sin(κ * x[:, 0]) / κ, (1 - np.cos(κ * x[:, 0])) / κ, x[:, 2]], 1)
    return 2 * HingeBending.of(cloth, fabric).energy(rolled, None) / κ**2 / cloth.rest_areas.sum()


def test_rigidity_of_a_regular_sheet_is_six_hinge_constants():
    """Curvature κ across one family of edges opens those hinges by κH and no others: 3k κ² per area, so B = 6k.

    Three times the plate's 2k.
    """
    fabric = Fabric(bending=50)
    assert rigidity(Cloth(*equilateral(80, 20, 0.01)), fabric) == pytest.approx(6 * fabric.hinge_constant, rel=0.02)
    assert Fabric.from_si(areal_density=0.1, stretch=20, bending_rigidity=1e-5).hinge_constant == pytest.approx(1e-5 / 6)


def test_heavy_elastica():
    """Tip of a strip clamped level under its weight: B θ'' = −ρ̄ g (L − s) cos θ, θ(0) = 0, θ'(L) = 0."""
    cloth_x, faces = equilateral(31, 5, 0.008)
    clamped = np.arange(10)  # two rows fix place and slope
    cloth, fabric = Cloth(cloth_x, faces, clamped), Fabric(density=300, membrane=200, bending=1500)
    settings = Settings(integrator="backward_euler", substeps=1, acceleration_tolerance=1e-5)
    end = run(cloth, fabric, still(25, cloth), fps=4, settings=settings)[-1].x
    s0 = cloth_x[5, 0] / 2  # the hinges of the second row stand for half an interval on either side
    L, B, w = cloth_x[:, 0].max() - s0, rigidity(cloth, fabric), fabric.areal_density * 9.81
    tip = end[-5:].mean(0)
    plate, beam = elastica(L, B, w), elastica(L, 8 / 9 * B, w)  # a strip is between: its width may curl (1 − ν², ν = −1/3 for this mesh)
    assert 0.3 * L < beam[0] < 0.8 * L and beam[0] < 1.05 * plate[0]  # far from small deflections, and a narrow bracket
    assert plate[0] < -tip[1] < beam[0] and beam[1] < tip[0] - s0 < plate[1]


def elastica(L, B, w):
    """Droop and reach [m] of the tip."""
    s = np.linspace(0, L, 50)
    beam = solve_bvp(lambda s, y: [y[1], -w / B * (L - s) * np.cos(y[0])], lambda a, b: [a[0], b[1]], s, np.zeros((2, 50)))
    θ = beam.sol(s)[0]
    return np.trapezoid(np.sin(θ), s), np.trapezoid(np.cos(θ), s)


def test_catenary():
    """Sag of an almost inextensible, almost limp strip of length L between supports d apart: y = a cosh(x/a), L = 2a sinh(d/2a)."""
    x, faces = sheet(31, 2, length=0.6, width=0.02)
    cloth = Cloth(x, faces, np.array([0, 1, 60, 61]))
    motions = still(24, cloth)
    close = np.linspace(0, 1, 8).tolist() + [1] * 16
    motions["boundary_motion"][:, :2, 0] += 0.1 * np.array(close)[:, None]
    motions["boundary_motion"][:, 2:, 0] -= 0.1 * np.array(close)[:, None]
    fabric, settings = Fabric(membrane=500, bending=0.01), Settings(integrator="backward_euler", substeps=1, acceleration_tolerance=1e-4)
    x0 = x - np.array([0, 0.01, 0]) * np.sin(np.pi * x[:, :1] / 0.6)
    end = run(cloth, fabric, motions, fps=4, settings=settings, x0=x0)[-1].x
    a = brentq(lambda a: 2 * a * np.sinh(0.2 / a) - 0.6, 0.05, 10)
    assert -end[:, 1].min() == pytest.approx(a * (np.cosh(0.2 / a) - 1), rel=0.01)


def test_order_in_mesh_size():
    """Sag of a sheet held along its rim, against the mesh: second order, as linear triangles are."""
    fabric, settings = Fabric(membrane=50, bending=0.01), Settings(integrator="backward_euler", substeps=1, acceleration_tolerance=1e-5)
    sag = []
    for n in (5, 9, 17):
        x, faces = sheet(n, n, length=0.5, width=0.5)
        rim = np.flatnonzero((x[:, [0, 2]] % 0.5 < 1e-9).any(1))
        cloth = Cloth(x, faces, rim)
        sag.append(-run(cloth, fabric, still(8, cloth), fps=SLOW, settings=settings)[-1].x[n * n // 2, 1])
    assert sag[2] > 0.005 and np.log2(abs((sag[0] - sag[1]) / (sag[1] - sag[2]))) == pytest.approx(2, abs=0.5)
