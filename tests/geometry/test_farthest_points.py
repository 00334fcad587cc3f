"""Points spread evenly: apart from one another as far as they leave the others."""

import numpy as np
from scipy.spatial.distance import cdist

from tasks.geometry.farthest_points import farthest_points


def test_no_point_is_farther_from_those_chosen_than_these_are_apart():
    x = np.random.default_rng(0).uniform(size=(500, 3))
    chosen = farthest_points(x, 40)
    between = cdist(x[chosen], x[chosen])[np.triu_indices(40, 1)]
    assert len(set(chosen)) == 40 and (np.diff(chosen) > 0).all()
    assert cdist(x, x[chosen]).min(1).max() <= between.min()


def test_of_few_points_all_are_chosen():
    x = np.random.default_rng(0).uniform(size=(7, 3))
    assert (farthest_points(x, 7) == np.arange(7)).all() and (farthest_points(x, 9) == np.arange(7)).all()
