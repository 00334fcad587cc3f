"""Weight transfer where the answer is known: a body's own surface, remeshed and puffed up like cloth.

`python -m tests.benchmarks.skinning` prints metric | value | target | holds; JSON=1 the same as JSON. The source is a tube with 55
joints in a row and weights that change over 15 cm, as at a shoulder; the target is another triangulation of the same tube, 4 mm
outside, with a band of 20 cm pushed out of reach so that it must be inpainted.
"""

import time

import numpy as np

from tasks.skinning.linear_blend import repose, unpose
from tasks.skinning.weight_transfer import transfer_weights
from tests.benchmarks.table import show
from tests.skinning.test_linear_blend import random_transforms
from tests.skinning.test_weight_transfer import cylinder

JOINTS = 55


def main() -> None:
    """Measure and print."""
    show(_rows())


def weights_along(vertices):
    """Bell-shaped weights of joints spaced evenly along y [V, joint]; rows sum to 1."""
    w = np.exp(-((vertices[:, 1:2] - np.linspace(0, 1, JOINTS)) ** 2) / (2 * 0.15**2))
    return w / w.sum(1, keepdims=True)


def _rows():
    body, body_faces = cylinder(100, 100)
    cloth, cloth_faces = cylinder(63, 63, radius=0.104, turn=0.02)
    away = np.abs(cloth[:, 1] - 0.5) < 0.1
    cloth[away] *= [1.8, 1, 1.8]
    start = time.process_time()
    skin = transfer_weights(body, body_faces, weights_along(body), cloth, cloth_faces)
    seconds = time.process_time() - start
    error = np.abs(skin.weights - weights_along(cloth)).sum(1) / 2
    yield f"CPU seconds, {len(body)} to {len(cloth)} vertices, {JOINTS} joints", seconds, "< 5", seconds < 5
    yield "share of vertices matched", skin.matched.mean(), "> 0.7", skin.matched.mean() > 0.7
    yield "weight on wrong joints, matched, worst", error[skin.matched].max(), "< 0.01", error[skin.matched].max() < 0.01
    inpainted = error[~skin.matched].mean()
    yield "weight on wrong joints, inpainted, mean", inpainted, "< 0.1", inpainted < 0.1
    T = random_transforms(np.random.default_rng(0), JOINTS, angle=0.5)
    back = unpose(repose(cloth, skin.weights, T), skin.weights, T)
    trip = np.abs(back.x_rest - cloth)[~back.squeezed].max()
    yield "unpose after repose, worst [m]", trip, "< 1e-9", trip < 1e-9


if __name__ == "__main__":
    main()
