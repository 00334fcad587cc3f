"""Every hand-derived term against its slow twin: the energy as the paper writes it, differentiated automatically."""

import numpy as np
import pytest
import torch
from scipy.sparse import csc_matrix

from tasks.simulator import Blocks, Cloth, Fabric, Settings, Step, StepTangent
from tasks.simulator.cloth import Collider
from tasks.simulator.contact_barrier import ContactBarrier, cipc_stiffness
from tasks.simulator.contact_friction import ContactFriction
from tasks.simulator.contact_surface import ContactSurface
from tasks.simulator.fabric import THICKNESS, YOUNG
from tasks.simulator.gravity import Gravity
from tasks.simulator.hinge_bending import HingeBending
from tasks.simulator.inertia import Inertia
from tasks.simulator.membrane_neohookean import MembraneNeoHookean
from tasks.simulator.membrane_stvk import MembraneStVK
from tasks.simulator.potential import sparse_times
from tests.simulator.scenes import sheet

FABRIC = Fabric(density=300, membrane=1.3, bending=40, rest_scale=0.97, orthotropy=0.4)
ISOTROPIC = Fabric(density=300, membrane=1.3, bending=40, rest_scale=0.97)


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(1)
    x_rest, faces = sheet(3, 3, length=0.2, width=0.2)
    x_rest = x_rest + 0.01 * rng.normal(size=x_rest.shape)
    x = x_rest + 0.03 * rng.normal(size=x_rest.shape)
    cloth = Cloth(x_rest, faces)
    none = np.zeros((0, 3))
    step = Step(0.02, 0.013, x_rest, 0.1 * x, x_rest + 0.001 * rng.normal(size=x.shape), 0.2 * x, none, none, none)
    return cloth, x, step


def twin_strain(x, cloth, scale):
    """Green strain [F, 2, 2] in rest axes that begin along edge 0→1, and rest areas."""
    X = torch.tensor(cloth.x_rest)[cloth.faces.astype(np.int64)] * scale
    a, b = X[:, 1] - X[:, 0], X[:, 2] - X[:, 0]
    u = a / a.norm(dim=1, keepdim=True)
    n = torch.linalg.cross(a, b)
    v = torch.linalg.cross(n / n.norm(dim=1, keepdim=True), u)
    D = torch.stack([torch.stack([(a * u).sum(1), (b * u).sum(1)], 1), torch.stack([(a * v).sum(1), (b * v).sum(1)], 1)], 1)
    y = x[cloth.faces.astype(np.int64)]
    F = torch.stack([y[:, 1] - y[:, 0], y[:, 2] - y[:, 0]], 2) @ torch.linalg.inv(D)
    return 0.5 * (F.transpose(1, 2) @ F - torch.eye(2, dtype=x.dtype)), n.norm(dim=1) / 2


def twin_stvk(x, cloth, θ):
    E, area = twin_strain(x, cloth, torch.exp(θ["log_rest_scale"]))
    ν, a, Et = FABRIC.poisson, θ["orthotropy"], YOUNG * THICKNESS * torch.exp(θ["log_membrane"])
    E11, E22, E12 = E[:, 0, 0], E[:, 1, 1], E[:, 0, 1]
    ψ = torch.exp(a) * E11**2 + torch.exp(-a) * E22**2 + 2 * ν * E11 * E22 + 2 * (1 - ν) * E12**2
    return (area * Et / (1 - ν**2) * ψ / 2).sum()


def twin_neohookean(x, cloth, θ):
    E, area = twin_strain(x, cloth, torch.exp(θ["log_rest_scale"]))
    C = 2 * E + torch.eye(2, dtype=x.dtype)
    ν, Et = FABRIC.poisson, YOUNG * THICKNESS * torch.exp(θ["log_membrane"])
    μ, λ, lnJ = Et / (2 * (1 + ν)), Et * ν / (1 - ν**2), torch.logdet(C) / 2
    return (area * (μ / 2 * (C[:, 0, 0] + C[:, 1, 1] - 2 - 2 * lnJ) + λ / 2 * lnJ**2)).sum()


def twin_angle(x, h):
    a, b, c, d = (x[h[:, k].astype(np.int64)] for k in range(4))
    unit = torch.nn.functional.normalize
    n1, n2 = unit(torch.linalg.cross(b - a, c - a), dim=1), unit(torch.linalg.cross(a - b, d - b), dim=1)
    return torch.atan2((torch.linalg.cross(n1, n2) * unit(b - a, dim=1)).sum(1), (n1 * n2).sum(1))


def twin_bending(x, cloth, θ):
    h, X = cloth.hinges, torch.tensor(cloth.x_rest)
    a, b, c, d = (X[h[:, k].astype(np.int64)] for k in range(4))
    A1, A2 = (torch.linalg.cross(b - a, o - a).norm(dim=1) / 2 for o in (c, d))
    e = (b - a).norm(dim=1)
    h_bar = (A1 + A2) / (3 * e)
    k = YOUNG * THICKNESS**3 / (24 * (1 - FABRIC.poisson**2)) * torch.exp(θ["log_bending"])
    return (k * (twin_angle(x, h) - twin_angle(X, h)) ** 2 * e / h_bar).sum()


def twin_gravity(x, cloth, θ):
    m = torch.tensor(THICKNESS * cloth.vertex_areas) * torch.exp(θ["log_density"])
    return 9.81 * (m * x[:, 1]).sum()


VALUES = {
    "log_membrane": np.log(FABRIC.membrane),
    "log_bending": np.log(FABRIC.bending),
    "log_rest_scale": np.log(FABRIC.rest_scale),
    "orthotropy": FABRIC.orthotropy,
    "log_density": np.log(FABRIC.density),
}
TERMS = {
    "stvk": (lambda cloth: MembraneStVK.of(cloth, FABRIC), twin_stvk),
    "neo_hookean": (lambda cloth: MembraneNeoHookean.of(cloth, ISOTROPIC), twin_neohookean),
    "bending": (lambda cloth: HingeBending.of(cloth, FABRIC), twin_bending),
    "gravity": (lambda cloth: Gravity(FABRIC.areal_density * cloth.vertex_areas), twin_gravity),
}


def dense(H: Blocks, size: int) -> np.ndarray:
    return H.times(np.eye(size).reshape(size, -1, 3)).reshape(size, size)


@pytest.mark.parametrize("name", TERMS)
def test_energy_gradient_and_hessian(name, scene):
    cloth, x, step = scene
    make, twin = TERMS[name]
    term, θ = make(cloth), {k: torch.tensor(v, dtype=torch.float64) for k, v in VALUES.items()}
    y = torch.tensor(x)
    assert term.energy(x, step) == pytest.approx(float(twin(y, cloth, θ)), rel=1e-12)
    g = torch.func.grad(twin)(y, cloth, θ).numpy()
    np.testing.assert_allclose(term.gradient(x, step), g, rtol=0, atol=1e-10 * np.abs(g).max())
    H = torch.func.hessian(twin)(y, cloth, θ).numpy().reshape(x.size, x.size)
    np.testing.assert_allclose(dense(term.hessian(x, step, convex=False), x.size), H, rtol=0, atol=1e-10 * max(np.abs(H).max(), 1e-30))


@pytest.mark.parametrize(("name", "parameter"), [(n, p) for n, (make, _) in TERMS.items() for p in make(Cloth(*sheet(3, 3))).parameters])
def test_parameter_gradients(name, parameter, scene):
    cloth, x, step = scene
    make, twin = TERMS[name]
    θ = {k: torch.tensor(v, dtype=torch.float64) for k, v in VALUES.items()}

    def gradient(value):
        return torch.func.grad(twin)(torch.tensor(x), cloth, {**θ, parameter: value})

    expected = torch.func.jacfwd(gradient)(θ[parameter]).numpy()
    np.testing.assert_allclose(make(cloth).parameter_gradient(parameter, x, step), expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("name", TERMS)
def test_convex_neighbour_has_no_negative_curvature(name, scene):
    cloth, x, step = scene
    term = TERMS[name][0](cloth)
    values = np.linalg.eigvalsh(dense(term.hessian(x, step, convex=True), x.size))
    assert values.min() >= -1e-9 * max(values.max(), 1e-30)
    if name != "gravity":
        assert np.linalg.eigvalsh(dense(term.hessian(x, step, convex=False), x.size)).min() < -1e-6 * values.max()  # and was needed


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_inertia(mass, scene):
    cloth, x, step = scene
    term = Inertia.of(cloth, FABRIC.areal_density, mass=mass)
    M = term.times(np.eye(x.size).reshape(x.size, -1, 3)).reshape(x.size, x.size)
    total = FABRIC.areal_density * cloth.rest_areas.sum()
    assert M[::3, ::3].sum() == pytest.approx(total) and (np.count_nonzero(M) == x.size) == (mass == "lumped")
    d = (x - step.x_hat - step.s * step.v_hat).ravel()
    assert term.energy(x, step) == pytest.approx(d @ M @ d / 2 / step.s**2)
    np.testing.assert_allclose(term.gradient(x, step).ravel(), M @ d / step.s**2, atol=1e-12)
    np.testing.assert_allclose(dense(term.hessian(x, step, convex=False), x.size), M / step.s**2, atol=1e-12)


def test_the_materials_agree_for_small_strain():
    cloth = Cloth(*sheet(3, 3))
    x = cloth.x_rest + 1e-5 * np.random.default_rng(0).normal(size=cloth.x_rest.shape)
    a, b = MembraneStVK.of(cloth, Fabric()), MembraneNeoHookean.of(cloth, Fabric())
    assert a.energy(x, None) == pytest.approx(b.energy(x, None), rel=1e-3)


# --- contact: one vertex above one triangle, the formulas written out


def pair(offset: float = 0.0, height: float = 0.4e-3):
    """A small triangle whose first corner hangs over the middle of a large one."""
    cloth = Cloth(np.array([[0.05, 0.5, 0.05], [0.06, 0.6, 0.05], [0.05, 0.6, 0.06]]), np.array([[0, 1, 2]]))
    below = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0, 0.3]])
    surface = ContactSurface(cloth, Collider(np.array([[0, 2, 1]])), below, barrier_distance=1e-3, offset=offset)
    x = cloth.x_rest - np.array([0, 0.5 - height, 0])
    still = np.zeros_like(x)
    step = Step(0.01, 0.01, x, still, x, still, below, below, below)
    return surface, x, step


def test_barrier_value_and_force():
    surface, x, step = pair()
    κ, D, d, area = 7.0, 1e-6, 0.4e-3, surface.contact_areas[0] / 4
    barrier = ContactBarrier(surface, κ)
    assert barrier.energy(x, step) == pytest.approx(-κ * area * (d**2 - D) ** 2 * np.log(d**2 / D), rel=1e-9)
    slope = -κ * area * 2 * d * (2 * (d**2 - D) * np.log(d**2 / D) + (d**2 - D) ** 2 / d**2)
    np.testing.assert_allclose(barrier.gradient(x, step)[0], [0, slope, 0], rtol=1e-9, atol=1e-12 * abs(slope))
    assert slope < 0 and not barrier.gradient(x + np.array([0, 2e-3, 0]), step).any()  # repels; nothing beyond d̂


def test_offset_moves_the_barrier_out():
    near, far = pair(), pair(offset=2e-3, height=2.4e-3)
    energies = [ContactBarrier(s, 1.0).energy(x, step) for s, x, step in (near, far)]
    assert energies[0] > 0 and energies[1] > 0
    assert ContactBarrier(near[0], 1.0).energy(far[1], near[2]) == 0


def test_friction_opposes_slip_with_mu_times_the_normal_force():
    surface, x, step = pair()
    barrier = ContactBarrier(surface, 1e9)
    normal = np.linalg.norm(barrier.gradient(x, step))
    friction = ContactFriction(barrier, collider=0.3, cloth=0.1, velocity=1e-3)
    slid = friction.gradient(x + np.array([1e-3, 0, 0]), step)  # 0.1 m/s
    np.testing.assert_allclose(slid[0], [0.3 * normal, 0, 0], rtol=1e-9, atol=1e-12)
    assert friction.energy(x, step) == pytest.approx(0.3 * normal * 1e-3 * 0.01 / 3)  # f₀(0) = ε/3
    carried = Step(**{**step.__dict__, "collider": step.collider + np.array([1e-3, 0, 0])})
    np.testing.assert_allclose(
        ContactFriction(barrier, collider=0.3, cloth=0.1, velocity=1e-3).gradient(x + np.array([1e-3, 0, 0]), carried), 0, atol=1e-12
    )


def test_friction_through_the_lag():
    surface, x, step = pair()
    rng = np.random.default_rng(4)
    barrier = ContactBarrier(surface, 1e9)
    y = x + 3e-6 * rng.normal(size=x.shape)
    dx, dhat = rng.normal(size=(2, *x.shape))

    def gradient(e):
        moved = Step(**{**step.__dict__, "x_n": step.x_n + e * dx, "x_hat": step.x_hat + e * dhat})
        return ContactFriction(barrier, collider=0.3, cloth=0.1, velocity=1e-3).gradient(y, moved)

    none = np.zeros((1, 3, 3))
    tangent = ContactFriction(barrier, collider=0.3, cloth=0.1, velocity=1e-3).history_gradient(
        y, step, StepTangent(dx[None], none, dhat[None], none, none, none, none)
    )[0]
    difference = (gradient(1e-9) - gradient(-1e-9)) / 2e-9
    np.testing.assert_allclose(tangent, difference, atol=1e-5 * np.abs(difference).max())


def test_cipc_stiffness_is_that_of_the_recorded_run():
    """sphere_1600 of the reference data: 337.51 for a mean nodal mass of 0.1050 kg of cloth and the sphere's skin over 4162 nodes."""
    cloth, skin = 0.10496 * 1.0, 0.10496 * 0.7834
    assert cipc_stiffness((cloth + skin) / 4162, 1e-3) == pytest.approx(337.51, rel=2e-3)


def test_settings_default_to_the_base_model():
    s = Settings()
    assert (s.membrane, s.bending, s.barrier, s.integrator) == ("stvk", "independent", "per_area", "bdf2")


def test_sparse_times_is_the_dense_product():
    rng = np.random.default_rng(0)
    H = np.zeros((18, 30))
    H[np.ix_([3, 4, 7, 17], [1, 3, 8, 29])] = rng.normal(size=(4, 4))
    dx = rng.normal(size=(5, 10, 3))
    np.testing.assert_allclose(sparse_times(csc_matrix(H), dx), (dx.reshape(5, -1) @ H.T).reshape(5, 6, 3), atol=1e-12)
    assert sparse_times(csc_matrix(H), dx[:0]).shape == (0, 6, 3)
    assert not sparse_times(csc_matrix((18, 30)), dx).any()
