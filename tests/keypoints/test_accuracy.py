"""PCK by hand."""

import numpy as np
import pytest

from tasks.keypoints.accuracy import group_table, pck


def test_pck_counts_what_lies_within_a_fraction_of_the_box():
    truth = np.zeros((1, 133, 2))
    truth[0, 1] = (200, 100)  # the box is 200 x 100, its size 200
    found = truth.copy()
    found[0, :10, 0] += 15
    found[0, 10:17, 0] += 25
    counted = np.zeros((1, 133), bool)
    counted[0, :17] = True
    assert pck(found, truth, counted, within=0.1) == pytest.approx(10 / 17)
    assert pck(found, truth, counted, within=0.05) == 0
    table = group_table(found, truth, counted)
    assert set(table) == {"body", "wrists"} and table["body"]["count"] == 17
    assert table["body"]["median_px"] == 15 and table["wrists"]["pck10"] == 0.5
