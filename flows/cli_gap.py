"""`physavatar gap`: where the physics differs from recordings, which effect it lacks, and how far the gap then shrinks."""

import json
import sys
import time
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, Parameter
from rich.console import Console
from rich.table import Table

from flows.cli_options import Json, Location, Set
from flows.config import load
from flows.endings import OK, STAGE_FAILED, TIMED_OUT
from tasks.child_process import ChildTimedOut

app = App(name="gap", help="The gap between simulation and recording: run.")


@app.default
def of(
    actor: str,
    *,
    sequence: str | None = None,
    set_: Set = (),
    store: Location = None,
    json_: Json = False,
) -> int:
    """Process an actor as far as the diagnosis, and show it.

    Args:
        actor: Name of a folder below the data folder.
        sequence: Which of the actor's sequences; may be left out when there is one.
    """
    from flows.submission import Submission
    from storage_schemas.gap import PAGE, Gap

    messages = Console(stderr=True)
    submission = Submission.prepare(actor, sequence, until="gap", overrides=set_, store=store, console=messages)
    ref = submission.run().artifacts["gap"]
    found = submission.store.open(ref, Gap)
    if PAGE in found.files:
        messages.print(f"what it rests on: {submission.store.folder(ref) / 'files' / PAGE}", soft_wrap=True, markup=False, highlight=False)
    _tell(found.verdict, json_)
    return OK


@app.command
def run(
    *tracks: Path,
    held_out: Annotated[tuple[Path, ...], Parameter(name="--held-out", negative="", consume_multiple=True)] = (),
    predict: Annotated[Path | None, Parameter(name="--predict")] = None,
    out: Annotated[Path | None, Parameter(name="--out")] = None,
    quick: Annotated[bool, Parameter(name="--quick", negative="")] = False,
    without: Annotated[tuple[str, ...], Parameter(name="--without", negative="", consume_multiple=True)] = (),
    report: Annotated[Path | None, Parameter(name="--report")] = None,
    fps: float | None = None,
    up: Literal["y", "z"] | None = None,
    json_: Json = False,
) -> int:
    """Diagnose recordings of one garment that anybody tracked.

    Args:
        tracks: NPZ files of tracked geometry, or folders with one OBJ or PLY per frame; all of one garment.
        held_out: Further recordings, read only when the verdict is fixed; without any, three windows of ten in each
            recording are kept.
        predict: A recording whose garment is known in its first two frames only.
        out: Where its prediction goes: NPZ with `before` (base model) and `after` (with the named effect), [T, V, 3] m.
        quick: On at most 300 of the garment's vertices, with fewer refits; a prediction still is of all of them.
        without: Names of effects to leave out of the library.
        report: An HTML page that shows the verdict and what it rests on; everything as JSON goes beside it.
        fps: Frames per second, instead of what the files say; folders of meshes do not.
        up: Which axis points up, instead of what the files say.
    """
    from flows import gap

    request = gap.Request(tracks, held_out, predict, out, quick, without, load().effects_folder, report, fps, up)
    start = time.monotonic()

    def tell(text: str) -> None:
        _say(f"{time.monotonic() - start:5.0f} s  {text}", "dim")

    try:
        gap.run(request, tell=tell, warn=lambda text: _say(text, "yellow"), show=lambda found: _tell(found, json_))
    except gap.Unfinished as left:
        _say(str(left), "red")
        return STAGE_FAILED
    except ChildTimedOut as late:
        _say(f"timed out: {late}; fewer frames, a coarser mesh or --quick take less, and nothing is kept to go on from", "red")
        return TIMED_OUT
    return OK


def _say(text: str, style: str) -> None:
    Console(stderr=True).print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def _tell(found: dict[str, Any], json_: bool) -> None:
    if json_:
        sys.stdout.write(json.dumps(found, indent=1, allow_nan=False) + "\n")
    else:
        _show(found, Console(markup=False))  # units stand in square brackets
    sys.stdout.flush()  # what may still fail does not take the answer along


def _show(found: dict[str, Any], console: Console) -> None:
    console.print(found["verdict"]["sentence"], soft_wrap=True)
    table = Table("class", "probability", "strength")
    for row in found["ranking"][:6]:
        told = "; ".join(f"{n} {s['value']:.3g} {s['unit']} ({s['low']:.3g} to {s['high']:.3g})" for n, s in row["strength"].items())
        table.add_row(", ".join(row["class"]), f"{row['probability']:.2f}", told)
    console.print(table)
    shown = {"before_mm": "before [mm]"}
    if found["verdict"]["kind"] == "effect":  # without a name there is no after
        shown["after_mm"] = "after [mm]"
    zones = Table("zone", *shown.values())
    for row in found["where"]["zones"]:
        zones.add_row(row["zone"], *(f"{row[k]:.1f}" if row[k] is not None else "-" for k in shown))
    console.print(zones)
    console.print(f"Record next: {found['record_next']}.", soft_wrap=True)
