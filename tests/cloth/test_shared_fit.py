"""A fit that is shared with others is the fit alone, to the last bit; and whoever goes the same way afterwards simulates nothing."""

import numpy as np
import pytest

from tasks.cloth.adam_fd import Descent, as_algorithm_1, descend
from tasks.cloth.stage import FitParameters, Work, _by_tangents
from tasks.cloth.windowed_fit import fit_windows
from tasks.effects.library import library
from tasks.plain_data import digest
from tasks.shared_map import SharedMap
from tasks.stage import Job
from tests.cloth.test_gauss_newton import observed, panel
from tests.cloth.test_windowed_fit import FAR


@pytest.fixture(scope="module")
def scene():
    return observed(panel(6, frames=11), 5)


def windows(scene, run):
    found = fit_windows(scene, FAR, iterations=1, run=run)
    return found.fabric, found.normal, found.replay.x


def windows_with_drag(scene, run):
    found = fit_windows(scene, FAR, effects=[library()["air_normal_drag"]], iterations=1, run=run)
    return found.fabric, found.normal, found.replay.x, found.model.strengths


def candidates(scene, run):
    found = descend(as_algorithm_1(scene), FAR, Descent.at([320.0, 1.0, 1.0]), iterations=1, run=run)
    return found.θ, found.best, [row["loss"] for row in found.history]


@pytest.mark.parametrize("fit", [windows, windows_with_drag, candidates])
def test_shared_is_alone(scene, tmp_path, fit):
    simulated = []

    def here(function, items):
        simulated.extend(items)
        return map(function, items)

    alone = fit(scene, map)
    shared = fit(scene, SharedMap(tmp_path, here, 2))
    assert digest(shared) == digest(alone)
    assert simulated
    simulated.clear()
    assert digest(fit(scene, SharedMap(tmp_path, here, 2))) == digest(alone)
    assert not simulated


def test_one_bit_of_the_recording_is_another_fit(scene, tmp_path):
    simulated = []

    def here(function, items):
        simulated.extend(items)
        return map(function, items)

    candidates(scene, SharedMap(tmp_path, here, 1))
    first = len(simulated)
    scene.observed[1, -1] = np.nextafter(scene.observed[1, -1], 1)
    candidates(scene, SharedMap(tmp_path, here, 1))
    assert len(simulated) == 2 * first


def test_a_fit_that_was_killed_ends_as_if_nobody_had_killed_it(scene, tmp_path):
    parameters = FitParameters(iterations=2)

    def dying(function, items):
        for item in items:
            lives.pop()
            yield function(item)

    def fitted(place, here):
        place.mkdir(exist_ok=True)
        job = Job("anna", "walk", None, place, lambda share, text: None, lambda text: None)
        _, found, known = _by_tangents(job, Work("garment", scene, FAR), parameters, job.spread(here, 1))
        return found.fabric, found.normal, found.replay.x, known

    undisturbed = fitted(tmp_path / "undisturbed", map)
    lives = list(range(3))
    with pytest.raises(IndexError):  # in the first round of the refit
        fitted(tmp_path / "killed", dying)
    assert digest(fitted(tmp_path / "killed", map)) == digest(undisturbed)
