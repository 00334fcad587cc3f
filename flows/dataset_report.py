"""One page over a dataset: every sequence, its verdict, its figures, and where its own report lies."""

from collections.abc import Iterable
from html import escape
from pathlib import Path

from flows.dataset import Sequence
from storage_schemas.faults import StoreFault
from storage_schemas.report import Report
from storage_schemas.store import Store

PAGE = """<!doctype html><meta charset="utf-8"><title>physavatar: dataset</title>
<style>body{{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:70rem}}td,th{{padding:.3rem .8rem;text-align:left;
border-bottom:1px solid #ddd;vertical-align:top}}</style>
<h1>Dataset</h1><p>{summary}</p><table><tr><th>actor<th>sequence<th>verdict<th>fabric</tr>{rows}</table>"""


def write_dataset_report(out: Path, store: Store, sequences: Iterable[Sequence]) -> Path:
    """Write it; stands alone but for the links to the reports in the store."""
    rows = [_row(at, store) for at in sequences]
    made = sum("<a " in row for row in rows)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(PAGE.format(summary=f"{made} of {len(rows)} sequences have a report.", rows="".join(rows)))
    return out


def _row(at: Sequence, store: Store) -> str:
    try:
        ref = store.latest(at.actor, at.sequence, "report")
        summary = store.open(ref, Report).summary if ref else None
    except StoreFault as fault:
        return _cells(at, escape(str(fault)), "")
    if ref is None or summary is None:
        return _cells(at, "no report yet", "")
    verdict = summary["verdict"]["verdict"]["sentence"] if summary.get("verdict") else "not simulated"
    page = store.folder(ref) / "files" / "report.html"
    fabric = "<br>".join(escape(f"{name}: {_fabric(values)}") for name, values in (summary.get("fabric") or {}).items())
    return _cells(at, f'<a href="{escape(page.as_uri())}">{escape(verdict)}</a>', fabric)


def _fabric(values: dict) -> str:
    found = {name: values[name].get("value") for name in ("kappa_s_over_rho", "kappa_b_over_rho") if isinstance(values.get(name), dict)}
    return ", ".join(f"{name} {value:.3g}" if isinstance(value, int | float) else f"{name} –" for name, value in found.items())


def _cells(at: Sequence, verdict: str, fabric: str) -> str:
    return f"<tr><td>{escape(at.actor)}<td>{escape(at.sequence)}<td>{verdict}<td>{fabric}</tr>"
