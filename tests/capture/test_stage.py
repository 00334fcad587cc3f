"""The door of capture: which layout a folder has."""

import pytest

from tasks.capture.stage import CaptureParameters, read_recording
from tasks.geometry.faults import BadInput


@pytest.mark.parametrize("layout", ["auto", "video"])
def test_of_several_calibrations_none_is_taken(tmp_path, layout):
    for name in ("monday.qca.txt", "tuesday.qca.txt", "calibration.json"):
        (tmp_path / name).write_text("")
    with pytest.raises(BadInput, match=r"several calibrations: calibration\.json, monday\.qca\.txt, tuesday\.qca\.txt"):
        read_recording(CaptureParameters(recording=tmp_path, layout=layout))
