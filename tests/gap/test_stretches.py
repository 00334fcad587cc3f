"""Which frames the residuals before and after belong to."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.windows import Window
from tasks.gap.stretches import stretches

V = 3
COMPARED = (Window(0, 10, 5), Window(0, 30, 6), Window(1, 5, 4))


def found(frames):
    before = np.arange(frames * V * 3, dtype=float).reshape(frames, V, 3)
    return SimpleNamespace(before=before, after=0.5 * before, compared=COMPARED)


def test_every_window_gets_its_own_residuals():
    told = stretches(found(15))
    assert tuple(s.window for s in told) == COMPARED and [len(s.before) for s in told] == [5, 6, 4]
    np.testing.assert_array_equal(np.concatenate([s.before for s in told]).ravel(), np.arange(15 * V * 3))
    assert all(s.after_mm == pytest.approx(0.5 * s.before_mm) for s in told)


def test_frames_that_no_longer_match_are_not_guessed():
    """The windows with the named effect are fewer than those without."""
    assert stretches(found(13)) == ()
    assert stretches(SimpleNamespace(before=np.zeros((0, V, 3)), after=np.zeros((0, V, 3)), compared=())) == ()
