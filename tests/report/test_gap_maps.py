"""Maps of quantities on the cloth."""

import numpy as np
import pytest

from tasks.report.gap_figures import maps
from tests.simulator.scenes import sheet


@pytest.mark.parametrize(("values", "top"), [(0.0, 1.0), (np.nan, 1.0), (3e-4, 3e-4)])
def test_a_quantity_that_is_zero_everywhere_has_a_scale_that_can_be_read(values, top):
    x, faces = sheet(3, 3, length=0.3, width=0.3)
    found = maps(x, faces, None, {"nameless forcing": (np.full(len(x), values), "rms m/s²")})
    scales = [axes.get_ylim() for axes in found.axes if axes.get_ylabel() == "rms m/s²"]
    assert scales == [pytest.approx((0, top))]
