"""The body as collider: light, whatever patch of its skin lies near the garment."""

import numpy as np
import pytest

from tasks.cloth.collider import DEVIATIONS, FACES, FURTHER, REACH, deepest_poke, fitted_collider
from tasks.geometry.distances import closest_points
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
    fitted = fitted_collider(body, faces, garment, own, fastened=NOBODY, noise=1e-3)
    assert 0.9 * FACES < len(fitted.faces) <= FACES
    assert closest_points(fitted.motion[0], body[0], faces).distance.max() < 1e-3
    near = np.linalg.norm(body[0] - garment[0].mean(0), axis=1) < REACH / 2
    assert closest_points(body[0][near], fitted.motion[0], fitted.faces).distance.max() < 2e-3


def _sunk(depths):
    """A patch seen that deep [m] in a ball, frame by frame, and the collider where a millimetre is noise."""
    ball, faces = sphere(3, 0.1)
    x, own = sheet(5, 5, length=0.05, width=0.05)
    flat = np.column_stack([x[:, [0, 2]] - 0.025, np.zeros(len(x))])
    on = flat + np.sqrt(0.1**2 - np.sum(flat**2, 1))[:, None] * [0, 0, 1.0]
    garment = np.stack([on * (1 - d / 0.1) for d in depths])
    body = np.stack([ball] * len(depths))
    return body, garment, fitted_collider(body, faces.astype(np.int32), garment, own, fastened=NOBODY, noise=1e-3)


def test_a_body_does_not_give_way_to_what_noise_explains():
    body, _, fitted = _sunk([0.0, 0.0025, -0.01])
    assert not fitted.drawn_in.any()
    np.testing.assert_array_equal(fitted.motion, body)


def test_a_body_gives_way_to_the_rest_in_that_frame_and_by_halves_in_those_around():
    _, garment, fitted = _sunk([0.0, 0.0, 0.013, 0.0, 0.0, 0.0])
    depth = fitted.drawn_in
    lack = 0.013 - DEVIATIONS * 1e-3
    assert lack < depth[2].max() < 1.6 * FURTHER * lack
    np.testing.assert_allclose(depth, depth[2] * 0.5 ** np.abs(np.arange(6) - 2)[:, None], atol=1e-12)
    assert deepest_poke(fitted.motion[2:3], fitted.faces, garment[2:3]) < 1.05 * DEVIATIONS * 1e-3


def test_the_least_is_drawn_in_that_frees_a_sample():
    """Cloth 10 mm below one face of a plane, near a corner of it: d = ℓ b/‖b‖², and nothing around it moves."""
    plane, faces = sheet(5, 5, length=0.2, width=0.2)
    plane = plane[:, [0, 2, 1]]
    face = faces[12]
    if np.cross(plane[face[1]] - plane[face[0]], plane[face[2]] - plane[face[0]])[2] < 0:
        faces = faces[:, ::-1].copy()
    b = np.array([0.8, 0.1, 0.1])
    cloth = b @ plane[face] - [0, 0, 0.01] + 1e-6 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    own = np.array([[0, 1, 2]], np.int32)
    fitted = fitted_collider(plane[None], faces.astype(np.int32), cloth[None], own, fastened=NOBODY, noise=1e-3)
    np.testing.assert_array_equal(np.flatnonzero(fitted.drawn_in[0]), np.sort(face))
    np.testing.assert_allclose(fitted.drawn_in[0, face], FURTHER * 0.007 * b / np.sum(b**2), rtol=2e-3)
