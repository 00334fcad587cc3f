"""`physavatar cloth fit`: the fabric of a garment that anybody tracked, without any other stage."""

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, Parameter
from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from flows.cli_options import Json, Location
from flows.config import load
from flows.endings import OK
from storage_schemas.cloth import Cloth
from storage_schemas.object_store import open_store
from tasks.geometry.faults import BadInput, Fault

app = App(name="cloth", help="Fabrics: fit.")
TRACKS = "_track"  # the actor under which loose geometry lies, one sequence per content


@app.command
def fit(
    track: Path,
    *,
    method: Literal["gauss-newton", "whole-replay", "adam-fd"] = "gauss-newton",
    as_released: Annotated[bool, Parameter(name="--as-released", negative="")] = False,
    boundary: Literal["tracked", "skinned"] = "tracked",
    frames: int | None = None,
    iterations: int | None = None,
    substeps: int | None = None,
    at_rest: Annotated[bool, Parameter(name="--at-rest", negative="")] = False,
    profiles: Annotated[bool, Parameter(name="--profiles", negative="")] = False,
    with_effect: Annotated[tuple[str, ...], Parameter(name="--with-effect", negative="")] = (),
    fps: float | None = None,
    up: Literal["y", "z"] | None = None,
    store: Location = None,
    json_: Json = False,
) -> int:
    """Estimate the fabric of a tracked garment: stretch and bending stiffness per density, with what can be known of them.

    Args:
        track: NPZ of tracked geometry, or a folder with one OBJ or PLY per frame.
        method: Gauss-Newton on derivatives, of windows or of one replay of the whole, or Algorithm 1 of PhysAvatar (finite differences and
            Adam, 100 iterations).
        as_released: Algorithm 1 with the released code's raw Adam.
        boundary: Driven nodes follow the tracked surface, or ride on the nearest face of the collider.
        frames: How many frames after the first are compared; as many as last about a second, Algorithm 1 takes 24.
        iterations: Most iterations; 4, or 100 for Algorithm 1.
        substeps: Time steps per frame; as few as take no longer than 10 ms each, Algorithm 1 takes one.
        at_rest: The garment is still in its first frame.
        profiles: Also simulate the loss along each parameter and along the direction that motion does not fix.
        with_effect: Name of an effect that the model has beside the base, any number of times; its strength is fitted too.
        fps: Frames per second, instead of what the file says; a folder of meshes does not.
        up: Which axis points up, instead of what the file says.
    """
    from tasks.cloth.stage import TrackParameters, track_fit
    from tasks.stage import content_digest

    if not track.exists():
        raise BadInput([Fault(str(track), "there is no such file or folder", "Give an NPZ of tracked geometry, or a folder of meshes.")])
    settings = load(places={"store": store})
    try:
        parameters = TrackParameters(
            track=track,
            method=method,
            as_released=as_released,
            boundary=boundary,
            frames=frames,
            iterations=iterations,
            substeps=substeps,
            at_rest=at_rest,
            profiles=profiles,
            effects_folder=settings.effects_folder if with_effect else None,
            effects=with_effect,
            fps=fps,
            up=up,
        )
    except ValidationError as error:
        raise BadInput(Fault(f"{e['loc'][0]}", e["msg"], "See `physavatar cloth fit --help`.") for e in error.errors()) from None
    opened, messages = open_store(settings.store), Console(stderr=True)
    outcome = track_fit.run(
        opened,
        TRACKS,
        content_digest(track),
        {},
        parameters,
        progress=lambda fraction, text: messages.print(f"{fraction:4.0%} {text}", highlight=False),
        warn=lambda text: messages.print(text, style="yellow", markup=False, highlight=False, soft_wrap=True),
    )
    found = opened.open(outcome.ref, Cloth)
    if json_:
        sys.stdout.write(json.dumps(_as_json(found, outcome), indent=1) + "\n")
    else:
        _show(found, Console())
    return OK


def _as_json(found: Cloth, outcome: Any) -> dict[str, Any]:
    return {
        "version": 1,
        "artifact": outcome.ref.model_dump(mode="json"),
        "cached": outcome.cached,
        "seconds": outcome.seconds,
        "parameters": found.parameters["garment"],
        "knowledge": found.knowledge["garment"],
        "history": found.loss_history["garment"],
        "endings": list(found.endings),
    }


def _show(found: Cloth, console: Console) -> None:
    """Estimates, and in sentences what bounds them."""
    table = Table("parameter", "value", "low (90 %)", "high", "unit", box=None, header_style="bold")
    doubts = []
    for name, e in found.parameters["garment"].items():
        table.add_row(name, *("–" if e[k] is None else f"{e[k]:.3g}" for k in ("value", "low", "high")), e["unit"])
        if e["value"] is None:
            doubts.append(f"{name}: {e.get('sentence', 'this recording does not tell')}")
    console.print(table)
    known = found.knowledge["garment"]
    sentences = [known[k]["sentence"] for k in ("half_step", "other_boundary") if k in known]
    for line in (*found.endings, *doubts, *sentences):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
