"""A fabric that was bent for want of a cause is found again with the cause in the model."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.base_parameters import with_fabric
from tasks.cloth.base_refit import BaseFit
from tasks.cloth.nuisances import Prior
from tasks.cloth.start_state import states
from tasks.cloth.windows import windows
from tasks.effects.library import library
from tasks.gap.afresh import afresh
from tasks.gap.gathered import Gathered
from tasks.gap.hypotheses import Fitted
from tests.cloth.test_windows import FABRIC, FPS, swung

NOISE, SCALE = 1e-3, -0.04


def test_fabric_and_scale_come_to_rest_together():
    truth, recording, x, v = swung(31, noise=NOISE)
    scale = library()["fabric_rest_scale"]
    shrunk = replace(truth, effects=(scale,), strengths={scale.name: np.array([SCALE])})
    y = np.stack([f.x for f in shrunk.run(recording.motion, x[0], v[0])])
    recording = replace(recording, observed=y + NOISE * np.random.default_rng(1).standard_normal(y.shape))
    data = Gathered((recording,), (states(truth, recording.motion, recording.observed, NOISE),), tuple(windows([recording], FPS, 0.33)))
    h = Fitted((scale,), np.ones(2), np.eye(2), dict.fromkeys(scale.columns, SCALE / 2), np.eye(1), np.zeros(1), ())
    bent = with_fabric(truth, replace(FABRIC, membrane=FABRIC.membrane / 14, bending=500.0))
    base = BaseFit(bent, np.eye(2), Prior(NOISE, 0.03), (), (), "converged")
    first = with_fabric(truth, replace(FABRIC, membrane=FABRIC.membrane / 2, bending=FABRIC.bending / 2))
    found, model = afresh(SimpleNamespace(base=base, evidence=()), first, data, h, map)
    assert not found.base.any() and list(found.strengths.values()) == [pytest.approx(SCALE, rel=0.05)]
    off, was = (np.log([m.subject.fabric.membrane / FABRIC.membrane, m.subject.fabric.bending / FABRIC.bending]) for m in (model, bent))
    assert (np.abs(off) < 0.2 * np.abs(was)).all()
