"""Calibrated video: a Qualisys or OpenCV calibration and one video per camera, named after it.

The videos must show the same number of frames at the same rate and be synchronised; nothing here measures whether they are. A video of
another size than its calibration is accepted when it is a letterboxed or merely scaled picture (see `letterbox`), with a warning; K then
follows the video. There are no masks. Every k-th frame has a k-th of the videos' rate. World: turned to y up.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tasks.capture.calibration_opencv import read_opencv
from tasks.capture.calibration_qualisys import read_qualisys
from tasks.capture.frame_rate import rate_of, rate_warnings, spacing_faults
from tasks.capture.letterbox import find_letterbox
from tasks.capture.recording import Recording, to_y_up, validate_name
from tasks.capture.video import Video
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault, refuse

ENDINGS = (".mp4", ".mov", ".mkv", ".webm", ".avi")
SAMPLES = 5  # frames looked at for black bands; the last one also proves that the video is whole


def read_calibrated_video(
    calibration: Path, *, folder: Path | None = None, cameras: Sequence[str] | None = None, frames: Sequence[int] | None = None
) -> Recording:
    """`calibration` is a .qca.txt, or OpenCV's JSON, YAML or folder of them; `folder` holds the videos (default: beside it).

    `cameras` (names) and `frames` (numbers) select; default all. Raises BadInput with every fault of the selection.
    """
    calibration = Path(calibration)
    folder = Path(folder) if folder is not None else calibration.parent
    rig, up = (read_qualisys(calibration), "z") if calibration.name.endswith((".qca.txt", ".xml")) else read_opencv(calibration)
    videos, faults = _open_videos(folder, rig.names if cameras is None else cameras, rig.names)
    refuse(faults)
    rig = rig.subset([rig.names.index(n) for n in videos])
    faults = _rate_faults(videos)
    numbers = np.array(sorted(set(frames)) if frames is not None else range(min(v.frame_count for v in videos.values())), np.int64)
    last = min(v.frame_count for v in videos.values()) - 1
    if not len(numbers) or numbers[0] < 0 or numbers[-1] > last:
        refuse([*faults, Fault("frames", f"{numbers[:1]} to {numbers[-1:]} are asked for", f"The videos hold frames 0 to {last}.")])
    rig, size_faults, warnings = _follow_videos(rig, list(videos.values()), numbers)
    refuse([*faults, *spacing_faults(numbers, str(folder)), *size_faults])
    first = next(iter(videos.values()))
    return Recording(
        root=folder,
        cameras=to_y_up(rig, up),
        frames=numbers,
        fps=rate_of(numbers, first.fps),
        up=up,
        rgb=tuple(v.path.name for v in videos.values()),
        warnings=(*warnings, *rate_warnings(numbers, first.fps), "The recording has no masks."),
    )


def _open_videos(folder: Path, wanted: Sequence[str], known: Sequence[str]) -> tuple[dict[str, Video], list[Fault]]:
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in ENDINGS) if folder.is_dir() else []
    videos, faults = {}, []
    for name in wanted:
        found = [p for p in files if p.stem == name]
        try:
            if name not in known:
                faults.append(Fault(str(folder), f"the calibration has no camera {name!r}", f"It has: {', '.join(known)}."))
            elif len(found) != 1 or name in videos:
                faults.append(
                    Fault(
                        str(folder), f"camera {validate_name(name, 'camera')} has {len(found)} videos", "Name one video after each camera."
                    )
                )
            else:
                videos[name] = Video(found[0])
        except BadInput as bad:
            faults += bad.faults
    if tuple(wanted) == tuple(known):
        remedy = "Name it after a camera of the calibration, or move it away."
        faults += [Fault(str(p), "belongs to no camera of the calibration", remedy) for p in files if p.stem not in known]
    return videos, faults


def _rate_faults(videos: dict[str, Video]) -> list[Fault]:
    faults = []
    for what, of, slack in (("frames", lambda v: v.frame_count, 0), ("frames per second", lambda v: v.fps, 1e-3)):
        found = {n: of(v) for n, v in videos.items()}
        if max(found.values()) - min(found.values()) > slack:
            listed = ", ".join(f"{n} {value:g}" for n, value in found.items())
            faults.append(Fault("videos", f"differ in {what}: {listed}", "Cut them to the same frames at the same rate."))
    return faults


def _follow_videos(rig: Cameras, videos: list[Video], numbers: np.ndarray) -> tuple[Cameras, list[Fault], list[str]]:
    """The rig with sizes and K of the videos; a fault where a size has no explanation or a sampled frame cannot be decoded."""
    K, faults, warnings = rig.K.copy(), [], []
    for k, video in enumerate(videos):
        try:
            chosen = np.unique(np.linspace(0, len(numbers) - 1, SAMPLES).astype(int))
            pictures = np.stack([video.read(int(numbers[i])) for i in chosen])
        except BadInput as bad:
            faults += bad.faults
            continue
        calibrated = tuple(rig.size[k].tolist())
        if video.size == calibrated:
            continue
        box, sizes = find_letterbox(pictures, calibrated), "{} x {} against {} x {} in the calibration".format(*video.size, *calibrated)
        if box is None:
            faults.append(Fault(str(video.path), f"shows {sizes}, without the black bands of a letterbox", "Give the uncropped video."))
            continue
        K[k] = box.lens(rig.K[k])
        bands = "{} + {} black columns and {} + {} black rows".format(*box.bands)
        warnings.append(f"{video.path.name} shows {sizes}, {bands}: read as scaled by {box.scale:.5f} and centred.")
    return replace(rig, K=K, size=np.array([v.size for v in videos], np.int32)), faults, warnings
