"""The result of an exam as one HTML page: figures with intervals, the confusion matrix, and every case."""

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from tasks.exam.scorer.beside import columns, letters
from tasks.exam.scorer.engine import heading
from tasks.exam.scorer.summary import confusion

STYLE = (
    "body{font:15px/1.45 system-ui;margin:2rem;max-width:75rem}table{border-collapse:collapse;margin:1rem 0}"
    "td,th{padding:.15rem .4rem;text-align:left;border-bottom:1px solid #ddd}td.n{text-align:right}td:first-child{white-space:nowrap}"
    ".m td{text-align:center;font-size:12px}.m th{font-size:12px;font-weight:400}.m thead th{writing-mode:vertical-rl;transform:rotate(180deg)}"
)


def page(result: Mapping[str, Any], rests_on: Mapping[tuple[int, int], str] | None = None) -> str:
    """HTML of the result of `flows.exam.sit`; rests_on: seed and number of a case -> address of the diagnosis' own page, where there is one."""
    pooled = " (all attempts pooled)" if result["split"] == "sealed" else ""
    of = f"Split {escape(result['split'])}, version {result['version'][:12]}{pooled}: {result['cases']} cases."
    left = f"<p>Left out, because no garment drawn for them could be simulated: {result['left_out']}.</p>" if result["left_out"] else ""
    apart = "".join(f"<h2>{escape(heading(other))}</h2>{_figures(other)}{_matrix(other['rows'])}" for other in result["apart"].values())
    cases = _cases(result["rows"], rests_on or {})
    return (
        f"<!doctype html><meta charset='utf-8'><title>Blind check</title><style>{STYLE}</style><h1>Blind check of the diagnosis</h1>"
        f"<p>{of} Shares carry Wilson's 95 % interval, other figures a bootstrap over cases.</p>"
        f"<p>{escape(heading(result))}.</p>{left}{_figures(result)}{_rivals(result)}<h2>What was named for what</h2>{_matrix(result['rows'])}{apart}<h2>Cases</h2>{cases}"
    )


def _figures(result: Mapping[str, Any]) -> str:
    return _table(
        ("metric", "value", "95 %", "cases"),
        ((f["metric"], number(f["value"]), interval(f), f["cases"]) for f in result["figures"]),
    )


def _cases(rows: Iterable[Mapping[str, Any]], rests_on: Mapping[tuple[int, int], str]) -> str:
    shown = ("stratum", "twist", "causes", "multiple", "kind", "named", "credit", "auc", "closed", "seconds")

    def number_of(row: Mapping[str, Any]) -> str:
        address = rests_on.get((row["seed"], row["number"]))
        return f"<a href='{escape(address)}'>{row['number']}</a>" if address else str(row["number"])

    return _marked_up(("number", *shown), ([number_of(r), *(escape(_cell(r.get(c))) for c in shown)] for r in rows))


def _rivals(result: Mapping[str, Any]) -> str:
    """Rivals beside the diagnosis, and what they named for what."""
    if not result["rivals"]:
        return ""
    beside = columns(result)
    metrics = [f["metric"] for f in result["figures"]]
    named = letters(beside)
    legend = "".join(f"<li>{letter} {escape(name)}</li>" for letter, name in named.items())
    table = _table(("metric", *named), ((m, *(number(values.get(m)) for values in beside.values())) for m in metrics))
    matrices = "".join(
        f"<details><summary>{escape(name)}: what it named for what</summary>{_matrix(rival['rows'])}</details>"
        for name, rival in result["rivals"].items()
    )
    return f"<h2>Rivals on the same cases</h2><p>In brackets: how many cases each answered.</p><ul>{legend}</ul>{table}{matrices}"


def _matrix(rows: list[Mapping[str, Any]]) -> str:
    truths, answers, table = confusion(rows)
    head = "".join(f"<th>{escape(a)}</th>" for a in answers)
    most = max(int(table.max()), 1) if table.size else 1
    body = ""
    for truth, line in zip(truths, table, strict=True):
        cells = "".join(f"<td style='background:rgba(40,110,180,{n / most:.2f})'>{n or ''}</td>" for n in line)
        body += f"<tr><th>{escape(truth)}</th>{cells}</tr>"
    return f"<table class='m'><thead><tr><th></th>{head}</tr></thead>{body}</table>"


def _table(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    return _marked_up(head, ((escape(str(c)) for c in r) for r in rows))


def _marked_up(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table whose cells are HTML already."""
    top = "".join(f"<th>{escape(h)}</th>" for h in head)
    return f"<table><tr>{top}</tr>" + "".join(f"<tr>{''.join(f'<td>{c}</td>' for c in r)}</tr>" for r in rows) + "</table>"


def _cell(value: Any) -> str:
    return (
        ", ".join(map(str, value))
        if isinstance(value, list)
        else ""
        if value is None
        else number(value)
        if isinstance(value, float)
        else str(value)
    )


def number(value: float | None) -> str:
    """Three digits, or all before the point; a dash for nothing."""
    return "–" if value is None else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def interval(figure: Mapping[str, Any]) -> str:
    """Of a figure of the summary; nothing where no case gave it a value, or no interval."""
    return "" if figure["value"] is None or figure["low"] is None else f"{number(figure['low'])} … {number(figure['high'])}"
