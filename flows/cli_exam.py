"""`physavatar exam`: the blind check of the diagnosis."""

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console
from rich.table import Table

from flows.cli_options import Json
from flows.endings import OK, STAGE_FAILED
from flows.exam_scoreboard import EDITION
from tasks.geometry.faults import Fault, refuse

app = App(name="exam", help="The blind check of the diagnosis.")
Split = Literal["open", "sealed"]
Engine = Literal["own", "mujoco"]
AtLeastOne = Annotated[int, Parameter(validator=Number(gte=1))]
Hours = Annotated[float, Parameter(validator=Number(gte=0))]
OUT, ERR = Console(), Console(stderr=True)


@app.default
def exam(
    *,
    cases: AtLeastOne = 160,
    seed: int = 0,
    split: Split = "open",
    engine: Engine = "own",
    at_once: AtLeastOne = 1,
    hours: Hours = math.inf,
    service: Annotated[bool, Parameter(name="--service", negative="")] = False,
    out: Path = Path("exam"),
    rivals: Annotated[bool, Parameter(name="--rivals", negative="")] = False,
    rival: Annotated[tuple[str, ...], Parameter(name="--rival", negative="")] = (),
    json_: Json = False,
) -> int:
    """Make recordings with a hidden cause, let `gap run` name it, and score the answers. What was done before is kept.

    Args:
        cases: How many; the full exam has 160.
        seed: Which set of cases.
        split: open serves tuning. sealed draws its cases from the code that is examined, and every attempt is added to the scoreboard.
        engine: Whose engine moves the cloth. mujoco is installed on first use, in an environment of its own below the cache folder.
        at_once: How many cases at a time, each in a process of its own.
        hours: Begin no case after so many hours, and tell what is done by then; asked again, it goes on with the others.
        service: Have the service's workers do them, so many at a time; they must reach the folder.
        out: Folder of this exam.
        rivals: Let all rivals answer as well; slow ones a third of the cases.
        rival: Names of rivals that answer as well.
        json_: Machine-readable JSON on stdout.
    """
    from flows import exam as blind
    from flows import exam_engine
    from flows.exam_rival import chosen
    from tasks.exam.rivals import library

    spread = _spread(at_once, hours, service=service)
    beside = chosen(tuple(library.rivals()) if rivals else rival)
    if engine != "own":
        exam_engine.prepare(_say)
    folder = blind.Folder(out / blind.folder_name(seed, split, engine))
    sitting = blind.Exam(folder, cases, seed, split, engine)
    result = blind.sit(sitting, rivals=beside, spread=spread, say=_say)
    return _tell(result, folder, seed, json_)


def _say(line: str) -> None:
    ERR.print(line, markup=False, highlight=False)


def _tell(result: dict[str, Any], folder: Any, seed: int, json_: bool) -> int:
    """Page and JSON into the folder, and what was asked for to stdout."""
    from tasks.exam.scorer.page import page

    rests_on = {(seed, row["number"]): address for row in result["rows"] if (address := folder.rests_on(row["number"]))}
    folder.root.mkdir(parents=True, exist_ok=True)  # nobody has made it where every case is on the scoreboard already
    (folder.root / "exam.html").write_text(page(result, rests_on))
    (folder.root / "exam.json").write_text(json.dumps(result, indent=1) + "\n")
    if json_:
        sys.stdout.write(json.dumps(result, indent=1) + "\n")
    else:
        _show(result)
        ERR.print(f"page: {folder.root / 'exam.html'}", markup=False)
    return OK if result["rows"] else STAGE_FAILED


def _spread(count: int, hours: float, *, service: bool) -> Any:
    """Where cases are worked on: here in turn, here in processes of their own, or by the service's workers."""
    from flows import exam as blind

    if not service:
        return blind.in_turn if count == 1 and math.isinf(hours) else blind.at_once(count, hours)
    if not math.isinf(hours):
        remedy = "Leave it out, and cancel the run exam when it is to stop"
        refuse([Fault(f"--hours {hours:g}", "the service's runs have no end by the clock", remedy)])
    from flows.config import load
    from flows.service.examination import over_workers
    from flows.service.server import speak_to_server

    speak_to_server(load().service)
    return over_workers(count)


@app.command
def generate(*, cases: AtLeastOne, out: Path, seed: int = 0, first: Annotated[int, Parameter(validator=Number(gte=0))] = 0) -> int:
    """Make the recordings of an open exam and stop there.

    Args:
        cases: How many cases the exam has.
        out: Folder of this exam; it gets cases/ and, apart, sealed.truth/.
        seed: Which set of cases.
        first: Number of the case to begin with.
    """
    from flows import exam as blind

    folder = blind.Folder(out)
    folder.take(seed)
    for number, what in blind.generate(folder, blind.Exam(folder, cases, seed, "open").questions()[first:]):
        sys.stdout.write(f"{folder.case(number)}\t{what}\n")
        sys.stdout.flush()
    return OK


@app.command
def pictures(
    *, cases: AtLeastOne = 8, seed: int = 0, split: Split = "open", hours: Hours = math.inf, out: Path = Path("exam"), json_: Json = False
) -> int:
    """Cases that start from images with a fault of calibration or body, and go through all stages. What was done before is kept.

    Args:
        cases: How many; a quarter of an hour each.
        seed: Which set of cases.
        split: open serves tuning. sealed draws its cases from the code that is examined, and every attempt is added to the scoreboard.
        hours: Begin no case after so many hours, and tell what is done by then; asked again, it goes on with the others.
        out: Folder of this exam.
        json_: Machine-readable JSON on stdout.
    """
    from flows import exam as blind
    from flows import exam_pictures
    from flows.exam_scoreboard import PICTURES

    folder = blind.Folder(out / blind.folder_name(seed, split, PICTURES))
    return _tell(exam_pictures.sit(folder, cases, seed, split, hours=hours, say=_say), folder, seed, json_)


@app.command
def scoreboard(*, version: str = "", edition: int = EDITION, json_: Json = False) -> int:
    """Figures of all sealed cases that any version of the diagnosis has sat; each was new to its version.

    Args:
        version: Only versions whose hash begins so, with every case of theirs and the confusion matrix, as Markdown.
        edition: Of questions and marks.
        json_: Machine-readable JSON on stdout.
    """
    from flows.exam_scoreboard import every_version
    from tasks.exam.scorer.listing import confusions, listing

    result = every_version(beginning=version, edition=edition)
    if not result["rows"]:
        what = "no version whose hash begins so has sat a sealed exam of this edition"
        refuse(
            [Fault(f"--version {version} --edition {edition}", what, "Leave --version out to see which have, or ask for an edition before")]
        )
    if json_:
        sys.stdout.write(json.dumps(result, indent=1) + "\n")
    else:
        _show_figures(result)
        OUT.print("versions: " + ", ".join(f"{of[:8]} {cases}" for of, cases in result["versions"].items()), highlight=False)
        if version:
            sys.stdout.writelines(f"{line}\n" for line in (*listing(result["rows"]), "", *confusions(result["rows"])))
    return OK


@app.command
def rival(
    *tracks: Path,
    name: Annotated[tuple[str, ...], Parameter(name="--name", negative="")],
    predict: Annotated[Path, Parameter(name="--predict")],
    out: Annotated[Path, Parameter(name="--out")],
    without: Annotated[tuple[str, ...], Parameter(name="--without", negative="")] = (),
) -> int:
    """Let rivals of the diagnosis answer what `gap run` would; what they share is computed once.

    Args:
        name: Of a rival; may be repeated.
        tracks: NPZ files of tracked geometry, or folders with one OBJ or PLY per frame; all of one garment.
        predict: A recording whose garment is known in its first two frames only.
        out: Folder that gets NAME.json, the answer in the form of `gap run`, and NAME.npz with `before` and `after`, [T, V, 3] m.
        without: Names of effects to leave out of the library.
    """
    from flows.exam_rival import run

    told = run(name, tracks, predict=predict, out=out, without=without)
    for each, answer in told.items():
        sys.stdout.write((answer["verdict"]["sentence"] if answer else f"{each}: it fell over; see above.") + "\n")
    return OK if all(told.values()) else STAGE_FAILED


def _show(result: dict[str, Any]) -> None:
    from tasks.exam.scorer.beside import columns

    _show_figures(result)
    for apart in result["apart"].values():
        _show_figures(apart)
    if result["rivals"]:
        _show_beside(columns(result), [f["metric"] for f in result["figures"]])


def _show_beside(beside: dict[str, dict[str, float | None]], metrics: list[str]) -> None:
    """One column for each who answered."""
    from tasks.exam.scorer.beside import letters
    from tasks.exam.scorer.page import number

    named = letters(beside)
    table = Table("metric", *named, box=None, header_style="bold")
    for metric in metrics:
        table.add_row(metric, *(number(values.get(metric)) for values in beside.values()))
    OUT.print(*(f"{letter}  {name}" for letter, name in named.items()), sep="\n", highlight=False)
    OUT.print(table)


def _show_figures(result: dict[str, Any]) -> None:
    from tasks.exam.scorer.engine import heading
    from tasks.exam.scorer.page import interval, number

    table = Table("metric", "value", "95 %", "cases", box=None, header_style="bold", title=heading(result), title_justify="left")
    for f in result["figures"]:
        table.add_row(f["metric"], number(f["value"]), interval(f), str(f["cases"]))
    OUT.print(table)
