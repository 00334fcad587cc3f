"""`physavatar effects`: what a diagnosis can name, and the numerics that it takes off first."""

import json
import sys
from typing import Annotated, Any

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from flows.cli_options import Json
from flows.config import load
from flows.endings import OK
from tasks.effects.effect import Effect, Strength
from tasks.effects.library import library

COLUMNS = ("name", "kind", "symbol", "unit", "zero", "typical", "range", "confused with")


def effects(
    *,
    json_: Json = False,
    markdown: Annotated[bool, Parameter(name="--markdown", negative="")] = False,
) -> int:
    """Every effect of the library and of `effects_folder`: its strengths, their units and ranges, and what some recordings cannot tell from
    it.

    Args:
        json_: Machine-readable JSON on stdout.
        markdown: A table in Markdown on stdout, as in tasks/effects/README.md.
    """
    found = library(load().effects_folder)
    if json_:
        sys.stdout.write(json.dumps([_plain(e) for e in found.values()], indent=1) + "\n")
        return OK
    rows = [_row(e, s, first=i == 0) for e in found.values() for i, s in enumerate(e.strengths)]
    if markdown:
        lines = [COLUMNS, ["---"] * len(COLUMNS), *rows]
        sys.stdout.write("".join(f"| {' | '.join(line)} |\n" for line in lines))
        return OK
    table = Table(*COLUMNS, box=None, header_style="bold")
    table.columns[0].no_wrap = True
    for row in rows:
        table.add_row(*row)
    Console().print(table)
    return OK


def _plain(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "kind": effect.kind,
        "strengths": [vars(s) | {"zero": 0.0, "column": c} for s, c in zip(effect.strengths, effect.columns, strict=True)],
        "keeps": sorted(effect.keeps),
        "confused_with": sorted(effect.confused_with),
    }


def _row(effect: Effect, s: Strength, *, first: bool) -> list[str]:
    """One line per strength; what belongs to the effect stands in its first."""
    name, kind, confused = (effect.name, effect.kind, ", ".join(sorted(effect.confused_with))) if first else ("", "", "")
    return [name, kind, s.symbol, s.unit, "0", f"{s.typical:g}", f"{s.low:g} … {s.high:g}", confused]
