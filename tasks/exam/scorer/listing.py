"""What each case was asked and what was answered, and which truth got which answers, as Markdown tables: the rows behind the figures."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from tasks.exam.scorer.summary import confusion

HEAD = (
    "case",
    "planted (times the floor)",
    "answer",
    "credit",
    "probability of the truth",
    "names in the 90 % set",
    "gap closed, predicted blind",
    "s",
)
FORMS = {"credit": ".2g", "probability_of_truth": ".2f", "set_size": "d", "closed": ".2f", "seconds": ".0f"}
Row = Mapping[str, Any]


def listing(rows: Iterable[Row]) -> Iterator[str]:
    """Lines of the table, in the order of the cases' numbers."""
    yield _line(HEAD)
    yield _line("---" for _ in HEAD)
    for row in sorted(rows, key=lambda row: row["number"]):
        yield _line((str(row["number"]), _planted(row), _answer(row), *(_told(row.get(key), form) for key, form in FORMS.items())))


def confusions(rows: Iterable[Row]) -> Iterator[str]:
    """Lines of the confusion matrix, one per truth: its cases and its answers, the most frequent first."""
    truths, answers, table = confusion(rows)
    yield _line(("truth", "cases", "answered"))
    yield _line("---" for _ in range(3))
    for truth, counts in zip(truths, table, strict=True):
        told = sorted(
            (-count, answer.replace(" | ", " or ").replace("_", " ")) for count, answer in zip(counts, answers, strict=True) if count
        )
        yield _line((truth.replace("_", " "), str(counts.sum()), "; ".join(f"{answer} {-count}" for count, answer in told)))


def _planted(row: Row) -> str:
    causes = " + ".join(row["causes"]) or "nothing"
    how = {"pair": "", "single": "", "outside": ", outside the library"}.get(row["stratum"], f", {row['twist'] or row['stratum']}")
    how = ", which the library lacks" if row["withheld"] else how.replace("_", " ")
    return f"{causes}{how}" + (f" ({row['multiple']:.1f})" if row["causes"] else "")


def _answer(row: Row) -> str:
    if row["failed"]:
        return "no answer"
    what = ", ".join(row["named"]) if row["kind"] == "effect" else row["kind"].replace("_", " ")
    return f"{what}, {row['confidence']:.2f}"


def _told(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
