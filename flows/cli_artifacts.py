"""`physavatar artifacts`: look into the store, and keep or sweep what is in it."""

import json
import sys
from datetime import timedelta
from typing import Any

from cyclopts import App
from rich.console import Console
from rich.table import Table

from flows.cli_options import Json, Location, open_named
from flows.endings import OK, STAGE_FAILED, Refused
from storage_schemas.reference import Address
from storage_schemas.store import Store
from tasks.geometry.faults import Fault, refuse

app = App(name="artifacts", help="Look into the store: ls, show, verify, gc, pin, unpin.")


@app.command
def ls(
    actor: str | None = None, *, sequence: str | None = None, stage: str | None = None, store: Location = None, json_: Json = False
) -> int:
    """All artifacts, or those of one actor, sequence or stage.

    Args:
        actor: Only this one's.
        sequence: Only this one's.
        stage: Only what this one published.
    """
    entries = open_named(store).list(actor, sequence, stage)
    if json_:
        return _print([entry.model_dump(mode="json") for entry in entries])
    table = Table("actor", "sequence", "stage", "key", "schema", "MB", box=None, header_style="bold")
    for entry in entries:
        at = entry.address
        schema = f"{entry.schema_name} v{entry.schema_version}" if entry.schema_name else "damaged"
        table.add_row(at.actor, at.sequence, at.stage, at.key[:12], schema, f"{entry.bytes / 1e6:.2f}")
    Console().print(table)
    return OK


@app.command
def show(key: str, *, store: Location = None) -> int:
    """Manifest and provenance of an artifact, as JSON.

    Args:
        key: Its key, or how that begins.
    """
    opened = open_named(store)
    folder = opened.folder(_address(opened, key))
    return _print(
        {name: json.loads((folder / f"{name}.json").read_text()) for name in ("manifest", "provenance")} | {"folder": str(folder)}
    )


@app.command
def verify(*, store: Location = None, json_: Json = False) -> int:
    """Read every byte of every artifact and compare it with what was published."""
    faults = open_named(store).verify()
    if json_:
        _print([str(fault) for fault in faults])
    else:
        Console().print("\n".join(map(str, faults)) or "clean", highlight=False, markup=False)
    return STAGE_FAILED if faults else OK


@app.command
def gc(*, older_than_days: float = 7.0, dry_run: bool = False, store: Location = None, json_: Json = False) -> int:
    """Remove artifacts that nothing refers to any more and what dead processes left behind.

    Args:
        older_than_days: Keep what somebody asked for within so many days.
        dry_run: Only say what would be removed.
    """
    most = timedelta.max.days
    if not 0 <= older_than_days <= most:  # nan is none either
        refuse([Fault(f"--older-than-days {older_than_days:g}", "it is no age", f"Give a number of days, 0 to {most}.")])
    swept = open_named(store).gc(older_than=timedelta(days=older_than_days), dry_run=dry_run)
    return _print(swept.model_dump(mode="json")) if json_ else (Console().print(swept), OK)[1]


@app.command
def pin(key: str, reason: str, *, store: Location = None) -> int:
    """Keep an artifact, and all it was made from, when the store is swept.

    Args:
        key: Its key, or how that begins.
        reason: Stands beside it.
    """
    opened = open_named(store)
    opened.pin(_address(opened, key), reason)
    return OK


@app.command
def unpin(key: str, *, store: Location = None) -> int:
    """Let go of a pinned artifact.

    Args:
        key: Its key, or how that begins.
    """
    opened = open_named(store)
    opened.unpin(_address(opened, key))
    return OK


def _address(store: Store, key: str) -> Address:
    found = [entry.address for entry in store.list() if entry.address.key.startswith(key)]
    if len(found) != 1:
        raise Refused(f"{len(found)} artifacts have a key that begins with {key!r}; see `physavatar artifacts ls`")
    return found[0]


def _print(value: Any) -> int:
    sys.stdout.write(json.dumps(value, indent=1) + "\n")
    return OK
