"""The door of registration: what it takes for skin, and the model it insists on."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.geometry.faults import BadInput
from tasks.registration.stage import RegistrationParameters, _skin, registration
from tests.storage_schemas.examples import examples


def tracked(*, parts, of_face):
    """Two triangles that share an edge, each of a part."""
    faces = np.array([[0, 1, 2], [1, 3, 2]], np.int32)
    x, seen = np.zeros((1, 4, 3), np.float32), np.ones((1, 4), bool)
    return SimpleNamespace(part_names=parts, part_of_face=np.array(of_face), faces=faces, vertices=x, seen=seen)


def test_skin_is_the_body_less_what_it_shares_with_garments():
    np.testing.assert_array_equal(_skin(tracked(parts=("body", "skirt"), of_face=(0, 1))).index, [0])


def test_a_surface_in_one_piece_wears_its_clothes_and_is_no_skin():
    assert len(_skin(tracked(parts=("body",), of_face=(0, 0))).index) == 0


def test_another_model_than_the_fitted_one_is_refused_with_the_remedy(tmp_path):
    known, other = examples(), tmp_path / "other.npz"
    other.write_bytes(b"another model")
    with pytest.raises(BadInput, match=r"other\.npz.*fitted with another model.*registration\.model"):
        registration.function(
            None, known["capture"], known["keypoints"], known["body"], known["tracking"], RegistrationParameters(model=other)
        )
