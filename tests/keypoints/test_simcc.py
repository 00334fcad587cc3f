"""Peaks of SimCC outputs: where a known distribution says they are, in this project's pixel convention."""

import numpy as np
import pytest
import torch

from tasks.body.wholebody import FLIP
from tasks.keypoints.crop import INPUT_SIZE
from tasks.keypoints.network import FINE, STRIDES, SMOOTHING_σ, TARGET_σ, bins_from_cells, heatmap_targets
from tasks.keypoints.simcc import decode, unflip


def gaussians(u: np.ndarray, side: int, *, split: float, σ: float) -> np.ndarray:
    """SimCC rows [point, split·side] as RTMPose trains them: bin b is column b/split from the centre of column 0, which is 0.5 here."""
    b = np.arange(int(split * side)) / split + 0.5
    return np.exp(-((b - u[:, None]) ** 2) / (2 * σ**2))


@pytest.mark.parametrize("split", [1.0, 2.0, 4.0])
def test_peak_of_a_gaussian_is_found_to_a_hundredth_of_a_pixel(split):
    truth = np.random.default_rng(0).uniform(5, 180, (200, 2))
    uv, score = decode(gaussians(truth[:, 0], 192, split=split, σ=4), gaussians(truth[:, 1], 256, split=split, σ=4), split=split)
    np.testing.assert_allclose(uv, truth, atol=0.01)
    np.testing.assert_allclose(score, 1, atol=0.01)


def test_peak_at_the_border_stays_there():
    row = np.zeros((1, 384))
    row[0, 0] = 1
    assert decode(row, row)[0][0, 0] == 0.5


def test_score_is_the_worse_of_the_two_axes():
    sure, unsure = gaussians(np.array([50.0]), 192, split=2, σ=3), 0.2 * gaussians(np.array([60.0]), 256, split=2, σ=3)
    assert decode(sure, unsure)[1][0] == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize("head", [0, 1])
def test_what_the_network_is_trained_towards_decodes_to_the_truth(head):
    """Targets of training, through the smoothing of the exported graph, through the decoder: a quarter of a pixel at worst."""
    truth = np.random.default_rng(1).uniform(20, 170, (64, 2))
    columns, rows = heatmap_targets(torch.tensor(truth[None], dtype=torch.float32), INPUT_SIZE, head=head)
    bins = [bins_from_cells(n, stride=STRIDES[head], target_σ=TARGET_σ[head], σ=SMOOTHING_σ[head]) for n in INPUT_SIZE]
    uv, score = decode((columns[0] @ bins[0]).numpy(), (rows[0] @ bins[1]).numpy())
    np.testing.assert_allclose(uv, truth, atol=0.25)
    assert score.min() > 0.9 and score.max() < 1.1
    assert FINE == 23


def test_unflip_undoes_mirroring():
    truth = np.random.default_rng(2).uniform(20, 170, (133, 2))
    mirrored = np.column_stack([192 - truth[:, 0], truth[:, 1]])[FLIP]
    x, y = (gaussians(mirrored[:, axis], side, split=2, σ=4) for axis, side in enumerate((192, 256)))
    uv, _ = decode(*unflip(x, y, FLIP))
    np.testing.assert_allclose(uv, truth, atol=0.01)
    wrong, _ = decode(*unflip(x, y, np.arange(133)))  # without the table left stays right
    assert np.abs(wrong - truth).max() > 10


def test_flip_table_is_an_involution_that_keeps_the_midline():
    np.testing.assert_array_equal(FLIP[FLIP], np.arange(133))
    assert FLIP[0] == 0 and FLIP[5] == 6 and FLIP[9] == 10 and FLIP[17] == 20
    assert (FLIP[91:112] >= 112).all()
