"""The bundled whole-body keypoint network: a residual pyramid with two spatial-softmax heads, spoken in SimCC.

    P_k(cell) = softmax over the cells of a heat-map and one extra cell "not in this picture"       (one per keypoint k)
    simcc_x,k(b) = Σ_cells P_k(cell) · exp(−(b/2 − u_cell)² / 2σ²) / peak,   b = 0 … 2·width − 1       (same for y, with rows)

The body and the feet are read at 1/4 of the input size, face and hands at 1/8. The softmax over space with cross-entropy to a Gaussian is
that of Sun et al. 2018 (integral regression) without its expectation; the marginals are smoothed to half-pixel bins so that the network
has the two outputs of SimCC (Li et al. 2022) and one decoder reads this model and RTMPose/DWPose files alike. Bin b stands for column
b/2 counted from the CENTRE of column 0, as in RTMPose.

Training may run on smaller crops of the same shape, which is quicker and carries over; the exported model reads 192 x 256.

Limits: one person per crop; left and right are told apart by appearance alone.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from tasks.keypoints.crop import INPUT_SIZE

KEYPOINTS = 133
FINE = 23  # keypoints 0-22 (body and feet) come from the fine head, the other 110 from the coarse one
STRIDES = (4, 8)  # [px] per heat-map cell: fine, coarse
TARGET_σ = (5.0, 6.0)  # [px] width of the Gaussian that a heat-map is trained towards: fine, coarse
SMOOTHING_σ = (3.6, 7.2)  # [px] width of the kernel that turns cells into half-pixel bins


class WholeBodyNet(nn.Module):
    """image [batch,3,h,w] normalised RGB -> (fine logits [batch,23,h/4·w/4+1], coarse logits [batch,110,h/8·w/8+1]); last = "not here"."""

    def __init__(self, widths: tuple[int, ...] = (16, 32, 64, 128, 192), blocks: tuple[int, ...] = (1, 2, 3, 2), pyramid: int = 64):
        super().__init__()
        self.stem = _convolution(3, widths[0], stride=2)
        self.levels = nn.ModuleList(
            nn.Sequential(_convolution(before, after, stride=2), *[_Residual(after) for _ in range(count)])
            for before, after, count in zip(widths, widths[1:], blocks)
        )
        self.lateral = nn.ModuleList(nn.Conv2d(width, pyramid, 1) for width in widths[1:])
        self.coarse = nn.Sequential(_convolution(pyramid, 96), nn.Conv2d(96, KEYPOINTS - FINE, 1))
        self.fine = nn.Sequential(_convolution(pyramid, 64), nn.Conv2d(64, FINE, 1))
        self.absent = nn.Linear(widths[-1], KEYPOINTS)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of both heads."""
        features = []
        x = self.stem(image)
        for level in self.levels:
            x = level(x)
            features.append(x)
        absent = self.absent(x.mean((2, 3)))
        x = self.lateral[3](features[3])
        for level in (2, 1):
            x = functional.interpolate(x, scale_factor=2.0, mode="nearest") + self.lateral[level](features[level])
        coarse = self.coarse(x)
        fine = self.fine(functional.interpolate(x, scale_factor=2.0, mode="nearest") + self.lateral[0](features[0]))
        return (
            torch.cat([fine.flatten(2), absent[:, :FINE, None]], 2),
            torch.cat([coarse.flatten(2), absent[:, FINE:, None]], 2),
        )


class SimccNet(nn.Module):
    """What is exported: image [batch,3,h,w] -> simcc_x [batch,133,2w], simcc_y [batch,133,2h], 1 at the peak of a sure keypoint."""

    def __init__(self, net: WholeBodyNet, size: tuple[int, int] = INPUT_SIZE):
        super().__init__()
        self.net, self.size = net, size
        for head, (stride, target_σ, σ) in enumerate(zip(STRIDES, TARGET_σ, SMOOTHING_σ)):
            for axis, length in zip("xy", size):
                self.register_buffer(f"{axis}{head}", bins_from_cells(length, stride=stride, target_σ=target_σ, σ=σ), persistent=False)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """SimCC outputs."""
        x, y = [], []
        for head, logits in enumerate(self.net(image)):
            width, height = (length // STRIDES[head] for length in self.size)
            probability = torch.softmax(logits, 2)[:, :, :-1].unflatten(2, (height, width))
            x.append(probability.sum(2) @ getattr(self, f"x{head}"))
            y.append(probability.sum(3) @ getattr(self, f"y{head}"))
        return torch.cat(x, 1), torch.cat(y, 1)


def bins_from_cells(length: int, *, stride: int, target_σ: float, σ: float) -> Tensor:
    """Matrix [cell, bin] that smooths a marginal of `length`/`stride` cells to 2·`length` half-pixel bins.

    Scaled so that the marginal of a perfect prediction, a Gaussian of width `target_σ`, peaks at 1.
    """
    cell = torch.arange(length // stride) * stride + (stride - 1) / 2  # centres, counted from the centre of pixel 0
    bin_ = torch.arange(2 * length) / 2
    kernel = torch.exp(-((cell[:, None] - bin_[None]) ** 2) / (2 * σ**2))
    perfect = torch.softmax(-((cell - cell[len(cell) // 2]) ** 2) / (2 * target_σ**2), 0)
    return kernel / (perfect @ kernel).max()


def heatmap_targets(keypoints: Tensor, size: tuple[int, int], *, head: int) -> tuple[Tensor, Tensor]:
    """Separable Gaussian targets of one head for keypoints [batch,point,2] in half-pixel-centre px of a crop of `size` (width, height).

    Returns (columns [batch,point,width/stride], rows [batch,point,height/stride]), each summing to one: the target heat-map is their
    outer product.
    """
    stride, σ = STRIDES[head], TARGET_σ[head]
    gauss = []
    for axis, length in enumerate(size):
        cell = (torch.arange(length // stride) + 0.5) * stride
        gauss.append(torch.softmax(-((cell - keypoints[..., axis, None]) ** 2) / (2 * σ**2), -1))
    return gauss[0], gauss[1]


def spatial_cross_entropy(logits: Tensor, keypoints: Tensor, size: tuple[int, int], *, head: int) -> Tensor:
    """Cross-entropy [batch,point] of `logits` [batch,point,cell+1] to Gaussians at `keypoints` [batch,point,2], or to the cell
    "not here" for keypoints outside the crop of `size`. The entropy of the target is subtracted, so that 0 is perfect."""
    inside = ((keypoints >= 0) & (keypoints < torch.tensor(size))).all(-1)
    column, row = heatmap_targets(keypoints, size, head=head)
    logits = logits.float()
    grid = logits[..., :-1].unflatten(-1, (row.shape[-1], column.shape[-1]))
    expected = ((grid @ column[..., None])[..., 0] * row).sum(-1)  # <target, logits> without forming the target
    floor = -(column * column.clamp_min(1e-12).log()).sum(-1) - (row * row.clamp_min(1e-12).log()).sum(-1)
    log_z = torch.logsumexp(logits, -1)
    return torch.where(inside, log_z - expected - floor, log_z - logits[..., -1])


class _Residual(nn.Module):
    def __init__(self, width: int):
        super().__init__()
        self.first = _convolution(width, width)
        self.second = nn.Sequential(nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.second(self.first(x)))


def _convolution(before: int, after: int, *, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU(inplace=True))
