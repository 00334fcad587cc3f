"""Shares of several causes, against the average over all orders in which they can come."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from tasks.gap.shapley import misfit_taken, shapley
from tests.gap.synthetic import EFFECTS, windows

DRAG, DAMPING, FRICTION, *_ = EFFECTS


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_shares_are_the_mean_gain_over_all_orders(n):
    players, rng = [f"p{k}" for k in range(n)], np.random.default_rng(n)
    worth = {}

    def value(s):
        return worth.setdefault(s, float(rng.standard_normal()) if s else 0.0)

    found = shapley(players, value)
    orders = list(permutations(players))
    for p in players:
        gains = [worth[frozenset(order[: order.index(p) + 1])] - worth[frozenset(order[: order.index(p)])] for order in orders]
        assert found[p] == pytest.approx(np.mean(gains))
    assert sum(found.values()) == pytest.approx(worth[frozenset(players)])


def test_misfit_is_shared_by_what_each_takes():
    truth = {"air_normal_drag": 8.0, "contact_friction": 0.3}
    w = windows(np.random.default_rng(0), lambda k: truth)
    found = misfit_taken(w, w.fit([DRAG, FRICTION]))
    pair = (w.base.misfits - w.fit([DRAG, FRICTION]).misfits).sum()
    assert sum(found.values()) == pytest.approx(pair)
    assert min(found.values()) > 0.05 * pair
    assert abs(misfit_taken(w, w.fit([DRAG, FRICTION, DAMPING]))["fabric_mass_damping"]) < 0.05 * pair  # an innocent one takes nothing


def test_twins_share_what_both_could_take():
    w = windows(np.random.default_rng(1), lambda k: {"air_normal_drag": 8.0}, alike=0.999)
    found = misfit_taken(w, w.fit([DRAG, DAMPING]))
    assert found["air_normal_drag"] == pytest.approx(found["fabric_mass_damping"], rel=0.2)


def test_what_was_simulated_counts_as_it_was_simulated():
    """A cause of which derivatives about the base tell nothing: what its own simulation found is its share."""
    w = windows(np.random.default_rng(0), lambda k: {"air_normal_drag": 8.0, "contact_friction": 0.3})
    drag, friction, both = w.fit([DRAG]), w.fit([FRICTION]), w.fit([DRAG, FRICTION])
    better = replace(drag, misfits=0.5 * drag.misfits)
    found = misfit_taken(w, better)
    assert found == {DRAG.name: pytest.approx((w.base.misfits - better.misfits).sum())}
    beside = misfit_taken(w, both, [better, friction])
    assert beside[DRAG.name] - misfit_taken(w, both)[DRAG.name] == pytest.approx(0.25 * drag.misfits.sum())
    lost = replace(both, misfits=both.misfits[1:])
    assert misfit_taken(w, lost) == pytest.approx(misfit_taken(w, both))
