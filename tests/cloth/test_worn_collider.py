"""The body as collider: light, whatever patch of its skin lies near the garment, and never nothing."""

import numpy as np
import pytest
import trimesh

from tasks.cloth.collider import LIMB
from tasks.cloth.worn_collider import FACES, REACH, worn_collider
from tasks.geometry.distances import closest_points
from tasks.geometry.faults import BadInput
from tests.simulator.scenes import sheet, sphere

NOBODY = np.zeros(0, np.int32)


def _worn(pinched: bool):
    """A patch held 5 mm above a ball of 20,480 triangles; where `pinched`, two triangles of skin are gone that have one corner in common and no side."""
    ball, faces = sphere(5, 0.2)
    x, own = sheet(5, 5, length=0.1, width=0.1)
    garment = np.column_stack([x[:, [0, 2]] - 0.05, np.full(len(x), 0.205)])
    if pinched:
        corner = np.argmin(np.linalg.norm(ball - [0.0, 0.0, 0.2], axis=1))
        ring = np.flatnonzero((faces == corner).any(1))
        first = ring[0]
        apart = [f for f in ring if len(np.intersect1d(faces[f], faces[first])) == 1]
        faces = np.delete(faces, [first, apart[0]], axis=0)
    return np.stack([ball, ball]), faces.astype(np.int32), np.stack([garment, garment]), own


@pytest.mark.parametrize("pinched", [False, True])
def test_a_fine_body_becomes_a_light_collider(pinched):
    body, faces, garment, own = _worn(pinched)
    fitted = worn_collider(body, faces, garment, own, fastened=NOBODY, noise=1e-3)
    assert 0.9 * FACES < len(fitted.faces) <= FACES
    assert closest_points(fitted.motion[0], body[0], faces).distance.max() < 1e-3
    near = np.linalg.norm(body[0] - garment[0].mean(0), axis=1) < REACH / 2
    assert closest_points(body[0][near], fitted.motion[0], fitted.faces).distance.max() < 2e-3


def _on_a_box(above: float):
    """A patch that far [m] above the middle of a box of twelve triangles, none of whose corners is near; twice."""
    box = trimesh.creation.box((0.8, 0.8, 0.4))
    x, own = sheet(5, 5, length=0.1, width=0.1)
    patch = np.column_stack([x[:, [0, 2]] - 0.05, np.full(len(x), 0.2 + above)])
    return np.stack([np.array(box.vertices)] * 2), np.array(box.faces, np.int32), np.stack([patch] * 2), own


def test_a_face_that_the_garment_lies_on_is_near_however_long_its_edges():
    body, faces, garment, own = _on_a_box(0.005)
    found = worn_collider(body, faces, garment, own, fastened=NOBODY, noise=1e-3)
    assert len(found.faces) == 2
    np.testing.assert_allclose(closest_points(garment[0], found.motion[0], found.faces).distance, 0.005)


@pytest.mark.parametrize(("above", "said"), [(1.3 * REACH, "none of it lies within 0.25 m"), (-0.8 * LIMB, "more than 30 mm inside")])
def test_a_collider_of_which_nothing_is_left_is_refused(above, said):
    with pytest.raises(BadInput, match=said):
        worn_collider(*_on_a_box(above), fastened=NOBODY, noise=1e-3)
