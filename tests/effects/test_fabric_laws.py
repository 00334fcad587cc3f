"""Damping and mass of the fabric against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.effects.fabric_bending_damping import EFFECT as BENDING
from tasks.effects.fabric_density_gradient import EFFECT as GRADIENT
from tasks.effects.fabric_hem_mass import EFFECT as HEM
from tasks.effects.fabric_mass_damping import EFFECT as MASS
from tasks.effects.fabric_membrane_damping import EFFECT as MEMBRANE
from tasks.simulator.hinge_bending import HingeBending
from tasks.simulator.membrane_stvk import MembraneStVK
from tests.effects.scenes import FABRIC, LENGTH, SIDE, panel, subject
from tests.effects.test_air_laws import FINE, standing
from tests.simulator.scenes import free, run

NONE = np.zeros((0, 3), np.int32)


def turned(x: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T


@pytest.mark.parametrize("effect", [MEMBRANE, BENDING], ids=lambda e: e.name)
def test_strain_rates_do_not_see_a_turn(effect):
    rng = np.random.default_rng(0)
    cloth = panel()
    bent = cloth.x_rest + 0.01 * rng.normal(size=cloth.x_rest.shape)
    step, _ = standing(bent, 0 * bent)
    term = effect.potentials(subject(cloth, NONE), effect.typical)[0]
    assert np.abs(term.gradient(turned(bent, 0.7), step)).max() < 1e-10
    assert np.abs(term.gradient(1.01 * bent + 0.01 * rng.normal(size=bent.shape), step)).max() > 1e-4


@pytest.mark.parametrize(("effect", "elasticity"), [(MEMBRANE, MembraneStVK), (BENDING, HingeBending)], ids=["membrane", "bending"])
def test_slow_deformation_is_braked_by_beta_times_the_stiffness(effect, elasticity):
    """Rayleigh's damping: about rest, the force is β K v with the stiffness K of the base model."""
    cloth = panel()
    v = 1e-3 * np.random.default_rng(1).normal(size=cloth.x_rest.shape)
    step, x = standing(cloth.x_rest, v)
    Kv = elasticity.of(cloth, FABRIC).hessian(cloth.x_rest, step, convex=False).times(v[None])[0]
    braking = effect.potentials(subject(cloth, NONE), [5e-3])[0].gradient(x, step)
    np.testing.assert_allclose(braking, 5e-3 * Kv, atol=1e-3 * np.abs(5e-3 * Kv).max())


def test_mass_damping_is_an_exponential():
    cloth = panel(boundary=False)
    settings = replace(FINE, gravity=(0, 0, 0))
    v0 = np.tile([0.3, -0.2, 0.5], (SIDE**2, 1))
    terms = MASS.potentials(subject(cloth, NONE), [2.0])
    frames = run(cloth, FABRIC, free(11), fps=30, settings=settings, potentials=terms, v0=v0)
    for i, frame in enumerate(frames):
        np.testing.assert_allclose(frame.v, v0 * np.exp(-2 * i / 30), atol=1e-3)


def test_hem_mass_is_a_width_of_cloth_along_free_borders():
    """Three sides of the panel: the top is pinned; its corners carry half an edge of the sides."""
    term = HEM.potentials(subject(panel(), NONE), [0.04])[0]
    mass = 0.04 * term.mass.reshape(SIDE, SIDE)
    assert mass.sum() == pytest.approx(0.04 * 0.15 * 3 * LENGTH)
    edge = LENGTH / (SIDE - 1) * 0.04 * 0.15
    assert (
        mass[-1, 2] == pytest.approx(edge)
        and mass[0, 0] == pytest.approx(edge / 2)
        and not mass[1:-1, 1:-1].any()
        and not mass[0, 1:-1].any()
    )


def test_the_density_gradient_moves_mass_up_and_adds_none():
    """The same for the height of the pattern and, without one, of the rest mesh."""
    for cloth in (panel(), replace(panel(), uv=None)):
        mass = GRADIENT.potentials(subject(cloth, NONE), [0.3])[0].mass
        assert mass.sum() == pytest.approx(0, abs=1e-15)
        ratio = (mass / (0.15 * cloth.vertex_areas)).reshape(SIDE, SIDE)
        np.testing.assert_allclose(ratio[:, 0], np.linspace(0.5, -0.5, SIDE), atol=1e-12)


def test_further_mass_weighs_as_much_as_it_is_inert():
    """Heavier cloth falls as fast."""
    cloth = panel(boundary=False)
    terms = (*HEM.potentials(subject(cloth, NONE), [0.1]), *GRADIENT.potentials(subject(cloth, NONE), [0.5]))
    frames = run(cloth, FABRIC, free(6), fps=30, settings=FINE, potentials=terms)
    np.testing.assert_allclose(frames[-1].v, np.tile([0, -9.81 * 5 / 30, 0], (SIDE**2, 1)), atol=1e-4)
