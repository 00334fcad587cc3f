"""Windows: as long as recordings allow, and which of them teach."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.start_state import States
from tasks.cloth.windows import LONG_S, SHORT_S, Recording
from tasks.effects.effect import Motion
from tasks.gap.gathered import ENOUGH, FEWEST_WINDOWS, Gathered, lengths, split
from tasks.simulator.cloth import NO_COLLIDER

FPS = 30.0


def data(*frames: int, length_s: float = SHORT_S) -> Gathered:
    recordings = tuple(
        Recording(NO_COLLIDER, Motion(np.zeros((T, 0, 3)), np.zeros((T, 0, 3))), np.zeros((T, 2, 3)), np.full((T, 2), 1e-3)) for T in frames
    )
    walked = tuple(States(r.observed, r.observed, "converged") for r in recordings)
    return Gathered(recordings, walked, ()).cut(length_s, FPS)


@pytest.mark.parametrize(
    ("frames", "longest"),
    [
        ((30,), SHORT_S),  # a second: too short for fewer windows than it has
        ((40, 40), 78 / FPS / ENOUGH),
        ((200, 200), LONG_S),
    ],
)
def test_windows_are_made_longer_where_enough_are_left(frames, longest) -> None:
    found = lengths(data(*frames).recordings, FPS)
    assert found[0] == pytest.approx(longest) and found[-1] == SHORT_S and len(found) == (1 if longest == SHORT_S else 2)
    assert longest == SHORT_S or len(data(*frames, length_s=found[0]).windows) >= ENOUGH


def test_a_recording_is_cut_anew_where_its_states_are_known() -> None:
    known = data(41)
    known = replace(known, states=(States(known.states[0].x[:11], known.states[0].v[:11], "stuck"),))
    assert [w.start for w in known.cut(LONG_S, FPS).windows] == [0, 10]


@pytest.mark.parametrize("frames", [(21,), (26,), (31,), (41, 41), (200,)])
def test_enough_windows_teach_and_the_first_of_each_recording_does(frames) -> None:
    """Of four windows none is kept, of five one: of two that were kept, three would have been too few to teach."""
    whole = data(*frames)
    train, held = split(whole)
    assert len(train.windows) >= min(FEWEST_WINDOWS, len(whole.windows))
    assert sorted((*train.windows, *held.windows), key=lambda w: (w.recording, w.start)) == list(whole.windows)
    assert all(w.start > 0 for w in held.windows)
    assert len(held.windows) >= min(len(whole.windows) - FEWEST_WINDOWS, 0.25 * len(whole.windows) - 1)


@pytest.mark.parametrize("frames", [(31,), (41, 41), (200,)])
def test_no_frame_that_is_kept_out_is_compared(frames) -> None:
    """The start of a window may be the end of one that is kept out."""
    train, held = split(data(*frames))
    for k, recording in enumerate(train.compared()):
        seen = np.isfinite(recording.observed).all((1, 2))
        kept = [t for w in held.windows if w.recording == k for t in range(w.start + 1, w.start + w.length + 1)]
        taught = [t for w in train.windows if w.recording == k for t in range(w.start + 1, w.start + w.length + 1)]
        assert not seen[kept].any() and seen[taught].all() and seen[0]
