"""Garments that were weighed."""

import numpy as np
import pytest

from tasks.cloth.garment import weighed
from tasks.simulator import Cloth, Fabric
from tasks.simulator.fabric import THICKNESS

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
START = Fabric(320.0, 4.0, 60.0)


def test_garments_weighed_together_are_of_one_density():
    cloths = [Cloth(scale * SQUARE, FACES, np.empty(0, np.int32)) for scale in (1.0, 0.5)]  # 1.25 m²
    found = weighed(START, cloths, 0.25)
    assert found.density == pytest.approx(0.2 / THICKNESS) and found.membrane == START.membrane
    assert sum(found.density * THICKNESS * c.rest_areas.sum() for c in cloths) == pytest.approx(0.25)


def test_what_nobody_weighed_keeps_its_density():
    assert weighed(START, [], None) is START
