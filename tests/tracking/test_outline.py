"""The outline term: zero on the outline, outward when the surface has shrunk, silent about rims inside the figure."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from tasks.geometry.cameras import project
from tasks.geometry.rotations import matrix_from_axis_angle
from tasks.tracking import outline
from tasks.tracking.mask_distance import signed_distance
from tasks.tracking.settings import Settings
from tasks.tracking.visibility import buffers
from tests.tracking.skirt import cone, ring

CAMERAS = ring(4, 128)
SIZE = 1.0


def picture(x, faces, k):
    """The mask of a mesh as a fourth channel."""
    return np.dstack([buffers(CAMERAS.subset([k]), x, faces)[0].face >= 0] * 4).astype(np.float32)


def rim_of(x, faces, scale=1.0):
    small = CAMERAS.scaled(scale)
    return outline.rim(buffers(small, x, faces), small)


def distances(x, faces, rim):
    """Signed distance [Q] px of rim points of the surface x to its own outline, by SciPy's interpolation."""
    found = []
    for k in range(len(CAMERAS)):
        own = rim.camera == k
        points = (rim.barycentric[own, :, None] * x[faces[rim.face[own]]]).sum(1) + rim.beyond[own] @ CAMERAS.R[k]
        uv = project(CAMERAS.subset([k]), points)[0][0] - 0.5
        found.append(map_coordinates(signed_distance(picture(x, faces, k)[..., 3] > 0.5).astype(float), uv.T[::-1], order=1))
    return np.concatenate(found)


def derivatives(x, faces, drawn, rim=None):
    """Energy per rim point and gradient by vertex of surface x against the masks of surface `drawn`; the rim is its own, or given."""
    F = len(faces)
    energy, g, H = np.zeros(F), np.zeros((F, 3, 3)), np.zeros((F, 3, 3, 3, 3))
    masks = outline.outlines([picture(drawn, faces, k) for k in range(len(CAMERAS))])
    rim = rim_of(x, faces) if rim is None else rim
    outline.add_derivatives(x, faces, rim, outlines=masks, cameras=CAMERAS, sigma=SIZE, energy=energy, gradient=g, hessian=H)
    total = np.zeros_like(x)
    np.add.at(total, faces.ravel(), g.reshape(-1, 3))
    return energy.sum() / len(rim.face), total


@pytest.fixture(scope="module")
def skirt():
    return cone(40, 31)


@pytest.mark.parametrize("scale", [1.0, Settings().buffer_scale, 0.25])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_a_surface_in_its_own_outline_is_at_rest(skirt, scale, angle):
    """Buffers of any size, flanks in any direction: rim points are on the outline on average, and it costs to be 1 % wider or narrower."""
    x, faces = skirt
    lean = x @ matrix_from_axis_angle(angle * CAMERAS.R[0, 2]).T  # across the first camera's picture
    rim = rim_of(lean, faces, scale)
    d = distances(lean, faces, rim)
    assert abs(d.mean()) < 3 * d.std() / np.sqrt(len(d)) < 0.2
    shrunken, true, swollen = (derivatives(lean * [s, 1, s], faces, lean, rim)[0] for s in (0.99, 1.0, 1.01))
    assert true < min(shrunken, swollen)


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
