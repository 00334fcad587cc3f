"""Training of the bundled keypoint network on rendered people.

    loss = Σ_k w_k CE(P_k, Gaussian at u_k) / Σ_k w_k,     AdamW, one-cycle learning rate, exponential mean of the weights

w is 1 for body and feet, less for the many points of face and hands, less again where a point is hidden: nobody can see it, but its
place follows from the rest of the body (Lin et al., COCO: v = 1). The batch runs in bfloat16 (fast on CPUs with AMX, exact enough here).
The exponential mean of the weights is what is exported.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from tasks.keypoints.augmentation import augmented, normalised
from tasks.keypoints.network import FINE, INPUT_SIZE, WholeBodyNet, spatial_cross_entropy
from tasks.keypoints.onnx_file import write_onnx
from tasks.keypoints.pictures import Shard, read_shard

WEIGHT = np.array([1.0] * FINE + [0.15] * 68 + [0.25] * 42, np.float32)
WARM_UP = 150  # steps
HIDDEN = np.array([0.5] * FINE + [0.3] * 110, np.float32)  # factor on the weight of a point that cannot be seen


@dataclass(frozen=True)
class Progress:
    """One line of the training log: step, share of the budget spent, loss (running mean), pictures seen, seconds."""

    step: int
    spent: float
    loss: float
    pictures: int
    seconds: float


def train(
    out_path: Path,
    pictures: Path,
    flip: np.ndarray,
    *,
    minutes: float = 60.0,
    batch: int = 32,
    rate: float = 2e-3,
    size: tuple[int, int] = INPUT_SIZE,
    seed: int = 0,
    resume: Path | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Path:
    """Train on the shards in the folder `pictures` for `minutes` of wall-clock time and write the model to `out_path` (.onnx).

    A checkpoint (.pt beside `out_path`) and the model are rewritten every three minutes; `resume` starts from the weights of such a
    checkpoint with a fresh schedule; `size` (width, height) of the crops may be smaller at first. `flip` [133] names each keypoint's
    mirror partner. Shards may still arrive while this runs.
    """
    torch.manual_seed(seed)
    net = WholeBodyNet().to(memory_format=torch.channels_last)
    if resume is not None:
        net.load_state_dict(torch.load(resume, weights_only=True))
    mean = torch.optim.swa_utils.AveragedModel(net, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.998), use_buffers=True)
    optimiser = torch.optim.AdamW(net.parameters(), lr=rate, weight_decay=0.02)
    start = saved = time.monotonic()
    running = 0.0
    for step, (crops, keypoints, weight) in enumerate(batches(pictures, flip, batch=batch, size=size, seed=seed)):
        spent = (time.monotonic() - start) / (60 * minutes)
        if spent >= 1:
            break
        for group in optimiser.param_groups:
            group["lr"] = rate * min(1.0, (step + 1) / WARM_UP) * (0.5 + 0.5 * np.cos(np.pi * spent)) + 1e-6
        loss = batch_loss(net, crops, keypoints, weight)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        mean.update_parameters(net)
        running = loss.item() if step == 0 else 0.98 * running + 0.02 * loss.item()
        if step % 50 == 0:
            report(Progress(step, spent, running, (step + 1) * batch, time.monotonic() - start))
        if time.monotonic() - saved > 180:
            saved = time.monotonic()
            _save(mean.module, out_path)
    return _save(mean.module, out_path)


def batch_loss(net: WholeBodyNet, crops: Tensor, keypoints: Tensor, weight: Tensor) -> Tensor:
    """Weighted mean cross-entropy of normalised crops [batch,3,height,width], keypoints [batch,133,2] px, weights [batch,133]."""
    size = (crops.shape[3], crops.shape[2])
    with torch.autocast("cpu", torch.bfloat16):
        fine, coarse = net(crops.to(memory_format=torch.channels_last))
    error = torch.cat(
        [
            spatial_cross_entropy(fine, keypoints[:, :FINE], size, head=0),
            spatial_cross_entropy(coarse, keypoints[:, FINE:], size, head=1),
        ],
        1,
    )
    return (weight * error).sum() / weight.sum()


def batches(folder: Path, flip: np.ndarray, *, batch: int, size: tuple[int, int], seed: int) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """Endless augmented batches: crops [batch,3,height,width], keypoints [batch,133,2] px, weights [batch,133].

    One epoch after another over whatever shards there are at its start.
    """
    random = np.random.default_rng(seed)
    shards: dict[Path, Shard] = {}
    while True:
        for path in sorted(folder.glob("shard_????.npz")):
            if path not in shards:
                shards[path] = read_shard(path)
        every = [(shard, k) for shard in shards.values() for k in range(len(shard))]
        order = random.permutation(len(every))
        for first in range(0, len(order) - batch + 1, batch):
            yield _batch([every[k] for k in order[first : first + batch]], flip, size, random)


def _batch(chosen: list[tuple[Shard, int]], flip: np.ndarray, size: tuple[int, int], random: np.random.Generator):
    crops, keypoints, weights = [], [], []
    for shard, k in chosen:
        picture = shard.picture(k)
        crop, uv, visible = augmented(picture.image, picture.keypoints, picture.visible, flip, random, size=size)
        crops.append(crop)
        keypoints.append(uv)
        weights.append(WEIGHT * np.where(visible, 1, HIDDEN))
    return (
        torch.from_numpy(normalised(np.stack(crops))),
        torch.from_numpy(np.stack(keypoints).astype(np.float32)),
        torch.from_numpy(np.stack(weights).astype(np.float32)),
    )


def _save(net: nn.Module, out_path: Path) -> Path:
    torch.save(net.state_dict(), out_path.with_suffix(".pt"))
    write_onnx(net, out_path)
    return out_path
