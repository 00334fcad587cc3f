"""What the computation alone does: laws by their tangents are what simulating with them would say, and every way is integrated out."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.cloth.numerics import LINEAR, WAYS, corrected, offsets, otherwise, with_tangents
from tasks.cloth.shooting import Job, follow
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Window, predict
from tests.cloth.test_windows import swung

WINDOW = Window(0, 2, 5)


@pytest.fixture(scope="module")
def scene():
    model, recording, x, v = swung(12)
    return model, recording, States(x, v, "converged")


@pytest.mark.parametrize("way", LINEAR, ids=lambda way: way.name)
def test_the_tangent_of_another_law_is_what_simulating_with_it_changes(scene, way):
    model, recording, states = scene
    tangent = predict(with_tangents(model), recording, WINDOW, states, columns=True).columns[way.name]
    own, other = (predict(m, recording, WINDOW, states).x[1:] for m in (model, otherwise(model, way)))
    changed = other - own
    assert np.linalg.norm(tangent - changed) < 0.02 * np.linalg.norm(changed) and np.abs(changed).max() > 1e-7


def test_every_way_is_a_column_and_none_is_left_when_they_are_integrated_out(scene):
    model, recording, states = scene
    job = Job(with_tangents(model), recording, WINDOW, states, smooth_modes(model.subject.cloth, 4), columns=True)
    plain = follow(job)
    found = follow(replace(job, offsets=offsets(job, plain.prediction.x)))
    assert set(WAYS) - {"numerics_contact"} <= set(found.normals.names)  # nothing is touched
    assert not set(WAYS) & set(corrected(found.normals).names)
