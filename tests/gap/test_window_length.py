"""Windows as long as cloth can be predicted."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.windows import LONG_S, SHORT_S
from tasks.gap import window_length
from tasks.gap.screening import FINAL
from tasks.gap.window_length import FORERUNNERS, Look
from tests.gap.test_gathered import FPS, data

LONG, SHORT = 10, 5  # frames


def asked(monkeypatch, misfits, *, quick=False, lost=0):
    """(frames of a window, windows, iterations) of every screening, in which windows misfit as they are told and some are lost; and what it ended with."""
    seen, calm = [], []

    def screened(model, train, effects, *, iterations, **options):
        frames = max(w.length for w in train.windows)
        left = np.full(len(train.windows), misfits[len(seen)])
        seen.append((frames, len(train.windows), iterations))
        return SimpleNamespace(
            evidence=[None] * (len(left) - (lost if frames == LONG else 0)), windows=SimpleNamespace(overdispersion=left)
        )

    def unwrinkled(model, data, φ, run):
        calm.append(max(w.length for w in data.windows))
        return data

    monkeypatch.setattr(window_length, "screen", screened)
    monkeypatch.setattr(window_length, "unwrinkled", unwrinkled)
    model = SimpleNamespace(subject=SimpleNamespace(fps=FPS))
    look = Look([], 0.0, np.zeros((0, 2)), False, map, lambda text: None)
    looked = look.longest_predicted(model, data(41, 41), (LONG_S, SHORT_S), quick=quick)
    assert calm == [frames for frames, _, _ in seen]
    assert all(w.length <= seen[-1][0] for w in looked.data.windows)
    return seen, looked.length_s


@pytest.mark.parametrize(("misfits", "frames"), [((1.5,), [LONG]), ((9.0, 8.0), [LONG, SHORT])])
def test_where_derivatives_do_not_hold_windows_are_shortened(monkeypatch, misfits, frames) -> None:
    seen, length_s = asked(monkeypatch, misfits)
    assert [each for each, _, _ in seen] == frames and length_s == (LONG_S if frames == [LONG] else SHORT_S)


@pytest.mark.parametrize(("lost", "frames"), [(1, [LONG]), (2, [LONG, SHORT])])
def test_where_many_cannot_be_followed_too(monkeypatch, lost, frames) -> None:
    """Of six that teach a quarter may be lost."""
    seen, _ = asked(monkeypatch, (1.0, 1.0), lost=lost)
    assert seen[0][1] == 6 and [each for each, _, _ in seen] == frames


@pytest.mark.parametrize(
    ("misfits", "lost", "frames"),
    [
        ((1.0, 1.0), 0, [LONG, LONG]),
        ((9.0, 1.0), 0, [LONG, SHORT]),  # all six would have been asked
        ((1.0, 1.0), 1, [LONG, SHORT]),
    ],
)
def test_a_quick_diagnosis_puts_it_to_a_few_first(monkeypatch, misfits, lost, frames) -> None:
    seen, length_s = asked(monkeypatch, misfits, quick=True, lost=lost)
    assert [each for each, _, _ in seen] == frames and length_s == (LONG_S if frames[-1] == LONG else SHORT_S)
    assert seen[0] == (LONG, 3, 0) and 3 <= FORERUNNERS < seen[1][1] and seen[1][2] == FINAL
