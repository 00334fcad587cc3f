"""The refit begins in the nearest fabric of those that are tried."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth import nearest_fabric as own
from tasks.cloth.base_parameters import BOUNDS, logarithms, with_fabric
from tasks.cloth.nearest_fabric import FACTORS, about, nearest_fabric, searched
from tasks.cloth.shooting import Job, follow
from tasks.cloth.start_state import states
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import windows
from tasks.simulator import Fabric
from tests.cloth.test_windows import FABRIC, FPS, swung

NOISE = 1e-3


@pytest.fixture(scope="module")
def jobs():
    """Long windows of a panel that swings."""
    model, recording, *_ = swung(31, noise=NOISE)
    walked, φ = states(model, recording.motion, recording.observed, NOISE), smooth_modes(model.subject.cloth, 12)
    return [Job(model, recording, w, walked, φ) for w in windows([recording], FPS, 0.33)]


@pytest.mark.parametrize("factor", FACTORS)
def test_fabrics_lie_a_factor_apart_within_bounds(factor):
    fabric = Fabric(320.0, 3.0, 400.0)
    found = about(fabric, factor)
    steps = np.array([logarithms(f) - logarithms(fabric) for f in found]) / np.log(factor)
    assert not steps[0].any() and len(found) == 9
    assert set(np.round(steps[:, 0], 6)) == {-1.0, 0.0, 1.0}
    assert max(f.bending for f in found) == pytest.approx(np.exp(BOUNDS["log_bending"][1]))


@pytest.mark.parametrize(("membrane", "bending"), [(4.0, 0.25), (0.125, 0.5)])
def test_the_nearest_is_the_own_one(jobs, membrane, bending):
    """From a fabric that is off by one factor or both."""
    first = replace(FABRIC, membrane=membrane * FABRIC.membrane, bending=bending * FABRIC.bending)
    todo = [replace(job, model=with_fabric(job.model, first)) for job in jobs]
    assert np.allclose(logarithms(searched(todo[:2], first, noise=NOISE)), logarithms(FABRIC))


def test_what_the_jobs_have_counts_too(jobs):
    far = replace(FABRIC, bending=FABRIC.bending / 20)
    assert np.allclose(logarithms(searched(jobs[:2], far, noise=NOISE)), logarithms(FABRIC))


def test_what_the_jobs_have_is_not_followed_twice(jobs, monkeypatch):
    asked = []
    monkeypatch.setattr(own, "nearest_fabric", lambda jobs, fabrics, **_: asked.append(fabrics) or fabrics[0])
    searched(jobs[:1], FABRIC, noise=NOISE)
    assert [len(fabrics) for fabrics in asked] == [len(set(fabrics)) for fabrics in asked] == [9, 9]


def test_a_fabric_that_cannot_be_followed_is_not_the_nearest(jobs, monkeypatch):
    """However near it comes in the windows that are left."""
    stiff = replace(FABRIC, bending=4 * FABRIC.bending)
    assert nearest_fabric(jobs, [stiff, FABRIC], noise=NOISE) is FABRIC

    def stuck_once(job):
        found = follow(job)
        if job.model.subject.fabric == FABRIC and job.window == jobs[0].window:
            return replace(found, prediction=replace(found.prediction, ending="stuck"), normals=None)
        return found

    monkeypatch.setattr(own, "follow", stuck_once)
    assert nearest_fabric(jobs, [stiff, FABRIC], noise=NOISE) is stiff
