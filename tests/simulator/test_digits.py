"""What a recording of seven digits lost, and how it is given back."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.benchmarks.digits import moved, restored, rigid_shape, rounding


def written(x):
    """As C-IPC's frames are stored."""
    return np.vectorize(lambda value: float(f"{value:.6e}"))(x).astype(np.float32).astype(float)


def test_numbers_that_round_to_the_record_are_restored_and_no_others():
    x = np.random.default_rng(0).normal(size=(400, 3)) * 10.0 ** np.arange(-2, 1)
    record = written(x)
    assert np.all(restored(x, record) == x)
    off = x + 2.1 * rounding(record)
    assert np.all(restored(off, record) == record)
    assert restored(np.zeros(1), np.zeros(1)) == 0


def test_a_moving_rigid_shape_is_found_below_the_rounding():
    rng = np.random.default_rng(1)
    shape = rng.uniform(-0.5, 0.5, (300, 3))
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, 1.5, 40), [0.5, 0.6, 0.7]))
    c = [turn.apply(shape) + 0.1 * turn.magnitude() for turn in turns]
    record = written(np.array(c))
    found = rigid_shape(record)
    errors = [np.abs(moved(found, there) - true).mean() for there, true in zip(record, c, strict=True)]
    assert np.abs(record - c).mean() == pytest.approx(2.5e-8, rel=0.2)
    assert max(errors) < 7e-9


def test_the_nearest_motion_mirrors_nothing():
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
    assert not np.allclose(moved(flat, flat * [1, 1, -1]), flat * [1, 1, -1], atol=0.1)
