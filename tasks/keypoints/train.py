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
from torch import Tensor, distributed, nn

from tasks.keypoints.augmentation import augmented
from tasks.keypoints.crop import INPUT_SIZE, normalised
from tasks.keypoints.network import FINE, WholeBodyNet, spatial_cross_entropy
from tasks.keypoints.onnx_file import write_onnx
from tasks.keypoints.pictures import Shard, read_shard

WEIGHT = np.array([1.0] * FINE + [0.15] * 68 + [0.25] * 42, np.float32)
WARM_UP = 150  # steps
MEMORY = 0.998  # per step, of the exponential mean
SAVE_EVERY = 180.0  # [s]
MEET_EVERY = 16  # steps after which the members of a team average their weights (local SGD, Stich 2019)
HIDDEN = np.array([0.5] * FINE + [0.3] * 110, np.float32)  # factor on the weight of a point that cannot be seen


@dataclass(frozen=True)
class Progress:
    """One line of the training log: step, share of the budget spent, loss (running mean), pictures seen, seconds."""

    step: int
    spent: float
    loss: float
    pictures: int
    seconds: float


@dataclass(frozen=True)
class Team:
    """Processes that train together: this one's rank, how many there are, and a file through which they meet (new for every run)."""

    rank: int
    size: int
    meeting: Path


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
    team: Team | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Path:
    """Train on the shards in the folder `pictures` for `minutes` of wall-clock time and write the model to `out_path` (.onnx).

    A checkpoint (.pt beside `out_path`) and the model are rewritten every three minutes; `resume` starts from the weights of such a
    checkpoint with a fresh schedule; `size` (width, height) of the crops may be smaller at first. `flip` [133] names each keypoint's
    mirror partner. Shards may still arrive while this runs. Processes of a `team` call this with the same arguments, average their
    weights now and then, and the first of them writes.
    """
    torch.manual_seed(seed)
    average = _joined(team) if team else lambda net, spent: spent
    net = WholeBodyNet().to(memory_format=torch.channels_last)
    if resume is not None:
        net.load_state_dict(torch.load(resume, weights_only=True))
    mean = torch.optim.swa_utils.AveragedModel(net, avg_fn=_leaky_mean, use_buffers=True)
    optimiser = torch.optim.AdamW(net.parameters(), lr=rate, weight_decay=0.02)
    writes = team is None or team.rank == 0
    start = saved = time.monotonic()
    running = spent = 0.0
    for step, (crops, keypoints, weight) in enumerate(
        batches(pictures, flip, batch=batch, size=size, seed=seed + 1000 * (team.rank if team else 0))
    ):
        if spent >= 1:
            break
        for group in optimiser.param_groups:
            group["lr"] = rate * min(1.0, (step + 1) / WARM_UP) * (0.5 + 0.5 * np.cos(np.pi * spent)) + 1e-6
        loss = batch_loss(net, crops, keypoints, weight)
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        if step % MEET_EVERY == 0:
            spent = average(net, (time.monotonic() - start) / (60 * minutes))
        mean.update_parameters(net)
        running = loss.item() if step == 0 else 0.98 * running + 0.02 * loss.item()
        if step % 50 == 0:
            report(Progress(step, spent, running, (step + 1) * batch * (team.size if team else 1), time.monotonic() - start))
        if time.monotonic() - saved > SAVE_EVERY and writes:
            saved = time.monotonic()
            _save(mean.module, out_path, size)
    if writes:
        _save(mean.module, out_path, size)
    return out_path


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


def _leaky_mean(mean: Tensor, new: Tensor, count: Tensor) -> Tensor:
    """Exponential mean with a short memory at first, so that the untrained weights are forgotten at once."""
    return torch.lerp(mean, new, 1 - min(MEMORY, (1 + count.item()) / (10 + count.item()))) if mean.is_floating_point() else new


def _joined(team: Team) -> Callable[[WholeBodyNet, float], float]:
    """Meet the others; returns what replaces the weights, and the share of the budget spent, by their means over the team."""
    distributed.init_process_group("gloo", init_method=f"file://{team.meeting}", rank=team.rank, world_size=team.size)

    def average(net: WholeBodyNet, spent: float) -> float:
        weights = [p.data for p in net.parameters()]
        flat = torch.cat([*(w.reshape(-1) for w in weights), torch.tensor([spent])]) / team.size
        distributed.all_reduce(flat)
        for weight, mean in zip(weights, flat.split([*(w.numel() for w in weights), 1])):
            weight.copy_(mean.view_as(weight))
        return flat[-1].item()

    return average


def _save(net: nn.Module, out_path: Path, size: tuple[int, int]) -> None:
    torch.save(net.state_dict(), out_path.with_suffix(".pt"))
    write_onnx(net, out_path, size=size)
