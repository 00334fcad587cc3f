"""The figures of a diagnosis' report, each from plain numbers to a matplotlib figure."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from tasks.gap.budget import Item
from tasks.gap.confusability import SHOWN, Confusability
from tasks.gap.constancy import Constancy
from tasks.gap.hypotheses import Fitted
from tasks.gap.residual import rms_mm
from tasks.gap.spectrum import Spectrum
from tasks.gap.stretches import Stretch
from tasks.gap.verdict import Candidate
from tasks.geometry.meshes import face_normals

Array = NDArray[np.float64]
Faces = NDArray[np.int32]

BEFORE, AFTER, FLOOR, TRAINED, LINE = "#c2410c", "#15803d", "#6b7280", "#1d4ed8", "#dde3ea"
PARTS = {"base": "#94a3b8", "numerics": "#64748b", "effect": AFTER, "unexplained": BEFORE, "noise": "#cbd5e1"}
VIEWS = (("front", 20.0), ("back", 200.0))  # [°] about the vertical
ELEVATION = 12.0  # [°]
GREY = (0.75, 0.75, 0.75)
MOST_RECORDINGS = 6
WEAKEST = -3.0  # evidence that is drawn; less is as little
MOST_BARS = 24


def waterfall(items: Sequence[Item]) -> Figure:
    """The budget from the misfit at the start down to nothing."""
    total = sum(i.misfit for i in items)
    canvas = Figure(figsize=(8, 0.5 + 0.42 * (len(items) + 1)))
    axes = canvas.add_subplot()
    names, top = ["before any fit", *(i.name for i in items)], total
    axes.barh(0, total, color="#334155")
    axes.text(total, 0, f" {total:.3f}", va="center")
    for k, item in enumerate(items, 1):
        axes.barh(k, item.misfit, left=top - item.misfit, color=PARTS[item.part])
        axes.plot([top, top], [k - 1.4, k + 0.4], color="#334155", lw=0.7)
        axes.text(
            max(top, top - item.misfit), k, f" {round(item.misfit, 3) + 0.0:.3f}  ({round(item.misfit / total, 2) + 0.0:.0%})", va="center"
        )
        top -= item.misfit
    axes.set(
        yticks=range(len(names)),
        yticklabels=names,
        xlabel="misfit per coordinate (white noise of the tracker: about 1)",
        xlim=(0, 1.22 * total),
    )
    axes.invert_yaxis()
    _plain(axes)
    return canvas


def maps(x: Array, faces: Faces, uv: Array | None, shown: Mapping[str, tuple[Array, str]]) -> Figure:
    """Quantities title -> (values [V], unit) on the cloth x [V, 3] m from two sides, and in the pattern uv [F, 3, 2] m where there is one."""
    columns = len(VIEWS) + (uv is not None)
    canvas = Figure(figsize=(3.1 * columns + 0.8, 3.3 * len(shown)), layout="constrained")
    grid = canvas.subplots(len(shown), columns, squeeze=False)
    for row, (title, (values, unit)) in zip(grid, shown.items(), strict=True):
        face = np.mean(values[faces], axis=1)
        top = float(np.nanpercentile(face, 98)) if np.isfinite(face).any() else 1.0
        scale = Normalize(0, top if top > 0 else 1.0)  # forcing may be zero everywhere
        for axes, (name, azimuth) in zip(row, VIEWS, strict=False):
            _garment(axes, x, faces, _colours(face, scale), azimuth)
            axes.set_title(f"{title}, {name}", fontsize=9)
        if uv is not None:
            _polygons(row[-1], uv, _colours(face, scale))
            row[-1].set_title(f"{title}, pattern (u across, v up)", fontsize=9)
        canvas.colorbar(ScalarMappable(scale, "inferno"), ax=list(row), label=unit, shrink=0.8, extend="max")
    return canvas


def _colours(face: Array, scale: Normalize) -> Array:
    rgb = colormaps["inferno"](scale(np.nan_to_num(face)))[:, :3]
    return np.where(np.isfinite(face)[:, None], rgb, GREY)


def _garment(axes, x: Array, faces: Faces, colour: Array, azimuth: float) -> None:
    """Painter's algorithm: the farthest faces first; a little shade lets folds be seen."""
    a, e = np.radians([azimuth, ELEVATION])
    R = np.array([[1, 0, 0], [0, np.cos(e), -np.sin(e)], [0, np.sin(e), np.cos(e)]]) @ [
        [np.cos(a), 0, -np.sin(a)],
        [0, 1, 0],
        [np.sin(a), 0, np.cos(a)],
    ]
    seen = x @ R.T
    order = np.argsort(seen[faces, 2].mean(1))
    shade = 0.72 + 0.28 * np.abs(face_normals(seen, faces)[:, 2:])
    _polygons(axes, seen[faces][order][..., :2], (colour * shade)[order])


def _polygons(axes, corners: Array, colour: Array) -> None:
    axes.add_collection(PolyCollection(corners, facecolors=colour, edgecolors=colour, linewidths=0.3, rasterized=True))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.axis("off")


def timeline(
    training: Sequence[tuple[int, int, Array]], kept: Sequence[Stretch], *, own: bool, held: bool, fps: float, floor_mm: float
) -> Figure:
    """Error of every frame. training: (recording, start, mm [L]) of each window; kept: windows with before and after.

    own: kept windows are of the same recordings as the training; else they get axes of their own. held: kept out of the fit.
    """
    kept, beside = kept if held else (), own and held
    rows = [
        (f"recording {k + 1}", [w for w in training if w[0] == k], [s for s in kept if beside and s.window.recording == k])
        for k in sorted({w[0] for w in training})
    ]
    if not beside:
        rows += [
            (f"held-out recording {k + 1}", [], [s for s in kept if s.window.recording == k])
            for k in sorted({s.window.recording for s in kept})
        ]
    rows = rows[:MOST_RECORDINGS]
    canvas = Figure(figsize=(9, 0.6 + 1.9 * len(rows)), layout="constrained")
    grid = canvas.subplots(len(rows), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
    for axes, (title, trained, rest) in zip(grid, rows, strict=True):
        for _, start, mm in trained:
            _frames(axes, start, {"trained": (mm, TRAINED)}, "#eff4ff", fps)
        for s in rest:
            lines = {"before": (_each_frame_mm(s.before), BEFORE)}
            if not np.array_equal(s.after, s.before, equal_nan=True):  # something is named
                lines["after"] = (_each_frame_mm(s.after), AFTER)
            _frames(axes, s.window.start, lines, "#fff5e6", fps)
        axes.axhline(floor_mm, color=FLOOR, ls="--", lw=1, label="floor")
        axes.set_title(title, fontsize=9)
        axes.set_ylabel("rms mm")
        axes.grid(alpha=0.3)
        by_label = {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
        axes.legend(by_label.values(), by_label.keys(), fontsize=8, loc="lower right", ncols=4)
    grid[0].set_ylim(0, 1.1 * max(np.nanmax(line.get_ydata()) for axes in grid for line in axes.lines))
    grid[-1].set_xlabel("time s")
    return canvas


def _each_frame_mm(r: Array) -> Array:
    return np.array([rms_mm(frame) for frame in r])


def _frames(axes, start: int, lines: Mapping[str, tuple[Array, str]], ground: str, fps: float) -> None:
    length = len(next(iter(lines.values()))[0])
    t = (start + 1 + np.arange(length)) / fps
    axes.axvspan(start / fps, (start + length) / fps, facecolor=ground, edgecolor="#b6c2d1", lw=0.6)
    for label, (mm, colour) in lines.items():
        axes.plot(t, mm, color=colour, marker="o", ms=2.5, lw=1.2, label=label)


def spectra(before: Spectrum, after: Spectrum | None) -> Figure:
    """Offset and bands of the residual within windows."""
    canvas = Figure(figsize=(6, 2.9), layout="constrained")
    axes, k = canvas.add_subplot(), np.arange(len(before.frequency))
    _side_by_side(axes, before.rms_mm, None if after is None else after.rms_mm)
    axes.step(
        np.r_[k - 0.5, k[-1] + 0.5],
        np.r_[before.noise_mm, before.noise_mm[-1]],
        where="post",
        color=FLOOR,
        ls="--",
        lw=1,
        label="noise alone",
    )
    axes.set(xticks=k, xticklabels=["offset of\na window", *(f"{f:.3g} Hz" for f in before.frequency[1:])], ylabel="rms mm")
    _headroom(axes)
    return canvas


def split_bars(before: Mapping[str, float], after: Mapping[str, float] | None) -> Figure:
    """Residual by direction, before and after."""
    canvas = Figure(figsize=(6, 2.6), layout="constrained")
    axes, k = canvas.add_subplot(), np.arange(len(before))
    _side_by_side(axes, list(before.values()), None if after is None else list(after.values()))
    axes.set(xticks=k, xticklabels=list(before), ylabel="rms mm")
    _headroom(axes)
    return canvas


def evidence(ranking: Sequence[Candidate]) -> Figure:
    """The evidence of every hypothesis in the order of the ranking; those that cannot be told apart share a box and a probability."""
    rows, boxes = [], []
    for candidate in ranking:
        fitted = [h for h in (candidate.fitted, *candidate.others) if h is not None]
        boxes.append((len(rows), max(len(fitted), 1), candidate.probability))
        rows += [(_with_replays(h), max(h.evidence, WEAKEST)) for h in fitted] or [(candidate.names[0].replace("_", " "), None)]
        if len(rows) >= MOST_BARS:
            break
    canvas = Figure(figsize=(8.5, 0.7 + 0.27 * len(rows)))
    axes = canvas.add_subplot()
    known = [e for _, e in rows if e is not None]
    top, low = max([1.0, *known]), min([0.0, *known])
    for start, count, probability in boxes:
        edge, weight = ("#334155" if count > 1 else LINE), ("bold" if start == 0 else "normal")
        ground = "#eef6f0" if start == 0 else "none"
        axes.add_patch(Rectangle((low - 0.01 * top, start - 0.47), 1.2 * top - low, count - 0.06, facecolor=ground, edgecolor=edge, lw=1.1))
        axes.text(1.18 * top, start + count / 2 - 0.5, f"{probability:.1%}", ha="right", va="center", fontsize=9, weight=weight)
    for k, (name, own) in enumerate(rows):
        if own is None:
            words = "zero of the scale" if name == "none" else "no evidence of its own: what the library leaves"
            axes.text(low + 0.01 * (top - low), k, words, va="center", fontsize=8, color=FLOOR)
    axes.barh(range(len(rows)), [own or 0.0 for _, own in rows], height=0.6, color=TRAINED)
    axes.set(yticks=range(len(rows)), yticklabels=[n for n, _ in rows], xlim=(low - 0.02 * top, 1.21 * top), ylim=(len(rows) - 0.4, -0.6))
    axes.set_xlabel("evidence: log Bayes factor against “none”        (right: probability)")
    axes.tick_params(axis="y", labelsize=8)
    _plain(axes)
    return canvas


def _with_replays(h: Fitted) -> str:
    """Name of a hypothesis, with what its replays of whole recordings add to its evidence where it was simulated."""
    return h.name if h.support is None else f"{h.name}  (replays {round(h.support, 1) + 0.0:+.1f})"


def confusability_matrix(c: Confusability) -> Figure:
    """Cosines of signatures, and how many standard deviations each effect makes at typical strength."""
    n = len(c.names)
    canvas = Figure(figsize=(5.6 + 0.36 * n, 1.9 + 0.36 * n), layout="constrained")
    axes, side = canvas.subplots(1, 2, sharey=True, width_ratios=(n, 5))
    axes.imshow(c.cosine, cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto")
    for i in range(n):
        for j in range(n):
            if i != j and abs(c.cosine[i, j]) >= 0.1:
                axes.text(
                    j,
                    i,
                    f"{c.cosine[i, j]:.2f}".replace("0.", "."),
                    ha="center",
                    va="center",
                    fontsize=7,
                    color="white" if abs(c.cosine[i, j]) > 0.7 else "black",
                )
    axes.set(xticks=range(n), yticks=range(n), yticklabels=c.names, title="cosine of signatures")
    axes.set_xticklabels(c.names, rotation=50, ha="right", rotation_mode="anchor")
    shown = np.maximum(c.detectability, 0.05)
    side.barh(range(n), shown, color=np.where(c.testable, TRAINED, "#f3b8a2"), height=0.6)
    for i, d in enumerate(c.detectability):
        side.text(
            max(shown[i], SHOWN) * 1.15,
            i,
            f"{d:.3g} σ" if c.testable[i] else f"{d:.2g} σ: not testable on this recording",
            va="center",
            fontsize=7,
        )
    side.axvline(SHOWN, color=FLOOR, ls="--", lw=1)
    side.set(xscale="log", xlim=(0.05, 60 * max(shown.max(), SHOWN)), title="testability at typical strength", xlabel="σ")
    for a in (axes, side):
        a.tick_params(labelsize=8)
        a.title.set_size(9)
    _plain(side)
    return canvas


def constancy(groupings: Mapping[str, Mapping[str, Constancy]]) -> Figure:
    """grouping -> effect: the multiple of the strength found that each part of the recording asks for, with 90 % intervals."""
    effects = list(next(iter(groupings.values())))
    widths = [max(3, len(next(iter(own.values())).places)) for own in groupings.values()]
    canvas = Figure(figsize=(9, 2.7 * len(effects)), layout="constrained")
    grid = canvas.subplots(len(effects), len(groupings), squeeze=False, width_ratios=widths)
    for j, (grouping, own) in enumerate(groupings.items()):
        for i, name in enumerate(effects):
            axes, c = grid[i, j], own[name]
            k = np.arange(len(c.places))
            axes.axhline(1, color=FLOOR, ls="--", lw=1)
            axes.axhline(0, color="#334155", lw=0.6)
            axes.errorbar(k, c.multiples, 1.645 * c.deviations, fmt="o", color=TRAINED, ms=4, capsize=2, lw=1.2)
            axes.set(xticks=k, xticklabels=c.places, xlim=(-0.6, len(k) - 0.4))
            axes.set_title(f"by {grouping}: Q = {c.Q:.3g} on {c.freedom}" if c.freedom else f"by {grouping}", fontsize=9)
            axes.tick_params(labelsize=8)
            _plain(axes, axis="y")
        grid[-1, j].set_xlabel("")
    for i, name in enumerate(effects):
        grid[i, 0].set_ylabel(f"{name}\nmultiple of the strength", fontsize=8)
    return canvas


def kept_out(kept: Sequence[Stretch], floor_mm: float) -> Figure:
    """Error of each window before and after, beside the floor."""
    canvas = Figure(figsize=(8, 2.8), layout="constrained")
    axes, k = canvas.add_subplot(), np.arange(len(kept))
    axes.bar(k - 0.2, [s.before_mm for s in kept], 0.4, color=BEFORE, label="before: refitted base")
    axes.bar(k + 0.2, [s.after_mm for s in kept], 0.4, color=AFTER, label="after: with the named effect")
    axes.axhline(floor_mm, color=FLOOR, ls="--", lw=1, label="floor: noise and discretisation")
    axes.set(xticks=k, xticklabels=[f"{s.window.recording + 1}: {s.window.start}–{s.window.start + s.window.length}" for s in kept])
    axes.set(
        ylabel="rms mm",
        xlabel="recording: frames of the window",
        ylim=(0, 1.35 * max([s.before_mm for s in kept] + [s.after_mm for s in kept] + [floor_mm])),
    )
    axes.tick_params(axis="x", labelsize=8, rotation=0 if len(kept) < 9 else 60)
    axes.legend(fontsize=8, ncols=3, loc="upper right")
    _plain(axes, axis="y")
    return canvas


def _side_by_side(axes, before: Sequence[float], after: Sequence[float] | None) -> None:
    """Bars before and after; where nothing is named, those before alone, over their names."""
    k = np.arange(len(before))
    axes.bar(k if after is None else k - 0.2, before, 0.4, color=BEFORE, label="before")
    if after is not None:
        axes.bar(k + 0.2, after, 0.4, color=AFTER, label="after")


def _headroom(axes) -> None:
    """A legend above the bars."""
    axes.set_ylim(0, 1.25 * axes.get_ylim()[1])
    axes.legend(fontsize=8, ncols=3, loc="upper right")
    _plain(axes, axis="y")


def _plain(axes, axis: str = "x") -> None:
    axes.grid(alpha=0.3, axis=axis)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
