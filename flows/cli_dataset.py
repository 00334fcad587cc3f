"""`physavatar dataset`: every sequence below the data folder, through the service."""

import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from cyclopts import App
from rich.console import Console
from rich.table import Table

from flows.cli_options import Json, Location, Set, open_named
from flows.config import load
from flows.dataset import Standing, counts, find_sequences, plan_dataset
from flows.endings import OK, STAGE_FAILED, Refused
from storage_schemas.object_store import open_store

app = App(name="dataset", help="Every sequence below the data folder: plan, submit, status, report.")
SHOWN = 200


@app.command
def plan(*, set_: Set = (), store: Location = None, json_: Json = False) -> int:
    """Which sequences are finished, new, changed or unfinished, and why; computes nothing and needs no server."""
    standings = list(_standings(load(set_, places={"store": store})))
    if json_:
        return _print({"counts": counts(standings), "sequences": [vars(standing) for standing in standings]})
    due = [standing for standing in standings if standing.state != "finished"]
    table = Table("actor", "sequence", "state", "why", box=None, header_style="bold")
    for standing in due[:SHOWN]:
        table.add_row(standing.actor, standing.sequence, standing.state, standing.why)
    Console().print(table, f"{counts(standings) or 'no sequences'}" + (f"; {len(due) - SHOWN} more" if len(due) > SHOWN else ""))
    return OK


@app.command
def submit(*, set_: Set = (), store: Location = None, wait: bool = False, json_: Json = False) -> int:
    """Have the service process what is new or changed.

    A dataset that is under way is not submitted twice: asking again follows the run there is.

    Args:
        wait: Stay until it has ended.
    """
    import asyncio

    from flows.service.campaign import dataset_work
    from flows.service.dispatch import WorkFailed, dispatch, submit
    from flows.service.server import speak_to_server

    settings = load(set_, places={"store": store})
    speak_to_server(settings.service)
    from prefect.client.orchestration import get_client

    async def hand_over() -> str:
        async with get_client() as client:
            return str((await submit(client, dataset_work(settings))).id)

    if not wait:
        return _print({"flow_run": asyncio.run(hand_over())})
    try:
        asyncio.run(dispatch(dataset_work(settings)))
    except WorkFailed as failed:
        Console(stderr=True, highlight=False).print(str(failed))
        with suppress(Refused):  # it may have failed before it left word, or been refused because of the one that is shown
            _show(_campaign(open_store(settings.store).root, None), json_)
        return STAGE_FAILED
    return _show(_campaign(open_store(settings.store).root, None), json_)


@app.command
def status(campaign: str | None = None, *, store: Location = None, json_: Json = False) -> int:
    """How far a run over the dataset is.

    Args:
        campaign: Its id, or how that begins; else the newest.
    """
    found = _campaign(open_named(store).root, campaign)
    _show(found, json_)
    return OK


@app.command
def report(out: Path, *, store: Location = None) -> int:
    """One HTML page: every sequence with its verdict and a link to its report.

    Args:
        out: Where it goes.
    """
    from flows.dataset_report import write_dataset_report

    sequences = find_sequences(Path(load().data))
    return _print({"written": str(write_dataset_report(out, open_named(store), sequences))})


def _standings(settings: Any) -> Iterator[Standing]:
    from flows.service.deployed import SERVICE

    store = open_store(settings.store, founds=False)
    return plan_dataset(find_sequences(Path(settings.data)), lambda at: SERVICE.request(at, settings, store), store)


def _campaign(store: Path, wanted: str | None) -> dict[str, Any]:
    files = sorted((store / ".datasets").glob(f"{wanted or ''}*.json"))
    if not files:
        raise Refused("no dataset has been submitted yet" if wanted is None else f"no dataset run's id begins with {wanted!r}")
    return json.loads(files[-1].read_text())


def _show(found: dict[str, Any], json_: bool) -> int:
    if json_:
        _print(found)
    else:
        table = Table("actor", "sequence", "state", "s", "why", box=None, header_style="bold")
        for row in [row for row in found["rows"] if row["state"] != "finished"][:SHOWN]:
            table.add_row(row["actor"], row["sequence"], row["state"], f"{row['seconds']:.0f}", row["why"])
        Console().print(table, f"{found['id']} {found['state']}: {found['counts']}, {found['gpu_hours']} hours of tracking and rendering")
    return STAGE_FAILED if found["state"] in ("failed", "interrupted") else OK


def _print(value: Any) -> int:
    sys.stdout.write(json.dumps(value, indent=1) + "\n")
    return OK
