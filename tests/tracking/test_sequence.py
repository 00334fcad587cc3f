"""A small skirt tracked whole: it follows, it resumes to the bit, threads change nothing, bad input is refused with all faults."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from tasks.geometry.distances import closest_points
from tasks.geometry.faults import BadInput
from tasks.tracking.sequence import track_sequence
from tasks.tracking.settings import Settings
from tests.tracking.skirt import skirt

SETTINGS = Settings(blur_px=(4.0, 2.0, 1.0), steps=(5, 5, 6))
WEIGHTLESS = replace(SETTINGS, sigma_inertia=1.0)  # without the pull towards constant velocity what is tested stands alone
PIXEL = 0.0087  # [m] on the cloth


@pytest.fixture(scope="module")
def small():
    return skirt(columns=24, rows=15, frames=4, size=160, views=6)


def track(s, **more):
    return track_sequence(
        s.image, s.mask, s.cameras, s.vertices[0], s.faces, frames=more.pop("frames", 4), settings=more.pop("settings", SETTINGS), **more
    )


@pytest.fixture(scope="module")
def tracked(small):
    return track(small)


def rmse(x, y):
    return np.sqrt(((x - y) ** 2).sum(-1).mean())


def test_it_follows_the_cloth(small, tracked):
    """Pixels are 8.7 mm here; the cloth moves by two of them per frame."""
    held = rmse(small.vertices[0], small.vertices[3])
    assert held > 0.02
    assert rmse(tracked.vertices[3], small.vertices[3]) < 0.006
    assert tracked.seen[3].mean() > 0.9
    assert np.array_equal(tracked.vertices[0], small.vertices[0]) and tracked.ending[0] == "template"


def test_without_iso_the_lengths_go(small, tracked):
    """The tiny form of the ablation; test_ablation.py has the full one."""
    free = track(small, settings=Settings(blur_px=SETTINGS.blur_px, steps=SETTINGS.steps, sigma_strain=1e6))
    assert rmse(free.vertices[3], small.vertices[3]) > 1.5 * rmse(tracked.vertices[3], small.vertices[3])


def test_other_images_are_not_followed(small, tracked):
    """Negative control: with frame 0's images for all frames the surface stays."""
    still = track_sequence(
        lambda t, k: small.image(0, k),
        lambda t, k: small.mask(0, k),
        small.cameras,
        small.vertices[0],
        small.faces,
        frames=3,
        settings=SETTINGS,
    )
    assert rmse(still.vertices[2], small.vertices[0]) < PIXEL / 2 < 0.015 < rmse(tracked.vertices[2], small.vertices[0])


def test_a_surface_that_stands_still_is_not_pushed_out(small):
    """At the hem, on average over the circle; colours alone leave 0.22 px."""
    x = small.vertices[0]
    still = track_sequence(
        lambda t, k: small.image(0, k), lambda t, k: small.mask(0, k), small.cameras, x, small.faces, frames=2, settings=SETTINGS
    )
    hem = x[-24:] * [1, 0, 1]
    outward = ((still.vertices[1] - x)[-24:] * hem).sum(1) / np.linalg.norm(hem, axis=1)
    assert abs(outward.mean()) < 0.25 * PIXEL


def test_cloth_inside_skin_is_said_to_be_as_far_off(small):
    """Its colours are right whichever of the two is wrong. A skirt inside a body 3 % wider, and the same body 3 % narrower."""
    x, part = small.vertices[0], np.repeat(["skirt", "body"], len(small.faces))
    faces = np.concatenate([small.faces, small.faces + len(x)])
    inside, outside = (
        track_sequence(small.image, small.mask, small.cameras, np.concatenate([x, x * [w, 1, w]]), faces, frames=1, part=part)
        for w in (1.03, 0.97)
    )
    seen, deep = inside.seen[0][: len(x)], closest_points(x, x * [1.03, 1, 1.03], small.faces).distance
    told, before = inside.noise_m[0][: len(x)][seen], outside.noise_m[0][: len(x)][seen]
    assert seen.mean() > 0.9 and np.median(deep) > 0.006
    assert np.median(told / np.sqrt(before**2 + deep[seen] ** 2 / 3)) == pytest.approx(1, abs=0.1)


def test_resuming_gives_the_same_bits(small, tracked):
    states = {}
    track(small, frames=3, on_frame=lambda found, state: states.update({found.frame: state}))
    rest = track(small, start=states[1])
    assert rest.first == 2
    assert np.array_equal(rest.vertices, tracked.vertices[2:]) and np.array_equal(rest.noise_m, tracked.noise_m[2:])
    assert np.array_equal(rest.seen, tracked.seen[2:]) and rest.ending == tracked.ending[2:]


def test_nothing_left_to_do(small, tracked):
    done = track(small, start=tracked.state)
    assert len(done.vertices) == 0 and done.state is tracked.state


def test_threads_change_no_bit(small, tracked):
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = track(small, frames=2)
    finally:
        numba.set_num_threads(threads)
    assert np.array_equal(alone.vertices, tracked.vertices[:2]) and np.array_equal(alone.noise_m, tracked.noise_m[:2])


def test_most_errors_lie_within_two_standard_deviations(small, tracked):
    z = (tracked.vertices[1:] - small.vertices[1:4])[tracked.seen[1:]] / tracked.noise_m[1:][tracked.seen[1:]][:, None]
    assert 0.85 < (np.abs(z) < 2).mean() <= 0.999


def test_hidden_vertices_are_not_seen_and_are_noisier(small):
    """A box around the upper half hides it in every frame; ISO and normals carry it."""
    corners = np.array([[x, y, z] for x in (-0.6, 0.6) for y in (0.5, 1.4) for z in (-0.6, 0.6)])
    box = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]]
    )
    hidden = track(small, frames=2, occluder=(np.repeat(corners[None], 2, 0), box), settings=WEIGHTLESS)
    top = small.vertices[0][:, 1] > 0.75
    assert not hidden.seen[1][top].any()
    assert np.median(hidden.noise_m[1][top]) > 1.3 * np.median(hidden.noise_m[1][~top & hidden.seen[1]])


def test_a_prediction_carries_what_no_camera_sees(small):
    """With blind cameras skin goes where the body model says, and cloth, unpredicted, stays."""
    part = np.full(len(small.faces), "skirt")
    skin = np.zeros(len(small.vertices[0]), bool)
    skin[small.faces[:200].ravel()] = True
    part[:200] = "body"
    prediction = np.where(skin[:, None], small.vertices[:3], np.nan)
    found = track_sequence(
        lambda t, k: np.zeros_like(small.image(t, k)),
        None,
        small.cameras,
        small.vertices[0],
        small.faces,
        frames=3,
        part=part,
        prediction=prediction,
        settings=WEIGHTLESS,
    )
    assert rmse(found.vertices[2][skin], small.vertices[2][skin]) < 0.3 * rmse(small.vertices[0][skin], small.vertices[2][skin])


def test_all_faults_are_told_at_once(small):
    x = small.vertices[0].copy()
    x[3] = np.nan
    with pytest.raises(BadInput) as raised:
        track_sequence(
            small.image,
            small.mask,
            small.cameras,
            x,
            small.faces,
            frames=4,
            part=np.array(["a"]),
            prediction=np.zeros((2, 5, 3)),
            occluder=(np.zeros((1, 3, 3)), small.faces),
        )
    assert {fault.where for fault in raised.value.faults} == {"template", "part", "prediction", "occluder"}
