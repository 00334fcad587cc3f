"""Paint: threads keep their size in metres, noise has the length it was asked for, faces are painted in front and hair on top."""

import numpy as np
import pytest

from tasks.capture.demo.complexion import HAIR, LIPS, complexion
from tasks.capture.demo.plan import FACE, keypoints133
from tasks.capture.demo.textures import BRIGHTEST, DARKEST, SKIRT, THREAD, Design, noise, woven

PLAIN = Design((0.3, 0.3, 0.3), ((0.9, 0.0, 0.0),), motif=0.01, spacing=10.0, yarn_contrast=0.3)


@pytest.mark.parametrize("width", [300, 600])
def test_threads_keep_their_size_whatever_the_resolution(width) -> None:
    """The strongest frequency along u is that of a thread or of two, which cross over and under."""
    texture = woven(np.array([0.3, 0.1]), PLAIN, width=width, rng=np.random.default_rng(0))[..., 1]
    assert texture.shape == (width // 3, width)
    spectrum = np.abs(np.fft.rfft(texture - texture.mean(1, keepdims=True), axis=1)).mean(0)
    frequency = np.fft.rfftfreq(width, 0.3 / width)
    fast = frequency > 40  # wear is slower than that
    strongest = frequency[fast][spectrum[fast].argmax()]
    assert min(abs(strongest * THREAD - 0.5), abs(strongest * THREAD - 1)) < 0.03


def test_prints_lie_on_the_ground_colour_within_albedo_bounds() -> None:
    texture = woven(np.array([0.5, 0.3]), SKIRT, width=500, rng=np.random.default_rng(0))
    assert texture.min() >= np.float32(DARKEST) and texture.max() <= np.float32(BRIGHTEST)
    blue = texture[..., 2] > 1.5 * texture[..., 0]
    assert 0.6 < blue.mean() < 0.95
    assert (woven(np.array([0.5, 0.3]), SKIRT, width=500, rng=np.random.default_rng(0)) == texture).all()


def test_noise_has_unit_variance_and_its_length() -> None:
    x = noise((400, 400), 10.0, np.random.default_rng(0))
    assert x.std() == pytest.approx(1)
    near, far = ((x[:, :-d] * x[:, d:]).mean() for d in (5, 60))
    assert near > 0.8 and abs(far) < 0.2


def test_hair_is_on_top_and_lips_are_in_front(body_model) -> None:
    rest = body_model.pose(np.zeros(1), np.zeros(1), np.zeros((55, 3)), np.zeros(3))
    face = keypoints133(body_model, rest.vertices, rest.joints)[FACE]
    colours = complexion(rest.vertices, rest.joints, body_model.weights, face, np.random.default_rng(0))
    head = rest.vertices[body_model.weights[:, 15] > 0.5]
    dark = colours.mean(1) < HAIR.mean() * 2.2
    crown, nose = head[head[:, 1].argmax()], face[13]
    assert dark[np.linalg.norm(rest.vertices - crown, axis=1).argmin()]
    assert not dark[np.linalg.norm(rest.vertices - nose, axis=1).argmin()]
    red = (colours[:, 0] > 2.8 * colours[:, 1]) & (np.abs(colours[:, 0] - LIPS[0]) < 0.3)
    lips = rest.vertices[red]
    assert len(lips) > 20 and np.percentile(np.linalg.norm(lips - face[31:51].mean(0), axis=1), 95) < 0.04  # the rest is freckles
