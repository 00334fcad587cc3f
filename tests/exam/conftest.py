"""A folder that holds one case of two vertices, with its truth sealed."""

import numpy as np
import pytest

from flows.exam_folder import Folder
from tasks.exam.generator.recording import Made
from tasks.exam.generator.strata import Question

QUESTION = Question(7, "single", {"air_lift": 4.0}, ("air_lift", "air_wind"), "", "curtain", ("sway", "turn", "ball"), (0, 7))


@pytest.fixture
def folder(tmp_path):
    x = np.zeros((3, 2, 3))
    arrays = {"vertices": x, "observed": np.ones((3, 2), bool), "boundary": np.zeros(0, np.int32)}
    truth = {
        "question": {"number": 7, "stratum": "outside", "twist": "", "withheld": ["air_lift", "air_wind"]},
        "causes": {"air_lift": {"strength": 5.0, "unit": "m2/kg"}},
        "admissible": {"air_lift": ["air_lift"]},
        "multiple": 4.0,
        "floor_mm": 1.0,
        "local": False,
    }
    made = Folder(tmp_path)
    made.write(QUESTION, Made((arrays, arrays), arrays, arrays, truth))
    return made
