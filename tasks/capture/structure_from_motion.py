"""A rig calibrated from one picture per camera of a scene at rest, by incremental structure from motion (COLMAP; Schönberger & Frahm 2016).

COLMAP runs in a process of its own: its library carries a second libpng that crashes OpenCV when it is loaded first. Pictures must
overlap, with less than about 30° between neighbours, and show texture; people may stand in them, but black backgrounds leave nothing to
match.

Limits: without `lenses`, each camera's focal length and k1 are estimated from its one picture, the principal point staying in the middle.
Scale comes from one known distance between two cameras; nothing in pictures can give it.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tasks.capture.rig_calibration import RigCalibration, baseline_faults, levelled, scaled_to
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault, refuse

WORKER = "tasks.capture.structure_from_motion_worker"
MIN_CAMERAS = 3


def calibrate_from_pictures(
    pictures: dict[str, NDArray[np.uint8]],
    *,
    baseline: tuple[str, str, float],
    lenses: Cameras | None = None,
    threads: int = 2,
    timeout_s: float = 3600.0,
) -> RigCalibration:
    """The rig from pictures [height, width, 3] by camera name; `baseline` is (camera, camera, metres between their centres).

    `lenses` keeps K and distortion (k3 = 0) of cameras of the same names. Raises BadInput where cameras cannot be placed.
    """
    refuse(
        [] if len(pictures) >= MIN_CAMERAS else [Fault("pictures", f"there are {len(pictures)}", f"Give {MIN_CAMERAS} cameras or more.")]
    )
    refuse(baseline_faults(baseline, list(pictures)))
    with tempfile.TemporaryDirectory(prefix="structure_from_motion_") as folder:
        request = {"threads": threads, "lenses": _lens_parameters(lenses, list(pictures))}
        for name, picture in pictures.items():
            Image.fromarray(picture).save(Path(folder) / f"{name}.png", compress_level=1)
        (Path(folder) / "request.json").write_text(json.dumps(request))
        answer = _run(Path(folder), timeout_s)
    lost = [n for n in pictures if n not in answer]
    refuse(
        [
            Fault(n, "could not be placed: too few matches with the other pictures", "Add cameras between, or texture; or use a board.")
            for n in lost
        ]
    )
    rig = _cameras(pictures, answer)
    return RigCalibration(
        cameras=scaled_to(levelled(rig), baseline),
        residual_px=np.array([answer[n]["residual_px"] for n in pictures]),
        observations=np.array([answer[n]["observations"] for n in pictures]),
    )


def _run(folder: Path, timeout_s: float) -> dict:
    """What the worker found, by camera name. Its process group is killed at the time limit."""
    process = subprocess.Popen(
        [sys.executable, "-m", WORKER, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
    )
    try:
        log, _ = process.communicate(timeout=timeout_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise BadInput([Fault("pictures", f"took longer than {timeout_s:g} s", "Raise timeout_s, or give smaller pictures.")]) from None
    answer = folder / "answer.json"
    if process.returncode or not answer.exists():
        last = log.decode(errors="replace").strip().splitlines()[-1:] or ["it said nothing"]
        raise BadInput(
            [Fault("pictures", f"COLMAP ended with code {process.returncode}: {last[0][:300]}", "Check that the pictures overlap.")]
        )
    return json.loads(answer.read_text())


def _lens_parameters(lenses: Cameras | None, names: list[str]) -> dict[str, list[float]] | None:
    """COLMAP's OPENCV model: fx fy cx cy k1 k2 p1 p2; its pixel centres lie at half integers like ours."""
    if lenses is None:
        return None
    refuse([Fault(n, "has no lens", "Give lenses for all pictures, or for none.") for n in names if n not in lenses.names])
    found = {}
    for name in names:
        k = lenses.names.index(name)
        K, d = lenses.K[k], lenses.distortion[k]
        refuse([] if d[4] == 0 else [Fault(name, f"has k3 = {d[4]:.4g}", "Calibrate its lens with k3 = 0.")])
        found[name] = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *d[:4].tolist()]
    return found


def _cameras(pictures: dict[str, NDArray[np.uint8]], answer: dict) -> Cameras:
    rows = [answer[n] for n in pictures]
    K, R, t, distortion = (np.array([row[key] for row in rows], float) for key in ("K", "R", "t", "distortion"))
    return Cameras(tuple(pictures), K, R, t, np.array([p.shape[1::-1] for p in pictures.values()], np.int32), distortion)
