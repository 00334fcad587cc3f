"""The network's parts against their definitions, and the exported file against the network."""

import numpy as np
import onnxruntime
import pytest
import torch

from tasks.keypoints.crop import INPUT_SIZE
from tasks.keypoints.network import FINE, SimccNet, WholeBodyNet, heatmap_targets, spatial_cross_entropy
from tasks.keypoints.onnx_file import write_onnx
from tasks.keypoints.simcc import decode

torch.set_num_threads(1)


def dense_target(keypoint: torch.Tensor, *, stride: int, σ: float) -> torch.Tensor:
    """The Gaussian heat-map written out cell by cell, plus the empty cell "not here"."""
    v, u = torch.meshgrid(*((torch.arange(n // stride) + 0.5) * stride for n in INPUT_SIZE[::-1]), indexing="ij")
    gauss = torch.exp(-((u - keypoint[0]) ** 2 + (v - keypoint[1]) ** 2) / (2 * σ**2)).flatten()
    return torch.cat([gauss / gauss.sum(), torch.zeros(1)])


@pytest.mark.parametrize(("head", "stride", "σ"), [(0, 4, 5.0), (1, 8, 6.0)])
def test_cross_entropy_equals_the_one_written_out(head, stride, σ):
    torch.manual_seed(0)
    cells = (192 // stride) * (256 // stride) + 1
    logits, keypoints = torch.randn(2, 3, cells), torch.rand(2, 3, 2) * 180 + 5
    error = spatial_cross_entropy(logits, keypoints, INPUT_SIZE, head=head)
    for b in range(2):
        for k in range(3):
            p = dense_target(keypoints[b, k], stride=stride, σ=σ)
            divergence = torch.nn.functional.kl_div(torch.log_softmax(logits[b, k], 0), p, reduction="sum")
            assert error[b, k].item() == pytest.approx(divergence.item(), rel=1e-4)


def test_cross_entropy_vanishes_for_the_target_itself_and_for_absent_points_in_their_cell():
    keypoint = torch.tensor([[[80.3, 120.9]]])
    logits = torch.log(dense_target(keypoint[0, 0], stride=4, σ=5.0) + 1e-30)[None, None]
    assert spatial_cross_entropy(logits, keypoint, INPUT_SIZE, head=0).item() == pytest.approx(0, abs=1e-3)
    absent = torch.full((1, 1, 64 * 48 + 1), -30.0)
    absent[..., -1] = 30
    outside = torch.tensor([[[-4.0, 120.0]]])
    assert spatial_cross_entropy(absent, outside, INPUT_SIZE, head=0).item() == pytest.approx(0, abs=1e-3)
    assert spatial_cross_entropy(absent, keypoint, INPUT_SIZE, head=0).item() > 10


class Known(torch.nn.Module):
    """Says with certainty where 133 points are."""

    def __init__(self, keypoints: torch.Tensor):
        super().__init__()
        heads = ((keypoints[:FINE], 4, 5.0), (keypoints[FINE:], 8, 6.0))
        self.logits = [
            torch.stack([dense_target(k, stride=stride, σ=σ) for k in part])[None].clamp_min(1e-12).log() for part, stride, σ in heads
        ]

    def forward(self, image):
        return tuple(self.logits)


def test_what_is_exported_says_where_the_heatmaps_peak():
    keypoints = torch.rand(133, 2, generator=torch.Generator().manual_seed(3)) * torch.tensor([150.0, 210.0]) + 20
    uv, score = decode(*(s[0].numpy() for s in SimccNet(Known(keypoints))(None)))
    np.testing.assert_allclose(uv, keypoints, atol=0.25)
    assert score.min() > 0.9


def test_targets_sum_to_one():
    columns, rows = heatmap_targets(torch.rand(1, 5, 2) * 190, INPUT_SIZE, head=1)
    assert columns.shape == (1, 5, 24) and rows.shape == (1, 5, 32)
    torch.testing.assert_close(columns.sum(-1), torch.ones(1, 5))


def test_exported_file_equals_the_network(tmp_path):
    torch.manual_seed(1)
    net = WholeBodyNet()
    for parameter in net.parameters():  # the file keeps large tensors in half precision
        parameter.data = parameter.data.half().float()
    net.eval()
    write_onnx(net, tmp_path / "net.onnx")
    images = torch.randn(3, 3, 256, 192)
    with torch.no_grad():
        expected = SimccNet(net)(images)
    found = onnxruntime.InferenceSession(str(tmp_path / "net.onnx")).run(["simcc_x", "simcc_y"], {"input": images.numpy()})
    for e, f, bins in zip(expected, found, (384, 512)):
        assert f.shape == (3, 133, bins)
        np.testing.assert_allclose(f, e.numpy(), atol=2e-5)
    assert (tmp_path / "net.onnx").stat().st_size < 8e6
    assert net.fine[1].out_channels == FINE


def test_smaller_crops_pass_through_the_same_network():
    fine, coarse = WholeBodyNet().eval()(torch.zeros(1, 3, 128, 96))
    assert fine.shape == (1, 23, 32 * 24 + 1) and coarse.shape == (1, 110, 16 * 12 + 1)
