"""`physavatar keypoints`: train the detector that is bundled, or one of your own, on rendered people."""

import json
import sys
from pathlib import Path

from cyclopts import App

app = App(name="keypoints", help="The keypoint detector: train.")


@app.command
def train(out: Path, *, folder: Path = Path("keypoint_pictures"), images: int = 5000, minutes: float = 60.0, seed: int = 0) -> int:
    """Render random people, then train on them for some minutes and write an ONNX model.

    Args:
        out: The model to write.
        folder: Rendered training pictures; what is missing is rendered first.
        images: How many pictures.
        minutes: Wall-clock time of the training.
        seed: Of pictures and weights.
    """
    from tasks.body.model import BodyModel
    from tasks.body.stage import demo_body
    from tasks.keypoints.training_run import train_detector

    def report(row: object) -> None:
        sys.stderr.write(f"{row}\n")

    written = train_detector(BodyModel.load(demo_body()), out, folder=folder, images=images, minutes=minutes, seed=seed, report=report)
    sys.stdout.write(json.dumps(str(written)) + "\n")
    return 0
