"""`physavatar keypoints`: train the detector that is bundled, or one of your own, on rendered people."""

import json
import sys
from pathlib import Path

from cyclopts import App

app = App(name="keypoints", help="The keypoint detector: train.")


@app.command
def train(out: Path, *, pictures: Path = Path("keypoint_pictures"), shards: int = 60, minutes: float = 60.0, seed: int = 0, resume: Path | None = None) -> int:
    """Render random people, then train on them for some minutes and write an ONNX model.

    Parameters
    ----------
    out: The model to write.
    pictures: Folder of rendered training pictures; what is missing is rendered first.
    shards: How many files of pictures.
    minutes: Wall-clock time of the training.
    seed: Of pictures and weights.
    resume: A checkpoint (.pt) to start from.
    """
    from tasks.body.model import BodyModel
    from tasks.body.stage import demo_body
    from tasks.body.wholebody import FLIP
    from tasks.keypoints.pictures import write_shards
    from tasks.keypoints.renders import Studio
    from tasks.keypoints.train import train as fit

    studio = Studio(BodyModel.load(demo_body()), shapes=10, expressions=10)
    write_shards(studio, pictures, range(shards), seed=seed)
    written = fit(out, pictures, FLIP, minutes=minutes, seed=seed, resume=resume, report=lambda row: sys.stderr.write(f"{row}\n"))
    sys.stdout.write(json.dumps(str(written)) + "\n")
    return 0
