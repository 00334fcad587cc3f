"""From a body model to a detector: render people, train on half-size crops, then on full-size ones.

Two thirds of the time go to crops of 96 x 128 px, whose steps cost a third and whose features carry over (Tan & Le 2021, progressive
learning); the rest to 192 x 256, which is what the exported model reads.
Limits: the budget is wall-clock time, so the result depends on the machine; seeds fix the pictures and the first weights, not the outcome.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tasks.body.model import BodyModel
from tasks.body.wholebody import FLIP
from tasks.keypoints.crop import INPUT_SIZE
from tasks.keypoints.pictures import SHARD, write_shards
from tasks.keypoints.renders import Studio
from tasks.keypoints.train import Progress, train

HALF_SIZE = (INPUT_SIZE[0] // 2, INPUT_SIZE[1] // 2)
SHARE_AT_HALF_SIZE = 2 / 3
FULL_SIZE_RATE = 7e-4  # the second part starts from good weights


def train_detector(
    body: BodyModel,
    out_path: Path,
    *,
    folder: Path,
    images: int = 5000,
    minutes: float = 60.0,
    seed: int = 0,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Path:
    """Write `out_path` (.onnx) after `minutes` of training on `images` pictures of the body, rendered into `folder` (13 kB each, kept).

    Pictures already in `folder` are used as they are. Rendering is outside of `minutes`: about 0.06 s of one core per picture.
    """
    studio = Studio(body, shapes=body.shape_directions.shape[2], expressions=body.expression_directions.shape[2])
    write_shards(studio, folder, range(-(-images // SHARD)), seed=seed + 1)
    first = out_path.with_name(f"{out_path.stem}_half{out_path.suffix}")
    train(first, folder, FLIP, minutes=SHARE_AT_HALF_SIZE * minutes, batch=24, size=HALF_SIZE, seed=seed, report=report)
    return train(
        out_path,
        folder,
        FLIP,
        minutes=(1 - SHARE_AT_HALF_SIZE) * minutes,
        batch=24,
        rate=FULL_SIZE_RATE,
        seed=seed + 1,
        resume=first.with_suffix(".pt"),
        report=report,
    )
