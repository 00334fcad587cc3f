"""The body as collider: light, whatever patch of its skin lies near the garment."""

import numpy as np
import pytest

from tasks.cloth.collider import FACES, REACH, fitted_collider
from tasks.geometry.distances import closest_points
from tests.simulator.scenes import sheet, sphere


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
    fitted = fitted_collider(body, faces, garment, own, fastened=np.zeros(0, np.int32))
    assert 0.9 * FACES < len(fitted.faces) <= FACES
    assert closest_points(fitted.motion[0], body[0], faces).distance.max() < 1e-3
    near = np.linalg.norm(body[0] - garment[0].mean(0), axis=1) < REACH / 2
    assert closest_points(body[0][near], fitted.motion[0], fitted.faces).distance.max() < 2e-3
