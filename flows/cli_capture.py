"""`physavatar capture`: look at a recording before submitting it, and calibrate one that has no calibration."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import App, Parameter

from flows.endings import Refused

app = App(name="capture", help="Recordings: check, calibrate.")
PICTURES = (".png", ".jpg", ".jpeg")


@app.command
def check(folder: Path, *, scale: str | None = None, deep: bool = False) -> int:
    """Check an ActorsHQ folder as a whole and report every fault.

    Args:
        folder: The sequence: scene.json, 4x/, …
        scale: Which of its resolutions, such as 4x; may be left out where there is one.
        deep: Decode every picture.
    """
    from tasks.capture.actorshq import read_actorshq

    recording = read_actorshq(folder, scale=scale, deep=deep)
    return _print(
        {"cameras": len(recording.cameras), "frames": len(recording.frames), "fps": recording.fps, "warnings": recording.warnings}
    )


@app.command
def calibrate(
    folder: Path,
    out: Path,
    *,
    baseline: tuple[str, str, float] | None = None,
    board: Annotated[str | None, Parameter(help="columns x rows x square_m x marker_m, such as 9x6x0.06x0.045")] = None,
    floor_frame: int | None = None,
) -> int:
    """Calibrate the cameras of a recording and write calibration.json, with residuals per camera.

    Args:
        folder: Pictures: one per camera, named after it (structure from motion), or one folder per camera (a ChArUco board).
        out: The calibration to write.
        baseline: Two cameras and the distance of their centres in metres; fixes the scale of structure from motion.
        board: The ChArUco board; with it the folder's pictures of the board are used.
        floor_frame: Which picture shows the board on the floor.
    """
    from tasks.capture.calibration_opencv import write_opencv

    found = _by_board(folder, board, floor_frame) if board else _by_motion(folder, baseline)
    write_opencv(out, found.cameras)
    residuals = zip(found.cameras.names, found.residual_px, found.observations)
    return _print({"written": str(out), "cameras": {n: {"residual_px": round(float(r), 3), "points": int(k)} for n, r, k in residuals}})


def _by_motion(folder: Path, baseline: tuple[str, str, float] | None) -> Any:
    from tasks.capture.images import read_rgb
    from tasks.capture.structure_from_motion import calibrate_from_pictures

    if baseline is None:
        raise Refused("structure from motion does not know lengths: give --baseline CAMERA CAMERA METRES, or use --board")
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() in PICTURES)
    return calibrate_from_pictures({p.stem: read_rgb(p) for p in files}, baseline=baseline)


def _by_board(folder: Path, board: str, floor_frame: int | None) -> Any:
    from tasks.capture.charuco import Board, calibrate_charuco
    from tasks.capture.images import read_rgb

    try:
        columns, rows, square, marker = board.split("x")
        printed = Board(int(columns), int(rows), float(square), float(marker))
    except ValueError:
        raise Refused(f"--board {board!r}: write columns x rows x square x marker, such as 9x6x0.06x0.045") from None
    cameras = sorted(p for p in folder.iterdir() if p.is_dir())
    pictures = {c.name: [read_rgb(p) for p in sorted(c.iterdir()) if p.suffix.lower() in PICTURES] for c in cameras}
    counts = {name: len(views) for name, views in pictures.items()}
    if len(set(counts.values())) != 1:
        raise Refused(f"{folder}: every camera needs the same number of pictures, there are {counts or 'no folders'}")
    uv = np.stack([[printed.detect(picture) for picture in views] for views in pictures.values()])
    size = np.array([views[0].shape[1::-1] for views in pictures.values()])
    return calibrate_charuco(uv, printed, names=list(pictures), size=size, floor_frame=floor_frame)


def _print(value: Any) -> int:
    sys.stdout.write(json.dumps(value, indent=1) + "\n")
    return 0
