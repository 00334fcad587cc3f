"""How far a gap shrinks: the fraction of what can be closed, its interval, and when it is not stated."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.nuisances import Prior
from tasks.cloth.numerics import FINER
from tasks.cloth.shooting import Evidence
from tasks.cloth.windows import Normals, Prediction, Window
from tasks.gap.acceleration import fitted_acceleration, residual_acceleration
from tasks.gap.held_out import fallen, floor_mm, log_ratios, shrinkage, unchanged

PRIOR = Prior(1e-3, 1e-2)
compared = partial(shrinkage, prior=PRIOR)


def evidence(rng, rms_mm, count=12):
    """Windows of five frames and thirty vertices with residuals of this root mean square distance, white for 1 mm."""
    found = []
    for k in range(count):
        r = rng.standard_normal((5, 30, 3)) * rms_mm * 1e-3 / np.sqrt(3)
        white = Normals(("x 0 x",), np.zeros((1, 1)), np.zeros(1), float(np.sum(r**2) / 1e-6), r.size)
        found.append(Evidence(Prediction(Window(0, 5 * k, 5), np.zeros((6, 30, 3)), {}, "converged", 0), white, r))
    return found


def test_a_finer_run_that_failed_is_no_small_floor():
    """Its window had counted as one in which mesh and step do nothing."""
    each, d = evidence(np.random.default_rng(0), 1.0, count=4), np.full((5, 30, 3), 2e-3 / np.sqrt(3))
    ways = {way.name: 0.5 * d for way in FINER}
    finer = [replace(e, prediction=replace(e.prediction, columns=ways)) for e in each]
    recording = SimpleNamespace(noise=np.full((3, 30), 1e-3))
    assert floor_mm(finer, [recording]) == pytest.approx(np.sqrt(3 + 4))
    assert floor_mm([*finer[:2], *each[2:]], [recording]) == pytest.approx(np.sqrt(3 + 4))
    assert floor_mm(each, [recording]) == pytest.approx(np.sqrt(3))


def test_half_of_what_can_be_closed_is_half():
    rng = np.random.default_rng(0)
    gap = compared(evidence(rng, 10.0), evidence(rng, np.sqrt((10.0**2 + 3.0**2) / 2)), floor_mm=3.0, held_out=True)
    assert gap.before_mm == pytest.approx(10.0, rel=0.03)
    assert gap.closed_fraction == pytest.approx(0.5, abs=0.05)
    assert gap.low < 0.5 < gap.high and gap.shrinks


def test_no_change_does_not_shrink():
    rng = np.random.default_rng(1)
    gap = compared(evidence(rng, 10.0), evidence(rng, 10.0), floor_mm=3.0, held_out=True)
    assert not gap.shrinks


def test_at_the_floor_no_fraction_is_stated():
    rng = np.random.default_rng(2)
    gap = compared(evidence(rng, 3.1), evidence(rng, 3.0), floor_mm=3.0, held_out=True)
    assert gap.closed_fraction is None and gap.shrinks  # a little is enough
    worse = compared(evidence(rng, 3.0), evidence(rng, 3.1), floor_mm=3.0, held_out=True)
    assert worse.closed_fraction is None and not worse.shrinks


def test_what_was_at_its_floor_and_is_above_it_does_not_shrink_however_likely():
    """Off the floor is 1.2 times its square, as it is before: 3.2 mm are at a floor of 3, 3.4 are not."""
    rng = np.random.default_rng(9)
    for mm, leaves in ((3.2, False), (3.4, True)):
        likelier = [replace(e, normals=replace(e.normals, c=0.5 * e.normals.c)) for e in evidence(rng, mm)]
        gap = compared(evidence(rng, 3.0), likelier, floor_mm=3.0, held_out=True)
        assert (gap.leaves_floor, gap.at_floor, gap.shrinks) == (leaves, not leaves, not leaves) and gap.falls == 1.0
    assert not compared(evidence(rng, 9.0), evidence(rng, 10.0), floor_mm=3.0, held_out=True).leaves_floor  # it was never there


def test_at_the_floor_what_is_likelier_counts_and_not_what_is_nearer():
    """Errors that the start or neighbours explain make no gap smaller; of what is left, a millimetre says more than of them."""
    rng = np.random.default_rng(8)
    before, after = evidence(rng, 3.0, 6), evidence(rng, 3.1, 6)
    explained = [replace(e, normals=replace(e.normals, c=0.5 * e.normals.c)) for e in after]
    assert compared(before, explained, floor_mm=3.0, held_out=True).shrinks
    assert not compared(before, after, floor_mm=3.0, held_out=True).shrinks
    nearer = [replace(e, normals=replace(e.normals, c=2 * e.normals.c)) for e in evidence(rng, 2.9, 6)]
    assert not compared(before, nearer, floor_mm=3.0, held_out=True).shrinks
    assert compared(evidence(rng, 10.0), evidence(rng, 5.0), floor_mm=3.0, held_out=True).falls == 1.0


def test_how_much_likelier_is_told_with_the_start_marginalised_and_each_window_by_its_own_misfit():
    rng = np.random.default_rng(9)
    (b,) = evidence(rng, 3.0, 1)
    G, g = np.array([[4e6]]), np.array([3e4])
    told = replace(
        b, normals=replace(b.normals, G=G, g=g, c=b.normals.c + 200.0)
    )  # the start explains 3e4²/(4e6 + 1e6) = 180 of it, and costs log 5
    assert log_ratios([(b, told)], PRIOR) == pytest.approx([0.5 * (180.0 - 200.0 - np.log(5.0)) / (b.normals.c / b.normals.n)])
    lost = replace(b, normals=replace(b.normals, c=1e6))
    both = [
        (lost, replace(lost, normals=replace(lost.normals, c=1e6 - 300))),
        (b, replace(b, normals=replace(b.normals, c=b.normals.c + 100))),
    ]
    assert 0 < log_ratios(both, PRIOR)[0] < 0.1 < 10 < -log_ratios(both, PRIOR)[1]  # 300 of a million are fewer than 100 of hundreds


def test_a_model_that_follows_no_window_leaves_the_gap_before():
    rng = np.random.default_rng(4)
    before, after = evidence(rng, 10.0), evidence(rng, 5.0)
    lost = [replace(e, prediction=replace(e.prediction, ending="stalled"), residual=None) for e in after]
    gap = compared(before, lost, floor_mm=3.0, held_out=True)
    assert gap.before_mm == pytest.approx(10.0, rel=0.03) and np.isnan(gap.after_mm) and not gap.shrinks
    assert unchanged(gap).after_mm == gap.before_mm


def test_what_was_not_seen_does_not_count():
    rng = np.random.default_rng(3)
    before, after = evidence(rng, 10.0), evidence(rng, 5.0)
    whole = compared(before, after, floor_mm=1.0, held_out=False)
    for e in (*before, *after):
        e.residual[:, 20:] = np.nan
    part = compared(before, after, floor_mm=1.0, held_out=False)
    assert part.before_mm == pytest.approx(whole.before_mm, rel=0.05)


def test_the_acceleration_of_a_constant_force_is_found():
    t = np.arange(1, 6) / 30.0
    a = np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 0.0]])
    field = 0.5 * t[:, None, None] ** 2 * a
    field[2, 1] = np.nan
    np.testing.assert_allclose(fitted_acceleration(field, 30.0), a, rtol=1e-9)


def test_a_vertex_that_was_never_seen_misses_nobody_knows_what():
    rng = np.random.default_rng(0)
    found = evidence(rng, 10.0, 3)
    for e in found:
        e.residual[:, 4] = np.nan
    accel = residual_acceleration(found, 30.0)
    assert np.isnan(accel[4]) and np.isfinite(np.delete(accel, 4)).all()


@pytest.mark.parametrize("n", [2, 3, 5, 12])
def test_nine_of_ten_intervals_hold_what_all_motion_would_say(n):
    """Windows of different sizes and falls; a bootstrap over two of them held it in half."""
    rng, held = np.random.default_rng(n), 0
    for _ in range(1000):
        m = rng.integers(50, 150, n).astype(float)
        before = m * (100 + 10 * rng.standard_normal(n))
        after = m * (64 + 10 * rng.standard_normal(n))
        gap = fallen(np.column_stack([before, after, m]), 4.0, held_out=True)
        closable = gap.before_mm**2 - 16.0
        held += gap.low * closable <= 36.0 <= gap.high * closable
    assert 0.87 < held / 1000 < 0.93


def test_a_single_window_has_no_interval():
    rng = np.random.default_rng(0)
    gap = compared(evidence(rng, 10.0, 1), evidence(rng, 5.0, 1), floor_mm=3.0, held_out=True)
    assert gap.closed_fraction == pytest.approx(0.8, abs=0.1) and gap.low is gap.high is None and gap.shrinks


def test_a_cause_that_acts_in_one_window_of_five_still_shrinks_the_gap():
    rng = np.random.default_rng(4)
    before = [*evidence(rng, 1.3, 4), *evidence(rng, 12.0, 1)]
    after = [*evidence(rng, 1.3, 4), *evidence(rng, 1.3, 1)]
    gap = compared(before, after, floor_mm=1.3, held_out=True)
    assert gap.closed_fraction > 0.9 and gap.shrinks
    assert gap.low < 0  # what the draws without that window say


def test_where_nothing_is_named_after_is_as_before():
    rng = np.random.default_rng(5)
    gap = unchanged(compared(evidence(rng, 10.0), evidence(rng, 12.0), floor_mm=3.0, held_out=True))
    assert gap.after_mm == gap.before_mm and gap.closed_fraction == gap.low == gap.high == 0.0 and not gap.shrinks
    floor = unchanged(compared(evidence(rng, 3.0), evidence(rng, 4.0), floor_mm=3.0, held_out=True))
    assert floor.closed_fraction is None


def test_a_tenth_of_what_can_be_closed_is_no_cause():
    """A null sleeve gave a twentieth to a curvature of rest that nobody had planted."""
    rng = np.random.default_rng(6)
    before = evidence(rng, 10.0)
    after = [replace(b, residual=b.residual * np.sqrt(0.92)) for b in before]
    gap = compared(before, after, floor_mm=4.0, held_out=True)
    assert gap.falls == 1.0 and 0.05 < gap.closed_fraction < 0.12 and not gap.shrinks


def test_an_interval_near_the_floor_is_one_that_can_be_read():
    """What can be closed is that of all windows: in a third of all draws of four nothing would be left to close."""
    rng = np.random.default_rng(7)
    gap = compared(evidence(rng, 3.0, 3) + evidence(rng, 5.0, 1), evidence(rng, 2.9, 4), floor_mm=3.0, held_out=True)
    assert (gap.low + gap.high) / 2 == pytest.approx(gap.closed_fraction) and gap.low < 0 < gap.closed_fraction < gap.high
