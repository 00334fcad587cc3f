"""The simulated strip against its closed form, and real knits that are explained only by two causes together."""

import numpy as np
import pytest

from tests.real import knit_strips
from tests.real.knit_strips import Knit, curve, fitted, folder, measured_ratio, read, rms, stiffness_ratio

recorded = pytest.mark.skipif(not folder().is_dir(), reason=f"the recordings are not at {folder()}; set PHYSAVATAR_REAL_DATA")


@pytest.mark.parametrize(("along", "sign"), [("x", 1), ("y", -1)])
def test_without_poissons_ratio_the_strip_is_one_dimensional(along, sign):
    """P = λ Eₐt (λ² − 1)/2 · (1 + c e^a ε²), ε = (λ² − 1)/2: nothing pulls in at the sides."""
    knit = Knit(orthotropy=0.4, stiffening=3.0, poisson=0.0)
    e = np.array([0.1, 0.3, 0.5])
    ε, k = e + e**2 / 2, np.exp(sign * 0.4)
    np.testing.assert_allclose(curve(knit, 0.1, 0.05, along, 0.5)([0.25, 0.5]), _one_dimensional(np.array([0.25, 0.5]), k, 3.0), rtol=2e-3)
    assert np.all(np.diff(_one_dimensional(e, k, 3.0) / ε) > 0)


def _one_dimensional(e, k, c):
    ε = e + e**2 / 2
    return (1 + e) * k * ε * (1 + c * k * ε**2)


def test_clamps_stiffen_a_short_wide_strip_by_poissons_ratio():
    wide, long = (curve(Knit(poisson=0.4), w, g, "x", 0.2)(0.01) for w, g in ((0.4, 0.05), (0.05, 0.4)))
    assert 1.08 < wide / long < 1 / (1 - 0.4**2) + 0.01


@recorded
def test_the_split_and_the_units():
    pull = read("cotton_stockinette", "y")
    assert pull.width == pytest.approx(0.09754) and pull.gauge == pytest.approx(0.0469, abs=3e-4)
    assert len(pull.train[0]) == 1200 and len(pull.test[0]) == 800
    assert pull.train[0].max() == pytest.approx(0.22, abs=0.01)


@recorded
def test_the_aspect_ratio_does_not_explain_the_two_directions():
    for fabric in knit_strips.FABRICS:
        assert stiffness_ratio(fabric, Knit(poisson=0.4)) == pytest.approx(1.0, abs=0.1)
    assert measured_ratio("acrylic_rib") < 0.4


@recorded
@pytest.mark.slow
def test_two_causes_together_explain_what_neither_does():
    error = {
        name: rms(fitted("acrylic_rib", orthotropic=o, stiffening=s), "acrylic_rib", "test")
        for name, o, s in (("none", False, False), ("a", True, False), ("c", False, True), ("both", True, True))
    }
    assert error["a"] < 0.5 * error["none"] and error["c"] > 0.9 * error["none"]
    assert error["both"] < 0.5 * error["a"]
