"""The report of a diagnosis: one self-contained page for a reader who doubts it."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from tasks.cloth.windows import Recording
from tasks.gap.account import Account, Splits, account, as_json
from tasks.gap.confusability import SHOWN
from tasks.gap.constancy import Constancy
from tasks.gap.diagnosis import Diagnosis
from tasks.gap.next_recording import SECONDS
from tasks.gap.residual import rms_mm
from tasks.report import gap_figures as figures
from tasks.report.page import Figure, Section, Table, page
from tasks.report.pictures import figure_uri


def gap_report(
    answer: dict[str, Any], found: Diagnosis, recordings: Sequence[Recording], *, title: str, subtitle: str, own: bool = True
) -> tuple[bytes, bytes]:
    """The page, and as JSON the answer with every figure in the page; own: as of `gap_page`."""
    told = account(found, recordings)
    html = gap_page(answer, found, told, title=title, subtitle=subtitle, own=own)
    return html.encode(), json.dumps(answer | {"evidence": as_json(told, found)}, indent=1, allow_nan=False).encode()


def gap_page(answer: dict[str, Any], found: Diagnosis, told: Account, *, title: str, subtitle: str, own: bool = True) -> str:
    """HTML of the public answer, the diagnosis and its account; own: what was held out are ends of the same recordings, not files."""
    sections = [_verdict(answer, found)]
    if told.items:
        sections += [
            _budget(told),
            _where(found, told),
            _timeline(found, told, own=own),
            _motion(told),
            _ranking(found),
            _confusability(told),
            *([constancy_section(told.constancy, told.rivals)] if told.constancy else []),
            *([_kept(answer, found, told)] if told.stretches else []),
        ]
    return page(title, subtitle, answer["verdict"]["sentence"], [*sections, _next(answer, found)])


def _plot(canvas: Any, caption: str) -> Figure:
    return Figure(figure_uri(canvas), caption, plot=True)


def _verdict(answer: dict[str, Any], found: Diagnosis) -> Section:
    gap, v, replayed = answer["gap"], answer["verdict"], found.replayed
    on = "motion kept out of the fit" if gap["held_out"] else "the training windows"
    on += ", recordings replayed in one run" if found.shrinkage.replayed else ""
    rows = [
        ["verdict", v["kind"].replace("_", " ")],
        ["probability", v["probability"]],
        ["names that hold 90 % of it", ", ".join(answer["answer_set_90"])],
        ["gap before [mm]", gap["before_mm"]],
        ["gap after [mm]", gap["after_mm"]],
        ["floor [mm]", gap["floor_mm"]],
        ["closed of what can be closed", _interval(gap["closed_fraction"], gap["low"], gap["high"])],
        ["measured on", on],
    ]
    if replayed is not None and np.isfinite(replayed.ratio2):
        rows += [
            ["base model replayed over whole recordings, frames weighed by their floors: gap [mm]", 1e3 * replayed.gap**0.5],
            ["floor of that: a replay on a finer mesh from another start, noise [mm]", 1e3 * replayed.floor**0.5],
            ["log Bayes factor from there that anything is missing", replayed.something_missing],
        ]
    strengths = [
        [name, s["value"], s["low"], s["high"], s["unit"], row["probability"]]
        for row in answer["ranking"][:6]
        for name, s in row["strength"].items()
    ]
    fabric = [[name, p["value"], p["low"], p["high"], p["unit"]] for name, p in answer["parameters"].items()]
    tables = [Table(["", ""], rows)]
    tables += (
        [Table(["effect, leader of its class", "strength", "low (90 %)", "high", "unit", "probability of the class"], strengths)]
        if strengths
        else []
    )
    tables += [Table(["base parameter", "value", "low (90 %)", "high", "unit"], fabric)] if fabric else []
    return Section("Verdict", tables=tables)


def _interval(value: float | None, low: float | None, high: float | None) -> str | None:
    interval = "" if low is None else f", 90 % interval {low:.0%} to {high:.0%}"
    return None if value is None else f"{value:.0%}{interval}"


def _budget(told: Account) -> Section:
    several = sum(i.part == "effect" for i in told.items) > 1
    caption = "What each step takes from the misfit, judged on windows that it was not fitted on." + (
        " Compound causes share by their Shapley values." if several else ""
    )
    words = [
        "Unexplained is what stays above white noise when everything named is in: if it is large beside the named bars, doubt the name."
    ]
    return Section("Gap budget", words, figures=[_plot(figures.waterfall(told.items), caption)])


def _where(found: Diagnosis, told: Account) -> Section:
    cloth = found.base.subject.cloth
    shown = {"residual": (told.residual_mm, "rms mm"), "nameless forcing": (told.missing, "rms m/s²")}
    if told.added is not None:
        shown["added by the named effect"] = (told.added, "rms m/s²")
    x = told.evidence[0].prediction.x[0]
    caption = (
        "Residual of the compared windows before the effect. Nameless forcing: force per mass that would close the training windows' residual, most of which the "
        "cloth's own stiffness takes up. Added: by the named effect, where the cloth is and as it moves. Grey: not seen."
    )
    rows = [_split_row(s) for s in told.splits]
    names = list(told.splits[0].before)
    columns = ["zone", "vertices", *(f"{'' if n == 'all' else n + ' '}rms mm" for n in names)]
    words = [
        "The table is of the training windows, what the start state explains taken out; “→” leads to what is left with the named effect at its strength "
        "(linear). Normal, warp and weft are directions of the cloth."
    ]
    picture = _plot(figures.maps(x, cloth.faces, cloth.uv, shown), caption)
    return Section("Where the gap lies", words, [Table(columns, rows)], [picture])


def _split_row(s: Splits) -> list[Any]:
    after = s.after or {}
    return [s.zone, s.vertices, *(f"{mm:.2f} → {after[n]:.2f}" if n in after else float(mm) for n, mm in s.before.items())]


def _timeline(found: Diagnosis, told: Account, *, own: bool) -> Section:
    training = [
        (e.prediction.window.recording, e.prediction.window.start, np.array([rms_mm(r) for r in e.residual]))
        for e in told.evidence
        if e.residual is not None
    ]
    held, fps = found.shrinkage.held_out, found.base.subject.fps
    canvas = figures.timeline(training, told.stretches, own=own, held=held, fps=fps, floor_mm=found.floor_mm)
    caption = "Error of every frame. Blue ground: windows of the fit, before any effect. Amber: windows kept out of it. Every window starts from its own state."
    return Section("When", figures=[_plot(canvas, caption)])


def _motion(told: Account) -> Section:
    drawn = []
    if told.before is not None:
        caption = "The residual within the compared windows: the offset of each, and what moves. Slower than a window cannot be told from an offset."
        drawn.append(_plot(figures.spectra(told.before, told.after), caption))
    directions = {k: v for k, v in told.splits[0].before.items() if k != "all"}
    after = told.splits[0].after and {k: told.splits[0].after[k] for k in directions}
    drawn.append(_plot(figures.split_bars(directions, after), "The residual of the training windows along the cloth's own directions."))
    return Section("Frequencies and directions", figures=drawn)


def _ranking(found: Diagnosis) -> Section:
    caption = (
        "Score of every hypothesis in the order of its probability; in brackets the log Bayes factor of its replays. A box holds effects that this "
        "recording cannot tell apart. Without a bar: "
        "“none”, which is the zero of the scale, and “outside library”."
    )
    return Section("Evidence", figures=[_plot(figures.evidence(found.verdict.ranking), caption)])


def _confusability(told: Account) -> Section:
    c = told.confusability
    words = [
        f"Signatures are whitened; start state, discretisation and base parameters are taken out. Below {SHOWN:g} σ an effect of typical strength would "
        "not show: nothing is said about it, not that it is absent."
    ]
    caption = "Near ±1: only another motion can tell the two apart."
    return Section("What this recording can tell apart", words, figures=[_plot(figures.confusability_matrix(c), caption)])


def constancy_section(named: dict[str, dict[str, Constancy]], rivals: dict[str, dict[str, Constancy]]) -> Section:
    """The multiples that parts of the recording ask for: grouping -> effect of what is named, effect -> grouping of what else leads."""
    words = [
        "A right name has one strength everywhere; a wrong one drifts. Model error makes Q larger than its degrees of freedom for every name: "
        "the name whose scatter is least is the most constant."
    ]
    found = {grouping: own for grouping, own in named.items() if any(c.places for c in own.values())}
    if missing := [grouping for grouping in named if grouping not in found]:
        words.append(f"Too few windows to tell by {' or '.join(missing)}.")
    caption = "The multiple of the strength found that each part of the recording asks for, with 90 % intervals."
    pictures = [_plot(figures.constancy(found), caption)] if found else []
    return Section("Is the strength a constant?", words, [_scatters(rivals)] if rivals else [], pictures)


def _scatters(rivals: dict[str, dict[str, Constancy]]) -> Table:
    """Of every effect alone √(Q/dof) by window and by speed, as far as there are windows enough, and its multiples where all have the same speeds."""
    told = [g for g in ("window", "speed") if any(own[g].places for own in rivals.values())]
    same = {own["speed"].places for own in rivals.values()}
    speeds = same.pop() if len(same) == 1 else ()
    rows = [
        [name, *(own[g].scatter for g in told), *(map(float, own["speed"].multiples) if speeds else ())] for name, own in rivals.items()
    ]
    return Table(["effect alone", *(f"scatter by {g}, √(Q/dof)" for g in told), *(f"multiple, {p}" for p in speeds)], rows)


def _kept(answer: dict[str, Any], found: Diagnosis, told: Account) -> Section:
    held = answer["gap"]["held_out"]
    words = [] if held else ["No window could be kept out of the fit: these are the training windows, and the figures flatter."]
    if found.shrinkage.replayed:
        words = [
            "The verdict rests on recordings replayed in one run, of which these windows were kept out of the fit; each by itself shows less."
        ]
    caption = "Error of each window with the refitted base and with the named effect, beside the floor."
    if found.verdict.named is None:
        caption = "Error of each window with the refitted base, beside the floor; no effect is named, so after is as before."
    heading = "On motion kept out of the fit" if held else "Before and after"
    return Section(heading, words, figures=[_plot(figures.kept_out(told.stretches, found.floor_mm), caption)])


def _next(answer: dict[str, Any], found: Diagnosis) -> Section:
    words = [f"{answer['record_next'][0].upper()}{answer['record_next'][1:]}."]
    if not found.designs:
        return Section("Record this next", words)
    words.append(
        f"What these recordings and {SECONDS:g} s of each motion would tell together, as far as derivatives foretell: by how many standard "
        "deviations the first cause of the pair that is parted worst would stand out beside the second."
    )
    rows = [[d.said, d.apart, " beside ".join(d.pair)] for d in found.designs]
    return Section("Record this next", words, [Table(["motion", "standard deviations", "worst pair"], rows)])


def subtitle(names: Sequence[str], answer: dict[str, Any]) -> str:
    """What was diagnosed, and how long it took."""
    return f"{', '.join(names)} · diagnosed in {answer['seconds']:.0f} s"
