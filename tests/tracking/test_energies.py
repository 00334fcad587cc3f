"""ISO and normal terms: closed forms, rigid motion, mesh density."""

import numpy as np
import pytest

from tasks.geometry.meshes import edge_lengths, edges, hinges
from tasks.geometry.rotations import matrix_from_axis_angle
from tasks.tracking import isometry, normal_consistency
from tests.tracking.skirt import cone


def test_one_edge_stretched_by_a_tenth():
    x = np.array([[0, 0, 0], [0.11, 0, 0]])
    energy, g, H = isometry.derivatives(x, np.array([[0, 1]], np.int32), np.array([0.1]), np.array([10_000.0]))
    assert energy[0] == pytest.approx(0.5 * 10_000 * 0.1**2)
    assert g[0] == pytest.approx(np.array([[-10_000, 0, 0], [10_000, 0, 0]]))
    assert H[0, 0, 0] == pytest.approx(np.diag([1e6, 0, 0])) and H[0, 0, 1] == pytest.approx(-np.diag([1e6, 0, 0]))


def test_a_fold_of_angle_θ_costs_its_chord():
    θ = 0.7
    x = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -np.cos(θ), np.sin(θ)]])
    energy, _, _ = normal_consistency.derivatives(x, np.array([[0, 1, 2, 3]], np.int32), np.zeros((1, 3)), weight=2.0)
    assert energy[0] == pytest.approx((2 * np.sin(θ / 2)) ** 2)


def test_shape_terms_see_no_rigid_motion():
    x, faces = cone(12, 6)
    E, h = edges(faces), hinges(faces)
    R = matrix_from_axis_angle(np.array([0.3, -1.1, 0.4]))
    moved = x @ R.T + [0.2, -0.1, 0.5]
    rest, weight = edge_lengths(x, E), isometry.weights(x, faces, E, sigma=0.01)
    assert isometry.derivatives(moved, E, rest, weight)[0] == pytest.approx(0, abs=1e-20)
    still, turned = (normal_consistency.derivatives(y, h, np.zeros((len(h), 3)), weight=1.0)[0] for y in (x, moved))
    assert turned == pytest.approx(still) and still.sum() > 0.1


def test_normal_target_makes_the_given_shape_the_minimum():
    x, faces = cone(12, 6)
    h = hinges(faces)
    energy, g, _ = normal_consistency.derivatives(x, h, normal_consistency.normal_difference(x, h), weight=1.0)
    assert energy == pytest.approx(0, abs=1e-20) and g == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("term", ["iso", "normal"])
def test_gradient_by_differences(term):
    x, faces = cone(8, 4)
    x = x + 0.01 * np.random.default_rng(0).standard_normal(x.shape)
    E, h = edges(faces), hinges(faces)
    rest, target = edge_lengths(x, E) * 1.05, np.full((len(h), 3), 0.1)

    def energy(y):
        if term == "iso":
            return isometry.derivatives(y, E, rest, np.ones(len(E)))
        return normal_consistency.derivatives(y, h, target, weight=1.0)

    _, g, _ = energy(x)
    total = np.zeros_like(x)
    np.add.at(total, (E if term == "iso" else h).ravel(), g.reshape(-1, 3))
    d = np.random.default_rng(1).standard_normal(x.shape)
    slope = (energy(x + 1e-6 * d)[0].sum() - energy(x - 1e-6 * d)[0].sum()) / 2e-6
    assert (total * d).sum() == pytest.approx(slope, rel=1e-6)


def test_iso_energy_of_a_given_strain_does_not_depend_on_the_mesh():
    def energy(n):
        u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1))
        x = np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], 1)
        a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
        faces = np.concatenate([np.column_stack([a, a + 1, a + n + 1]), np.column_stack([a + 1, a + n + 2, a + n + 1])]).astype(np.int32)
        E = edges(faces)
        return isometry.derivatives(x * [1.02, 1.0, 1.0], E, edge_lengths(x, E), isometry.weights(x, faces, E, sigma=0.01))[0].sum()

    assert energy(40) == pytest.approx(energy(10), rel=1e-9)
