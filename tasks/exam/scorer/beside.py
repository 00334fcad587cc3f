"""The figures of rivals beside those of the diagnosis on the same cases."""

from collections.abc import Iterable, Mapping
from string import ascii_uppercase
from typing import Any


def columns(result: Mapping[str, Any]) -> dict[str, dict[str, float | None]]:
    """heading -> metric -> value, headings with the number of cases.

    The diagnosis comes first with all cases, and again before a rival that answered others than anybody before it, with those.
    """
    found = {f"diagnosis ({result['cases']})": _values(result["figures"])}
    shown = {_cases(result["rows"])}
    for name, rival in result["rivals"].items():
        if (cases := _cases(rival["rows"])) not in shown:
            shown.add(cases)
            found[f"diagnosis, the cases of {name} ({rival['cases']})"] = _values(rival["ours"])
        found[f"{name} ({rival['cases']})"] = _values(rival["figures"])
    return found


def letters(names: Iterable[str]) -> dict[str, str]:
    """letter -> heading: eight names would leave a table no room for its figures."""
    return dict(zip(ascii_uppercase, names, strict=False))


def _cases(rows: Iterable[Mapping[str, Any]]) -> frozenset[tuple[int, int]]:
    """Seed and number of each."""
    return frozenset((row["seed"], row["number"]) for row in rows)


def _values(figures: Iterable[Mapping[str, Any]]) -> dict[str, float | None]:
    return {f["metric"]: f["value"] for f in figures}
