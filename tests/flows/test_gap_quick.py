"""A quick diagnosis works on a thinned garment and still speaks of, and predicts, all of its vertices."""

from functools import partial

import numpy as np
import pytest

from flows import gap
from tasks.effects.library import library
from tests.cloth.test_windows import swung
from tests.flows.test_gap import write

KEPT = ("air_normal_drag", "gravity_tilt")
THINNED = 30  # of 49


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    folder = tmp_path_factory.mktemp("quick")
    model, recording, x, _ = swung(31, noise=1e-3)
    blind = recording.observed.copy()
    blind[2:, 7:] = np.nan
    write(folder / "track.npz", model, recording)
    write(folder / "blind.npz", model, recording, vertices=blind)
    request = gap.Request(
        (folder / "track.npz",),
        predict=folder / "blind.npz",
        out=folder / "pred.npz",
        quick=True,
        without=tuple(n for n in library() if n not in KEPT),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gap, "coarse_garment", partial(gap.coarse_garment, count=THINNED))
        return *gap.run(request), np.load(folder / "pred.npz"), x


def test_it_works_on_the_thinned_garment(quick):
    _, found, _, _ = quick
    assert len(found.base.subject.cloth.x_rest) == found.before.shape[1] == THINNED


def test_it_speaks_of_every_vertex(quick):
    told, *_ = quick
    assert len(told["where"]["vertex_mm"]) == len(told["where"]["vertex_accel"]) == 49
    assert len(set(told["where"]["vertex_mm"]) - {None}) <= THINNED
    assert told["verdict"]["kind"] == "none", told["verdict"]["sentence"]


def test_it_predicts_the_whole_garment(quick):
    *_, pred, x = quick
    assert pred["before"].shape == pred["after"].shape == x.shape
    still = np.sqrt(np.mean((x[1] - x) ** 2))
    assert np.sqrt(np.mean((pred["before"] - x) ** 2)) < 0.3 * still
