"""A sequence in ActorsHQ's layout, written from pictures at hand."""

import numpy as np
from PIL import Image

from tasks.capture.calibration_actorshq import write_calibration_csv


def write_pictures(folder, cameras, images, masks=None):
    """images[frame][camera] uint8 and masks[frame][camera] bool below `folder`, which is returned."""
    scale = folder / "1x"
    for kind, end, pictures in (("rgb", "jpg", images), ("mask", "png", masks)):
        for t, of_cameras in enumerate(pictures or ()):
            for name, picture in zip(cameras.names, of_cameras, strict=True):
                path = scale / f"{kind}s/{name}/{name}_{kind}{t:06d}.{end}"
                path.parent.mkdir(parents=True, exist_ok=True)
                Image.fromarray(picture if kind == "rgb" else 255 * picture.astype(np.uint8)).save(path, quality=95)
    write_calibration_csv(scale / "calibration.csv", cameras)
    return folder
