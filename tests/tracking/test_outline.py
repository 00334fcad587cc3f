"""The outline term: zero on the outline, outward when the surface has shrunk, silent about rims inside the figure."""

import numpy as np
import pytest

from tasks.geometry.rasterise import rasterise
from tasks.tracking import outline
from tests.tracking.skirt import cone, ring

CAMERAS = ring(4, 128)
SIZE = 1.0


def picture(x, faces, k):
    """The mask of a mesh as a fourth channel."""
    covered = rasterise(CAMERAS.K[k], CAMERAS.R[k], CAMERAS.t[k], CAMERAS.size[k], x, faces).face >= 0
    return np.dstack([covered] * 4).astype(np.float32)


def rim_of(x, faces):
    return outline.rim([rasterise(CAMERAS.K[k], CAMERAS.R[k], CAMERAS.t[k], CAMERAS.size[k], x, faces) for k in range(len(CAMERAS))])


def derivatives(x, faces, drawn):
    """Energy and gradient by vertex of surface x against the masks of surface `drawn`."""
    F = len(faces)
    energy, g, H = np.zeros(F), np.zeros((F, 3, 3)), np.zeros((F, 3, 3, 3, 3))
    masks = outline.outlines([picture(drawn, faces, k) for k in range(len(CAMERAS))])
    rim = rim_of(x, faces)
    outline.add_derivatives(x, faces, rim, outlines=masks, cameras=CAMERAS, sigma=SIZE, energy=energy, gradient=g, hessian=H)
    total = np.zeros_like(x)
    np.add.at(total, faces.ravel(), g.reshape(-1, 3))
    return energy.sum() / len(rim.face), total


@pytest.fixture(scope="module")
def skirt():
    return cone(40, 31)


def test_a_surface_in_its_own_outline_is_at_rest(skirt):
    """Rim pixels are inside by half a pixel or so: d² ≈ ¼–½."""
    x, faces = skirt
    assert derivatives(x, faces, x)[0] < 0.5 * np.log(1.5)


@pytest.mark.parametrize(("scale", "sign"), [(0.93, -1), (1.07, 1)])
def test_a_shrunken_surface_is_pulled_out_and_a_swollen_one_in(skirt, scale, sign):
    x, faces = skirt
    resized = x * [scale, 1, scale]
    energy, g = derivatives(resized, faces, x)
    radial = np.einsum("vi,vi->v", g, resized * [1, 0, 1])
    moved = np.abs(radial) > 1e-6
    assert energy > 3 * derivatives(x, faces, x)[0]
    assert (np.sign(radial[moved]) == sign).mean() > 0.9


def test_rims_within_the_figure_are_not_in_the_sum(skirt):
    """A small patch before the skirt has a rim that no mask shows."""
    x, faces = skirt
    towards = CAMERAS.centres()[0] * [1, 0, 1]
    towards /= np.linalg.norm(towards)
    side = np.cross(towards, [0, 1, 0])
    patch = 0.6 * towards + [0, 0.5, 0] + 0.05 * np.array([side, -side, [0, 1, 0]])
    both, together = np.concatenate([x, patch]), np.concatenate([faces, [[len(x), len(x) + 1, len(x) + 2]]]).astype(np.int32)
    rim = rim_of(both, together)
    assert not ((rim.camera == 0) & (rim.face == len(faces))).any()
    assert ((rim.camera == 0) & (rim.face < len(faces))).sum() > 50


def test_signed_distance_of_a_half_plane():
    image = np.zeros((20, 30, 4), np.float32)
    image[:, 12:, 3] = 1
    d = outline.outlines([image]).distance.reshape(20, 30)
    assert d[5] == pytest.approx(np.arange(30) + 0.5 - 12)
