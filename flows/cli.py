"""The command line. Results on stdout (tables, or JSON with --json), everything else on stderr.

Exit codes: 0 ok, 1 a stage failed, 2 usage or bad input, 3 server unreachable, 4 cancelled, 5 timeout.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter
from cyclopts.exceptions import CycloptsError
from rich.console import Console
from rich.table import Table

from flows.cli_options import Json, Location, Set, open_named
from flows.endings import CANCELLED, OK, STAGE_FAILED, Refused, ending_of

# One BLAS thread per process: garments, cameras and candidates run side by side instead, and sums come out in one order.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

OUT, ERR = Console(), Console(stderr=True)
app = App(
    name="physavatar",
    help="From many-camera recordings of dressed actors to avatars whose clothes obey physics.",
    version=lambda: version("physavatar"),
)
config = App(name="config", help="What is set, and from where.")
app.command(config)
app.command("flows.cli_artifacts:app", name="artifacts", help="Look into the store: ls, show, verify, gc.")
app.command("flows.cli_capture:app", name="capture", help="Recordings: check, calibrate.")
app.command("flows.cli_keypoints:app", name="keypoints", help="The keypoint detector: train.")
app.command("flows.cli_cloth:app", name="cloth", help="Fabrics: fit.")
app.command("flows.cli_effects:effects", name="effects")
app.command("flows.cli_gap:app", name="gap", help="The gap between simulation and recording: run.")
app.command("flows.cli_exam:app", name="exam", help="The blind check of the diagnosis.")
app.command("flows.cli_export:export", name="export")
app.command("flows.cli_dataset:app", name="dataset", help="Every sequence below the data folder: plan, submit, status, report.")
app.command("flows.cli_up:up", name="up")
app.command("flows.cli_up:worker", name="worker")
app.command("flows.cli_up:deploy", name="deploy")


def main(arguments: list[str] | None = None) -> None:
    """Entry point: parse, run, and end with the exit code that says how."""
    signal.signal(signal.SIGTERM, _cancelled)
    try:
        result = app(arguments, exit_on_error=False, print_error=True, error_console=ERR, result_action="return_value")
        code = result if isinstance(result, int) else OK
    except CycloptsError:
        code = 2
    except BrokenPipeError:  # whoever read stdout has enough, as `| head` has; what is still to be flushed goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        code = OK
    except BaseException as error:  # noqa: BLE001  every ending gets its exit code
        code, message = ending_of(error)
        if message:
            ERR.print(message, style="red", markup=False, highlight=False, soft_wrap=True)
    sys.stdout.flush()
    sys.exit(code)


@app.command
def submit(
    actor: str,
    *,
    sequence: str | None = None,
    until: str = "report",
    set_: Set = (),
    store: Location = None,
    wait: bool = True,
    service: Annotated[bool, Parameter(name="--service", negative="")] = False,
    json_: Json = False,
) -> int:
    """Process one actor now, in this process, without a server.

    Args:
        actor: Name of a folder below the data folder; `demo` is made on first use.
        sequence: Which of the actor's sequences; may be left out when there is one.
        until: Last stage to run.
        wait: With --no-wait the run goes on in the background; see status, logs and cancel.
        service: Have the workers of `physavatar up` do it, before any dataset.
    """
    from flows.submission import Submission

    submission = Submission.prepare(actor, sequence, until=until, overrides=set_, store=store, console=ERR)
    if wait and not service:
        return _show_ending(submission.run(), json_)
    submission.check()
    if service:
        from flows.service.hand_over import hand_over

        return _print_json({"flow_run": hand_over(submission.request, submission.store, wait=wait)})
    return _in_background(["submit", actor, *_options({"--sequence": [sequence], "--until": [until], "--set": set_, "--store": [store]})])


@app.command
def demo(*, set_: Set = (), store: Location = None, json_: Json = False) -> int:
    """Make the demo recording, process it, and compare the result with the truth."""
    return submit("demo", set_=set_, store=store, json_=json_)


@app.command
def plan(
    actor: str,
    *,
    sequence: str | None = None,
    until: str = "report",
    explain: bool = False,
    set_: Set = (),
    store: Location = None,
    json_: Json = False,
) -> int:
    """What `submit` would compute and what it would take from the store.

    Args:
        actor: Name of a folder below the data folder.
        sequence: Which of the actor's sequences; may be left out when there is one.
        until: The last stage that is wanted.
        explain: Say which field of a stage's key changed.
    """
    from flows.request import plan_actor
    from flows.submission import Submission

    submission = Submission.prepare(actor, sequence, until=until, overrides=set_, store=store, console=ERR, makes=False)
    planned = plan_actor(submission.request, submission.store)
    if json_:
        return _print_json([vars(p) for p in planned])
    columns = ["stage", "", "key"] + ["why"] * explain
    _print_table(columns, [[p.stage, "cached" if p.cached else "run", (p.key or "?")[:12]] + [p.why] * explain for p in planned])
    return OK


@app.command
def rerun(
    actor: str,
    *,
    from_: Annotated[str | None, Parameter(name="--from")] = None,
    with_effect: Annotated[tuple[str, ...], Parameter(name="--with-effect", negative="")] = (),
    sequence: str | None = None,
    set_: Set = (),
    store: Location = None,
    json_: Json = False,
) -> int:
    """Compute a stage and all after it anew, with changed parameters if given; artifacts of the old parameters stay.

    Args:
        actor: Name of a folder below the data folder.
        from_: Stage to compute again, with what is made from it, although its artifact is in the store.
        with_effect: Name of an effect to add to those of cloth.effects, any number of times: the cloth is fitted again with it.
        sequence: Which of the actor's sequences; may be left out when there is one.
    """
    from flows.submission import Submission

    if from_ is None and not with_effect:
        raise Refused("nothing to do anew: name a stage (--from) or an effect (--with-effect)")
    if with_effect:
        set_ = (*set_, f"cloth.effects={','.join((*_settings(store, set_).cloth.effects, *with_effect))}")
    submission = Submission.prepare(actor, sequence, until="report", overrides=set_, store=store, console=ERR)
    if from_ is not None:
        submission.forget_from(from_)
    return _show_ending(submission.run(), json_)


@app.command
def status(run: str | None = None, *, store: Location = None, json_: Json = False) -> int:
    """Runs of this machine and how far each stage is.

    Args:
        run: Only the one with this id, or whose id begins so.
    """
    from flows.runs import list_runs

    runs = [r for r in list_runs(_store_root(store)) if run is None or r["id"].startswith(run)]
    if json_:
        return _print_json(runs)
    rows = [[r["id"], f"{r['actor']}/{r['sequence']}", r["state"], _stage_line(r), r["error"] or ""] for r in runs]
    _print_table(["run", "actor", "state", "stages", "error"], rows)
    return OK


@app.command
def logs(run: str | None = None, *, store: Location = None, follow: bool = False) -> int:
    """The log of a run.

    Args:
        run: Its id, or how that begins; else the newest.
        follow: Stay, and print what is added, until it ends.
    """
    from flows.runs import find_run

    root = _store_root(store)
    found = _found(find_run(root, run), run)
    with (root / ".runs" / f"{found['id']}.log").open() as log:
        while True:
            OUT.print(log.read(), end="", markup=False, highlight=False, soft_wrap=True)
            if not follow or (find_run(root, found["id"]) or {}).get("state") != "running":
                return OK
            time.sleep(1.0)


@app.command
def cancel(run: str | None = None, *, store: Location = None) -> int:
    """Stop a run of this machine; finished stages stay in the store. What the service does is cancelled in the Prefect UI.

    Args:
        run: Its id, or how that begins; else the newest.
    """
    from flows.runs import find_run, stop

    found = _found(find_run(_store_root(store), run, own=True), run)
    stop(found)
    ERR.print(f"asked run {found['id']} (process {found['pid']}) to stop")
    return OK


@app.command
def stages(*, json_: Json = False) -> int:
    """The stages in order, their versions, worker pools and parameters."""
    from flows.pipeline import STAGES

    rows = [
        {
            "stage": s.name,
            "version": s.version,
            "pool": s.pool,
            "reads": list(s.reads),
            "parameters": {n: str(f.default) for n, f in s.parameters.model_fields.items()},
        }
        for s in STAGES.values()
    ]
    if json_:
        return _print_json(rows)
    _print_table(
        ["stage", "version", "pool", "reads", "parameters"], [[str(r[c]) if c != "reads" else ", ".join(r[c]) for c in r] for r in rows]
    )
    return OK


@app.command
def doctor(*, store: Location = None, json_: Json = False) -> int:
    """Check this machine: libraries, LLVM, model files, storage rights, disk, clock."""
    from flows.doctor import examine

    findings = examine(_settings(store))
    if json_:
        _print_json([vars(f) for f in findings])
    else:
        _print_table(
            ["check", "ok", "found", "remedy"], [[f.check, "yes" if f.ok else "NO", f.found, "" if f.ok else f.remedy] for f in findings]
        )
    return OK if all(f.ok for f in findings) else STAGE_FAILED


@config.command
def check(*, set_: Set = (), store: Location = None, json_: Json = False) -> int:
    """Read the configuration as `submit` would and show what is in force."""
    settings = _settings(store, set_)
    return _print_json(settings.model_dump(mode="json")) if json_ else (OUT.print_json(settings.model_dump_json()), OK)[1]


def _settings(store: str | None, overrides: tuple[str, ...] = ()) -> Any:
    from flows.config import load

    return load(overrides, places={"store": store})


def _store_root(store: str | None) -> Path:
    """Where runs are recorded. A store that nobody names with --store need not be there: then there have been no runs yet."""
    from storage_schemas.object_store import open_store

    return (open_store(_settings(None).store, founds=False) if store is None else open_named(store)).root


def _options(values: Mapping[str, Iterable[str | None]]) -> list[str]:
    """As the command line has them; what was not given is left out."""
    return [word for name, given in values.items() for value in given if value is not None for word in (name, value)]


def _in_background(arguments: list[str]) -> int:
    """The same command in a process of its own, whose words nobody reads: what can be found wrong before it starts has to be found by then."""
    child = subprocess.Popen(
        [sys.executable, "-m", "flows", *arguments], start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    ERR.print(f"running in the background as process {child.pid}; see `physavatar status`")
    return OK


def _show_ending(ended: Any, json_: bool) -> int:
    if json_:
        _print_json(ended.as_json())
    else:
        ended.show(OUT)
    return OK


def _stage_line(run: dict[str, Any]) -> str:
    marks = {"completed": "✓", "cached": "=", "failed": "✗"}
    return " ".join(n + marks.get(s["state"], f" {s['fraction']:.0%}") for n, s in run["stages"].items())


def _found(run: dict[str, Any] | None, asked: str | None) -> dict[str, Any]:
    if run is None:
        raise Refused("there are no runs yet" if asked is None else f"no run's id begins with {asked!r}; see `physavatar status`")
    return run


def _print_json(value: Any) -> int:
    sys.stdout.write(json.dumps(value, indent=1, default=str) + "\n")
    return OK


def _print_table(columns: list[str], rows: list[list[str]]) -> None:
    table = Table(*columns, box=None, header_style="bold")
    for row in rows:
        table.add_row(*row)
    OUT.print(table)


def _cancelled(*_: Any) -> None:
    raise KeyboardInterrupt


__all__ = ["CANCELLED", "main"]
