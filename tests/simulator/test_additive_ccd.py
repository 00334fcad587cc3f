"""Continuous collision detection and distances against ipctk's, to rounding."""

import ipctk
import numpy as np
import pytest

from tasks.simulator.additive_ccd import free_share, nearer_than

CCD = ipctk.AdditiveCCD(conservative_rescaling=0.9)
EDGES = np.array([[0, 1], [2, 3]], np.int32)
FACES = np.array([[1, 2, 3]], np.int32)
EDGE_EDGE, FACE_VERTEX = (
    (np.array([[0, 1]], np.int32), np.empty((0, 2), np.int32)),
    (np.empty((0, 2), np.int32), np.array([[0, 0]], np.int32)),
)


def drawn(seed, flat):
    """Four points before and after [4, 3]; flat: nearly in one plane, parallel or coplanar at times."""
    rng = np.random.default_rng(seed)
    X, Y = rng.normal(size=(2, 4, 3))
    if flat:
        X[:, 1] *= 1e-4
        X[3] = X[2] + (X[1] - X[0]) * (1 + 1e-9 * rng.normal())
    return X, X + (Y - X) * 10 ** rng.uniform(-1, 1)


@pytest.mark.parametrize("flat", [False, True])
def test_shares_are_those_of_ipctk(flat):
    met = 0
    for seed in range(300):
        X, Y = drawn(seed, flat)
        ours = free_share(X, Y, EDGES, FACES, *EDGE_EDGE, keep=1e-9, kept_share=0.1)
        hit, toi = CCD.edge_edge_ccd(*X[[0, 1, 2, 3]], *Y[[0, 1, 2, 3]], 1e-9, 1.0)
        assert ours == pytest.approx(toi if hit else 1.0, abs=1e-9)
        met += hit
        ours = free_share(X, Y, EDGES, FACES, *FACE_VERTEX, keep=1e-9, kept_share=0.1)
        hit, toi = CCD.point_triangle_ccd(*X, *Y, 1e-9, 1.0)
        assert ours == pytest.approx(toi if hit else 1.0, abs=1e-9)
        met += hit
    assert met > 60


@pytest.mark.parametrize("flat", [False, True])
def test_distances_are_those_of_ipctk(flat):
    for seed in range(300):
        X, _ = drawn(seed, flat)
        for pairs, theirs in ((EDGE_EDGE, ipctk.edge_edge_distance), (FACE_VERTEX, ipctk.point_triangle_distance)):
            d = np.sqrt(theirs(*X))
            assert sum(map(len, nearer_than(X, EDGES, FACES, *pairs, reach=d * (1 + 1e-9) + 1e-12))) == 1
            assert sum(map(len, nearer_than(X, EDGES, FACES, *pairs, reach=d * (1 - 1e-9) - 1e-12))) == 0


def test_the_first_of_many_counts_whatever_their_order():
    X = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 0.5], [0.3, 0.3, 0.2]], float)
    Y = X + np.array([[0, 0, 0]] * 3 + [[0, 0, -1.0], [0, 0, -1.0]])
    faces, nothing = np.array([[0, 1, 2]], np.int32), np.empty((0, 2), np.int32)
    for order in ([[0, 3], [0, 4]], [[0, 4], [0, 3]]):
        share = free_share(X, Y, nothing, faces, nothing, np.array(order, np.int32), keep=0.0, kept_share=0.1)
        assert 0.17 < share <= 0.18 + 1e-12


@pytest.mark.parametrize("vertex", range(4))
@pytest.mark.parametrize("pairs", [EDGE_EDGE, FACE_VERTEX])
def test_a_way_that_is_not_finite_ends_the_search(vertex, pairs):
    X, Y = drawn(0, flat=False)
    Y[vertex, 0] = np.nan
    assert free_share(X, Y, EDGES, FACES, *pairs, keep=0.0, kept_share=0.1) in (0, 1)
