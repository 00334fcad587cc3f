"""The base goes where the leading cause's fabric leads it, if that is nearer."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.base_parameters import logarithms, with_fabric
from tasks.cloth.base_refit import refit
from tasks.cloth.shooting import follow
from tasks.cloth.start_state import states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.tracking_noise import Correlation
from tasks.cloth.windows import windows
from tasks.gap import diagnosis, window_length
from tasks.gap.gathered import FEWEST_WINDOWS, Gathered, jobs
from tasks.gap.nested_base import nested_base
from tasks.gap.screening import MODES
from tests.cloth.test_windows import FABRIC, FPS, swung
from tests.gap.test_gathered import data as long_enough

NOISE = 1e-3
SOFT = replace(FABRIC, membrane=FABRIC.membrane / 3, bending=FABRIC.bending / 12)


@pytest.fixture(scope="module")
def swinging():
    """A panel that swings, and the base in a fabric, as its refit would leave it there."""
    truth, recording, *_ = swung(31, noise=NOISE)
    walked = states(truth, recording.motion, recording.observed, NOISE)
    data = Gathered((recording,), (walked,), tuple(windows([recording], FPS, 0.33)))

    def base(fabric):
        todo = jobs(with_fabric(truth, fabric), data, smooth_modes(truth.subject.cloth, MODES))
        return refit(todo, noise=NOISE, iterations=0)

    return data, base


def test_a_base_that_was_left_elsewhere_comes_to_the_fabric_of_the_leader(swinging):
    data, base = swinging
    near = replace(FABRIC, bending=1.3 * FABRIC.bending)
    found = nested_base(base(SOFT), data, near)
    assert not found.effects and np.abs(logarithms(found.subject.fabric) - logarithms(FABRIC)).max() < 0.1


def test_a_base_that_is_the_nearest_stays(swinging):
    data, base = swinging
    assert nested_base(base(FABRIC), data, SOFT) is None


def test_a_fabric_that_is_nearly_the_same_is_not_tried(swinging):
    data, base = swinging

    def run(work, jobs):
        raise AssertionError("nothing is to be simulated")

    own = base(SOFT)
    assert nested_base(own, data, replace(SOFT, bending=1.2 * SOFT.bending), run) is None


def test_only_windows_that_are_compared_count(swinging):
    """The base was fitted on more windows than could be followed with all tangents."""
    data, base = swinging
    few, followed = data.only(data.windows[1:]), set()

    def run(work, jobs):
        followed.update(job.window for job in jobs if work is follow)
        return map(work, jobs)

    assert nested_base(base(SOFT), few, FABRIC, run) is not None
    assert followed == set(few.windows)


class Decided(Exception):
    """The diagnosis got as far as it is looked at here: which base it decides about, how often it settled."""


@pytest.mark.parametrize(("followed", "about"), [(8, "other"), (FEWEST_WINDOWS - 1, "first")])
def test_all_is_weighed_anew_about_the_nearer_base(monkeypatch, followed, about):
    """States, windows, tangents and trials are all the other base's; where it can follow too few windows, the first one's stand."""
    first, other = (SimpleNamespace(name=name, subject=SimpleNamespace(fps=FPS, cloth=None)) for name in ("first", "other"))
    done = []

    class Settling:
        def __init__(self, screened, *_, **__):
            self.base = screened.base

        def settle(self):
            done.append(("settled", self.base.name))

        def nested_base(self):
            return other

    def screened(model, train, effects, **options):
        n = len(train.windows) if model is first else followed
        return SimpleNamespace(base=model, evidence=[None] * n, windows=SimpleNamespace(overdispersion=np.ones(n)))

    def decided(trials):
        raise Decided(trials.base.name)

    def written_down(what):
        return lambda model, data, *_: done.append((what, model.name)) or data

    monkeypatch.setattr(diagnosis, "gather", lambda model, recordings, run: long_enough(41, 41))
    monkeypatch.setattr(diagnosis, "roughly_refitted", lambda model, *_, **__: (model, Correlation(0.0, 0.1)))
    monkeypatch.setattr(diagnosis, "smooth_modes", lambda cloth, count: None)
    monkeypatch.setattr(diagnosis, "restated", written_down("restated"))
    monkeypatch.setattr(window_length, "unwrinkled", written_down("unwrinkled"))
    monkeypatch.setattr(window_length, "screen", screened)
    monkeypatch.setattr(diagnosis, "Trials", Settling)
    monkeypatch.setattr(diagnosis, "decided", decided)
    with pytest.raises(Decided, match=about):
        diagnosis.diagnose(first, long_enough(41, 41).recordings, [])
    once = [(what, "first") for what in ("restated", "unwrinkled", "settled")]
    again = [(what, "other") for what in ("restated", "unwrinkled", "settled")]
    assert done == once + (again if about == "other" else again[:2])
