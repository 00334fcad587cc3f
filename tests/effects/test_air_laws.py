"""The air against closed forms, on flat sheets that fall, fly or stand in the wind."""

import numpy as np
import pytest

from tasks.effects.air_added_mass import EFFECT as ADDED_MASS
from tasks.effects.air_lift import EFFECT as LIFT
from tasks.effects.air_linear_drag import EFFECT as LINEAR
from tasks.effects.air_normal_drag import EFFECT as NORMAL
from tasks.effects.air_tangential_drag import EFFECT as TANGENTIAL
from tasks.effects.air_wind import DRAG_AREA, FLUCTUATION
from tasks.effects.air_wind import EFFECT as WIND
from tasks.effects.faces_in_air import AIR_DENSITY, FacesInAir
from tasks.simulator import Cloth, Settings, Step, simulate
from tests.effects.scenes import FABRIC, LENGTH, subject
from tests.simulator.scenes import free, sheet

G = 9.81
FINE = Settings(substeps=8, acceleration_tolerance=1e-6)


def flat(upright: bool = False) -> Cloth:
    """A horizontal sheet, or one that stands in the plane x = 0."""
    x, faces = sheet(4, 4, length=LENGTH, width=LENGTH)
    return Cloth(x[:, [1, 0, 2]] if upright else x, faces)


def fall(effect, θ, cloth: Cloth, v0=(0.0, 0.0, 0.0), frames: int = 16) -> np.ndarray:
    """Mean velocity [T, 3] of a free sheet at 30 frames per second."""
    terms = effect.potentials(subject(cloth, np.zeros((0, 3), np.int32)), θ)
    v = np.tile(np.array(v0), (len(cloth.x_rest), 1))
    return np.stack([f.v.mean(0) for f in simulate(cloth, FABRIC, fps=30, settings=FINE, potentials=terms, v0=v, **free(frames))])


def standing(x: np.ndarray, v: np.ndarray) -> tuple[Step, np.ndarray]:
    """A step of backward Euler along which cloth at x moves at v."""
    none, h = np.zeros((0, 3)), 1e-3
    return Step(h, h, x, v, x, v, none, none, none), x + h * v


def test_quadratic_drag_on_a_falling_sheet():
    speed = np.sqrt(2 * G / (AIR_DENSITY * 8.0))
    t = np.arange(16) / 30
    np.testing.assert_allclose(fall(NORMAL, [8.0], flat())[:, 1], -speed * np.tanh(G * t / speed), atol=2e-3 * speed)


def test_linear_drag_on_a_falling_sheet():
    t = np.arange(16) / 30
    np.testing.assert_allclose(fall(LINEAR, [4.0], flat())[:, 1], -G / 4 * (1 - np.exp(-4 * t)), atol=2e-3 * G / 4)


def test_added_mass_slows_the_fall_across_but_not_along():
    t = np.arange(16) / 30
    np.testing.assert_allclose(fall(ADDED_MASS, [1.5], flat())[:, 1], -G * t / 2.5, atol=1e-4)
    np.testing.assert_allclose(fall(ADDED_MASS, [1.5], flat(upright=True))[:, 1], -G * t, atol=1e-4)


def test_tangential_drag_is_along_the_sheet_only():
    t = np.arange(16) / 30
    np.testing.assert_allclose(fall(TANGENTIAL, [4.0], flat())[:, 1], -G * t, atol=1e-4)
    speed = np.sqrt(2 * G / (AIR_DENSITY * 4.0))
    np.testing.assert_allclose(fall(TANGENTIAL, [4.0], flat(upright=True))[:, 1], -speed * np.tanh(G * t / speed), atol=2e-3 * speed)


def test_lift_is_across_the_motion():
    """Half of ρ_a C_l sin α cos α |v|² per area, at 30 degrees."""
    cloth, v = flat(), np.array([np.cos(np.pi / 6), -np.sin(np.pi / 6), 0])
    step, x = standing(cloth.x_rest, np.tile(2 * v, (16, 1)))
    force = -LIFT.potentials(subject(cloth, cloth.faces[:0]), [4.0])[0].gradient(x, step).sum(0) / (0.15 * LENGTH**2)
    assert force @ v == pytest.approx(0, abs=1e-12) and force[1] > 0
    assert np.linalg.norm(force) == pytest.approx(AIR_DENSITY / 2 * 4.0 * 2**2 * np.sin(np.pi / 6) * np.cos(np.pi / 6))


def test_wind_pushes_still_cloth_along_itself_and_spares_cloth_edge_on():
    cloth = flat(upright=True)
    step, x = standing(cloth.x_rest, 0 * cloth.x_rest)
    s = subject(cloth, cloth.faces[:0])
    push = -WIND.potentials(s, [0.7, 0.0])[0].gradient(x, step).sum(0) / (0.15 * LENGTH**2)
    np.testing.assert_allclose(push, [AIR_DENSITY / 2 * DRAG_AREA * 0.7 * np.hypot(0.7, FLUCTUATION), 0, 0], atol=1e-12)
    assert np.abs(WIND.potentials(s, [0.0, 0.7])[0].gradient(x, step)).max() < 1e-15


def test_wind_and_drag_together_are_the_drag_of_the_difference():
    """Up to the fluctuation: cloth that drifts with the wind feels neither."""
    cloth = flat(upright=True)
    step, x = standing(cloth.x_rest, np.tile([0.7, 0, 0], (16, 1)))
    s = subject(cloth, cloth.faces[:0])
    drag, wind = (e.potentials(s, θ)[0].gradient(x, step).sum(0)[0] for e, θ in ((NORMAL, [DRAG_AREA]), (WIND, [0.7, 0.0])))
    assert abs(drag + wind) < (FLUCTUATION / 0.7) ** 2 / 2 * drag


def test_normals_and_their_derivatives():
    rng = np.random.default_rng(0)
    x, faces = sheet(4, 5)
    x = x + 0.1 * rng.normal(size=x.shape)
    dx = rng.normal(size=(3, *x.shape))
    air = FacesInAir(faces, len(x))
    pressure = air.normals(x)[1][:, None] * air.normals(x)[0]  # a force A n: by_normal = A I
    turned = air.turned(x, dx, pressure, air.normals(x)[1][:, None, None] * np.eye(3))
    for k in range(3):
        (n1, A1), (n0, A0) = air.normals(x + 1e-6 * dx[k]), air.normals(x - 1e-6 * dx[k])
        np.testing.assert_allclose(turned[k], (A1[:, None] * n1 - A0[:, None] * n0) / 2e-6, atol=1e-7)
    np.testing.assert_allclose(air.mean(dx), dx[:, faces].mean(2), atol=1e-15)
    f, T = rng.normal(size=(len(faces), 3)), rng.normal(size=(len(faces), 3, 3))
    np.testing.assert_allclose(air.carried(dx, T), np.einsum("fij,pfj->pfi", T, air.mean(dx)), atol=1e-14)
    np.testing.assert_allclose(np.sum(air.to_corners(f) * x), np.sum(f * x[faces].mean(1)))
