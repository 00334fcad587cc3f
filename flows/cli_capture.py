"""`physavatar capture`: look at a recording before submitting it, and calibrate one that has no calibration."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import App, Parameter

from tasks.geometry.faults import BadInput, Fault, refuse

app = App(name="capture", help="Recordings: check, calibrate.")
PICTURES = (".png", ".jpg", ".jpeg")


@app.command
def check(folder: Path, *, scale: str | None = None, deep: bool = False) -> int:
    """Check an ActorsHQ folder as a whole, its template too, and report every fault.

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

    faults = _place_faults(folder, out)
    found = _by_board(folder, board, floor_frame, faults) if board else _by_motion(folder, baseline, faults)
    write_opencv(out, found.cameras)
    residuals = zip(found.cameras.names, found.residual_px, found.observations)
    return _print({"written": str(out), "cameras": {n: {"residual_px": round(float(r), 3), "points": int(k)} for n, r, k in residuals}})


def _by_motion(folder: Path, baseline: tuple[str, str, float] | None, faults: list[Fault]) -> Any:
    from tasks.capture.images import read_rgb
    from tasks.capture.rig_calibration import baseline_faults
    from tasks.capture.structure_from_motion import calibrate_from_pictures

    files = _pictures(folder)
    faults = [*faults, *_name_faults([(p, p.stem) for p in files])]
    if baseline is None:
        remedy = "Give --baseline CAMERA CAMERA METRES, or use --board."
        raise BadInput([*faults, Fault("baseline", "there is none, and structure from motion does not know lengths", remedy)])
    refuse(faults + (baseline_faults(baseline, [p.stem for p in files]) if files else []))
    return calibrate_from_pictures({p.stem: read_rgb(p) for p in files}, baseline=baseline)


def _by_board(folder: Path, board: str, floor_frame: int | None, faults: list[Fault]) -> Any:
    from tasks.capture.charuco import Board, board_faults, calibrate_charuco
    from tasks.capture.images import read_rgb

    cameras = {c.name: _pictures(c) for c in _inside(folder) if c.is_dir()}
    faults = [*faults, *_name_faults([(folder / name, name) for name in cameras])]
    counts = {name: len(files) for name, files in cameras.items()}
    if folder.is_dir() and (len(set(counts.values())) != 1 or 0 in counts.values()):
        remedy = "Give every camera a folder of its own, named after it, and all of them the same number of pictures."
        faults.append(Fault(str(folder), f"it holds {counts or 'no folders'}", remedy))
    try:
        columns, rows, square, marker = board.split("x")
        printed = Board(int(columns), int(rows), float(square), float(marker))
    except ValueError:
        remedy = "Write columns x rows x square x marker, such as 9x6x0.06x0.045."
        raise BadInput([*faults, Fault("board", f"{board!r} is not understood", remedy)]) from None
    refuse(faults + board_faults(printed))
    pictures = {name: [read_rgb(p) for p in files] for name, files in cameras.items()}
    uv = np.stack([[printed.detect(picture) for picture in views] for views in pictures.values()])
    size = np.array([views[0].shape[1::-1] for views in pictures.values()])
    return calibrate_charuco(uv, printed, names=list(pictures), size=size, floor_frame=floor_frame)


def _place_faults(folder: Path, out: Path) -> list[Fault]:
    """Whether there is a folder to read, and one to write into."""
    faults = [] if folder.is_dir() else [Fault(str(folder), "is no folder", "Give the folder of the pictures.")]
    if out.is_dir() or not out.parent.is_dir():
        what = "is a folder" if out.is_dir() else f"cannot be written: there is no folder {out.parent}"
        faults.append(Fault(str(out), what, "Give the file to write, in a folder that exists, such as calibration.json."))
    return faults


def _name_faults(cameras: list[tuple[Path, str]]) -> list[Fault]:
    """A fault for every name that no reader of a calibration would take for a camera's."""
    from tasks.capture.recording import validate_name

    faults = []
    for where, name in cameras:
        try:
            validate_name(name, str(where))
        except BadInput as bad:
            faults += bad.faults
    return faults


def _inside(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _pictures(folder: Path) -> list[Path]:
    return [p for p in _inside(folder) if p.suffix.lower() in PICTURES]


def _print(value: Any) -> int:
    sys.stdout.write(json.dumps(value, indent=1) + "\n")
    return 0
