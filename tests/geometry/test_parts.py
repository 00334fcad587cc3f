"""Names of parts: what is skin, and what a garment may be called."""

import numpy as np
import pytest

from tasks.geometry.parts import part_faults


def test_names_of_any_language_are_names():
    names = ["body", "skirt", "Ärmel", "A\u0308rmel", "स्कर्ट", "裙子", "rig:top.001", "left_sleeve-2", "..."]
    assert part_faults(np.array([*names, *names]), "t.obj") == []


@pytest.mark.parametrize("name", ["../../etc", "upper/skirt", "upper\\skirt", ".", "..", "top(1)", "a\0b", "a\nb", "R\ufffdcke"])
def test_names_that_can_be_no_files_are_refused(name):
    (fault,) = part_faults(np.array(["body", name, name]), "t.obj")
    assert (fault.where, repr(name) in fault.what) == ("t.obj", True)
    assert "letters" in fault.remedy
