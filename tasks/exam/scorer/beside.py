"""The figures of rivals beside those of the diagnosis on the same cases."""

from collections.abc import Iterable, Mapping
from string import ascii_uppercase
from typing import Any


def columns(result: Mapping[str, Any]) -> dict[str, dict[str, float | None]]:
    """heading -> metric -> value, headings with the number of cases.

    The diagnosis comes first with all cases, and again before rivals that answered fewer, with theirs.
    """
    found = {f"diagnosis ({result['cases']})": _values(result["figures"])}
    for name, rival in result["rivals"].items():
        found.setdefault(f"diagnosis ({rival['cases']})", _values(rival["ours"]))
        found[f"{name} ({rival['cases']})"] = _values(rival["figures"])
    return found


def letters(names: Iterable[str]) -> dict[str, str]:
    """letter -> heading: eight names would leave a table no room for its figures."""
    return dict(zip(ascii_uppercase, names, strict=False))


def _values(figures: Iterable[Mapping[str, Any]]) -> dict[str, float | None]:
    return {f["metric"]: f["value"] for f in figures}
