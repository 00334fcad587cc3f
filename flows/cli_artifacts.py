"""`physavatar artifacts`: look into the store."""

import json
import sys
from datetime import timedelta
from typing import Annotated, Any

from cyclopts import App, Parameter
from rich.console import Console
from rich.table import Table

from flows.cli_store import StorePlace, open_named
from flows.endings import OK, STAGE_FAILED, Refused

app = App(name="artifacts", help="Look into the store: ls, show, verify, gc.")
Json = Annotated[bool, Parameter(name="--json", negative="")]


@app.command
def ls(
    actor: str | None = None, *, sequence: str | None = None, stage: str | None = None, store: StorePlace = None, json_: Json = False
) -> int:
    """All artifacts, or those of one actor, sequence or stage."""
    entries = open_named(store).list(actor, sequence, stage)
    if json_:
        return _print([entry.model_dump(mode="json") if hasattr(entry, "model_dump") else _plain(entry) for entry in entries])
    table = Table("actor", "sequence", "stage", "key", "schema", "MB", box=None, header_style="bold")
    for entry in entries:
        at = entry.address
        schema = f"{entry.schema_name} v{entry.schema_version}" if entry.schema_name else "damaged"
        table.add_row(at.actor, at.sequence, at.stage, at.key[:12], schema, f"{entry.bytes / 1e6:.2f}")
    Console().print(table)
    return OK


@app.command
def show(key: str, *, store: StorePlace = None) -> int:
    """Manifest and provenance of the artifact whose key begins so, as JSON."""
    opened = open_named(store)
    found = [entry.address for entry in opened.list() if entry.address.key.startswith(key)]
    if len(found) != 1:
        raise Refused(f"{len(found)} artifacts have a key that begins with {key!r}; see `physavatar artifacts ls`")
    folder = opened.folder(found[0])
    return _print(
        {name: json.loads((folder / f"{name}.json").read_text()) for name in ("manifest", "provenance")} | {"folder": str(folder)}
    )


@app.command
def verify(*, store: StorePlace = None, json_: Json = False) -> int:
    """Read every byte of every artifact and compare it with what was published."""
    faults = open_named(store).verify()
    if json_:
        _print([str(fault) for fault in faults])
    else:
        Console().print("\n".join(map(str, faults)) or "clean", highlight=False, markup=False)
    return STAGE_FAILED if faults else OK


@app.command
def gc(*, older_than_days: float = 7.0, dry_run: bool = False, store: StorePlace = None, json_: Json = False) -> int:
    """Remove artifacts that nothing refers to any more and what dead processes left behind."""
    swept = open_named(store).gc(older_than=timedelta(days=older_than_days), dry_run=dry_run)
    return _print(_plain(swept)) if json_ else (Console().print(swept), OK)[1]


def _plain(value: Any) -> Any:
    return {k: str(v) if not isinstance(v, int | float | None) else v for k, v in vars(value).items()}


def _print(value: Any) -> int:
    sys.stdout.write(json.dumps(value, indent=1, default=str) + "\n")
    return OK
