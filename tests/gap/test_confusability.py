"""Cosines and lengths of signatures from normal equations, against the dense whitened vectors."""

import numpy as np
import pytest
from scipy.linalg import subspace_angles

from tasks.gap.confusability import confusability
from tasks.gap.hypotheses import Windows
from tasks.gap.strength_priors import BASE_SPREAD
from tasks.gap.verdict import twins
from tests.gap.synthetic import EFFECTS, NAMES, dense, normals


@pytest.fixture(scope="module")
def both():
    """The compressed windows, and the dense signatures [coordinates, P], whitened by each window's scale and by the free base."""
    made = dense(np.random.default_rng(0), lambda k: {"air_normal_drag": 8.0}, alike=0.6, n=60)
    made[3] = (made[3][0], 3 * made[3][1])  # a window that fits badly counts for less
    w = Windows([normals(A, r) for A, r in made], EFFECTS)
    A = np.concatenate([A / np.sqrt(s) for (A, _), s in zip(made, w.scale, strict=True)])
    B = A[:, :2]
    root = np.linalg.inv(np.linalg.cholesky(np.eye(len(A)) + BASE_SPREAD**2 * B @ B.T))
    return w, root @ A


def columns(effect):
    return [NAMES.index(c) for c in effect.columns]


def test_cosines_are_those_of_the_dense_vectors(both):
    w, S = both
    found = confusability(w, EFFECTS)
    for i, a in enumerate(EFFECTS):
        for j, b in enumerate(EFFECTS):
            one, two = S[:, columns(a)], S[:, columns(b)]
            if one.shape[1] == two.shape[1] == 1:
                expected = (one.T @ two).item() / np.linalg.norm(one) / np.linalg.norm(two)
                least = expected
            else:
                expected = np.cos(subspace_angles(one, two).min())
                least = np.cos(subspace_angles(one, two).max()) if one.shape == two.shape else 0.0
            assert found.cosine[i, j] == pytest.approx(expected, abs=1e-8)
            assert found.least[i, j] == pytest.approx(least, abs=1e-8)
    assert found.cosine[0, 1] > 0.5  # as made


def test_what_is_alike_in_one_direction_only_is_no_twin(both):
    """Friction may look like a tilt about one axis; simulating the tilt is not simulating friction."""
    w, _ = both
    mix = np.eye(len(NAMES))
    friction, tilt = NAMES.index("contact_friction"), NAMES.index("gravity_tilt.θ_x")
    mix[:, friction] = 0.0
    mix[tilt, friction] = 1.0  # its column is that of θ_x
    alike = Windows([type(n)(n.names, mix.T @ n.G @ mix, mix.T @ n.g, n.c, n.n) for n in w.normals], EFFECTS)
    found = confusability(alike, EFFECTS)
    i, j = (next(k for k, e in enumerate(EFFECTS) if e.name == name) for name in ("contact_friction", "gravity_tilt"))
    assert found.cosine[i, j] == pytest.approx(1.0, abs=1e-6) and found.least[i, j] == 0.0
    assert not twins(found)


def test_detectability_is_the_length_at_typical_strength(both):
    w, S = both
    found = confusability(w, EFFECTS)
    for e, d in zip(EFFECTS, found.detectability, strict=True):
        assert d == pytest.approx(np.linalg.norm(S[:, columns(e)] @ e.typical))
    assert found.testable.all()


def test_a_signature_that_hardly_shows_is_not_testable(both):
    w, _ = both
    faint = np.array([1e-3 if n == "fabric_hem_mass" else 1.0 for n in NAMES])
    weak = Windows([type(n)(n.names, n.G * np.outer(faint, faint), n.g * faint, n.c, n.n) for n in w.normals], EFFECTS)
    found = confusability(weak, EFFECTS)
    assert found.testable.tolist() == [e.name != "fabric_hem_mass" for e in EFFECTS]


def test_an_effect_without_signature_has_neither_length_nor_cosine(both):
    w, _ = both
    absent = np.array([0.0 if n == "contact_friction" else 1.0 for n in NAMES])
    found = confusability(
        Windows([type(n)(n.names, n.G * np.outer(absent, absent), n.g * absent, n.c, n.n) for n in w.normals], EFFECTS), EFFECTS
    )
    assert found.detectability[2] == 0 and not found.cosine[2].any()
