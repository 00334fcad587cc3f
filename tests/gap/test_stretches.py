"""Which frames the residuals before and after belong to."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.windows import Recording, windows
from tasks.effects.effect import Motion
from tasks.gap.stretches import stretches
from tasks.simulator.cloth import NO_COLLIDER

FPS, V = 30.0, 3


def recording(T):
    return Recording(NO_COLLIDER, Motion(np.zeros((T, 0, 3)), np.zeros((T, 0, 3))), np.zeros((T, V, 3)), np.full((T, V), 1e-3))


def found(frames, *, held, evidence=()):
    before = np.arange(frames * V * 3, dtype=float).reshape(frames, V, 3)
    base = SimpleNamespace(subject=SimpleNamespace(fps=FPS))
    return SimpleNamespace(
        screened=SimpleNamespace(evidence=evidence), shrinkage=SimpleNamespace(held_out=held), before=before, after=0.5 * before, base=base
    )


def test_windows_spread_over_the_recordings_were_held_out():
    tracks = [recording(41), recording(31)]
    own = [[w for w in windows(tracks, FPS) if w.recording == k] for k in (0, 1)]
    kept = [own[0][2], own[0][6], own[1][1], own[1][4]]
    told = stretches(found(sum(w.length for w in kept), held=True), tracks, None)
    assert [s.window for s in told] == kept
    np.testing.assert_array_equal(np.concatenate([s.before for s in told]).ravel(), np.arange(sum(w.length for w in kept) * V * 3))
    assert all(s.after_mm == pytest.approx(0.5 * s.before_mm) for s in told)


def test_files_that_were_held_out_are_cut_whole():
    told = stretches(found(20, held=True), [recording(41)], [recording(21)])
    assert [s.window for s in told] == windows([recording(21)], FPS)


def test_without_anything_held_out_they_are_those_of_the_fit():
    own = [SimpleNamespace(prediction=SimpleNamespace(window=w), residual=np.zeros(1)) for w in windows([recording(21)], FPS)]
    assert [s.window for s in stretches(found(20, held=False, evidence=own), [recording(21)], None)] == windows([recording(21)], FPS)


def test_frames_that_no_longer_match_are_not_guessed():
    assert stretches(found(13, held=True), [recording(41)], [recording(21)]) == ()
