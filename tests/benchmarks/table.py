"""What `make bench` prints: metric | value | target | holds, each row as soon as it is measured; JSON=1: the same rows as a list on stdout.

A benchmark of several parts runs those whose name holds the word ONLY, all of them where it is not set.
"""

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping

Row = tuple[str, float, str, bool | None]  # metric, value, target, whether it holds; None where nothing is asked
ANSWER = {True: "yes", False: "NO", None: "-"}


def show(rows: Iterable[Row]) -> None:
    """Print the rows."""
    as_json, table = bool(os.environ.get("JSON")), []
    if not as_json:
        sys.stdout.write(f"{'metric':75s} | {'value':>10s} | {'target':10s} | holds\n")
    for metric, value, target, holds in rows:
        table.append({"metric": metric, "value": float(f"{value:.4g}"), "target": target, "holds": None if holds is None else bool(holds)})
        if not as_json:
            sys.stdout.write(f"{metric:75s} | {value:10.4g} | {target:10s} | {ANSWER[table[-1]['holds']]}\n")
            sys.stdout.flush()
    if as_json:
        sys.stdout.write(json.dumps(table, indent=1) + "\n")


def chosen(parts: Mapping[str, Callable[[], Iterable[Row]]]) -> Iterator[Row]:
    """Rows of the parts that ONLY asks for."""
    for name, part in parts.items():
        if os.environ.get("ONLY", "") in name:
            yield from part()
