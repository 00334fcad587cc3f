"""A tube on a swinging cylinder: the end that rides with it is fastened, the end that lags is not."""

import numpy as np
import pytest

from tasks.cloth.boundary import fastened_nodes
from tasks.cloth.garment import garments
from tasks.geometry.rotations import matrix_from_axis_angle
from tests.simulator.scenes import sphere


def tube(radius: float, top: float, bottom: float, rings: int, around: int = 24):
    angle = np.arange(around) * 2 * np.pi / around
    y = np.linspace(top, bottom, rings)
    x = np.stack(
        [radius * np.cos(angle)[None] + 0 * y[:, None], y[:, None] + 0 * angle[None], radius * np.sin(angle)[None] + 0 * y[:, None]], -1
    )
    i = np.arange(rings * around).reshape(rings, around)
    a, b, c, d = i[:-1], np.roll(i, -1, 1)[:-1], np.roll(i, -1, 1)[1:], i[1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return x.reshape(-1, 3), faces.astype(np.int32)


def swing(frames: int = 20, *, lag_m: float = 0.03):
    body, body_faces = tube(0.10, 0.05, -0.5, 12)
    cloth, faces = tube(0.11, 0.0, -0.45, 10)
    R = matrix_from_axis_angle(np.stack([0.3 * np.sin(np.linspace(0, 6, frames)), np.zeros(frames), np.zeros(frames)], 1))
    x = np.einsum("tij,nj->tni", R, cloth)
    x[..., 0] += lag_m * np.sin(np.linspace(0, 6, frames) + 1)[:, None] * (-cloth[:, 1] / 0.45)[None]  # nothing at the top, all at the hem
    return x + np.random.default_rng(0).normal(scale=1e-4, size=x.shape), faces, np.einsum("tij,nj->tni", R, body), body_faces


def test_the_waist_is_fastened_and_the_hem_is_not():
    x, faces, body, body_faces = swing()
    found = fastened_nodes(x, faces, body, body_faces)
    assert found.nodes.tolist() == list(range(24))
    assert [held for _, _, held in found.borders] == [True, False]


def test_a_garment_that_rides_with_the_body_is_fastened_at_both_ends():
    found = fastened_nodes(*swing(lag_m=0.0))  # negative control: no lag anywhere
    assert [held for _, _, held in found.borders] == [True, True]


def test_every_node_is_judged_by_the_frames_in_which_it_is_known():
    """In every frame but the first another node of the hem is out of sight: no two frames show the same border."""
    x, faces, body, body_faces = swing(lag_m=0.008)
    for t in range(1, len(x)):
        x[t, -t] = np.nan
    found = fastened_nodes(x, faces, body, body_faces)
    assert found.nodes.tolist() == list(range(24)) and found.unjudged == 0
    assert [held for _, _, held in found.borders] == [True, False]


@pytest.mark.parametrize(("known", "unjudged"), [(2, 1), (3, 0)])
def test_of_a_border_known_in_fewer_than_three_frames_nothing_is_said(known, unjudged):
    x, faces, body, body_faces = swing(lag_m=0.008)
    x[known:, -24:] = np.nan
    found = fastened_nodes(x, faces, body, body_faces)
    assert found.unjudged == unjudged
    assert np.isnan(found.relative_motion_m[-24:]).all() == bool(unjudged)
    assert found.borders[0][2] and not (unjudged and found.borders[1][2])


def test_a_garment_without_a_border_is_fastened_nowhere():
    ball, faces = sphere(1, 0.2)
    _, _, body, body_faces = swing(4)
    found = fastened_nodes(np.stack([ball] * 4), faces.astype(np.int32), body, body_faces)
    assert found.nodes.tolist() == [] and found.borders == ()


def test_garments_are_cut_out_with_their_own_numbers():
    x, faces, body, body_faces = swing(3)
    vertices = np.concatenate([body, x], 1)
    all_faces = np.concatenate([body_faces, faces + body.shape[1]])
    part = np.array(["body"] * len(body_faces) + ["skirt"] * len(faces))
    (skirt,) = garments(vertices, all_faces, all_faces, part, np.ones(vertices.shape[:2], bool), np.full(vertices.shape[:2], 1e-3))
    assert skirt.name == "skirt"
    np.testing.assert_array_equal(skirt.observed, x)
    np.testing.assert_array_equal(skirt.faces, faces)
