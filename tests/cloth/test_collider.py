"""A collider gives way to the garment where it was seen too deep inside, and nowhere else."""

import numpy as np

from tasks.cloth.collider import DEEPEST, DEVIATIONS, FURTHER, deepest_poke, fitted_collider
from tests.simulator.scenes import sheet, sphere

NOBODY = np.zeros(0, np.int32)


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


def test_where_the_garment_was_not_seen_nothing_gives_way():
    """The deepest frame, of which half the vertices are unknown; and one of which all are."""
    body, garment, _ = _sunk([0.0, 0.013, 0.013])
    half = garment.copy()
    half[1, garment[1, :, 0] > 0] = half[2] = np.nan
    ball, faces = sphere(3, 0.1)
    own = sheet(5, 5, length=0.05, width=0.05)[1]
    fitted = fitted_collider(body, faces.astype(np.int32), half, own, fastened=NOBODY, noise=1e-3)
    deep = np.flatnonzero(fitted.drawn_in[1])
    assert len(deep) and (ball[deep, 0] < 0.02).all()
    np.testing.assert_allclose(fitted.drawn_in[2], fitted.drawn_in[1] / 2)
    assert deepest_poke(body, faces, half) == deepest_poke(body[1:2], faces, garment[1:2, garment[1, :, 0] <= 0]) > 0.012


def test_all_of_it_stays_however_deep_the_garment_was_seen():
    """41 mm inside: it gives way by `DEEPEST`, and no face is left out."""
    body, _, fitted = _sunk([0.041, 0.041])
    assert len(fitted.faces) == len(sphere(3, 0.1)[1]) and fitted.motion.shape == body.shape
    assert fitted.drawn_in.max() == DEEPEST
