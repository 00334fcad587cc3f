"""The page of the sleeve's comparison: errors by place, paths over time, and the simulated sleeve on the arm with what was measured."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure as Canvas

from tasks.geometry.cameras import Cameras, project
from tasks.report.page import Figure, Section, Table, page
from tasks.report.pictures import data_uri, draw_mesh, figure_uri, strip
from tests.real.sleeve_model import S2, Sleeve, arm_plate, posed
from tests.real.sleeve_recording import Run, in_arm_frame, read_run

SHOWN_REPEAT = 4
SHOWN = (0.0, 0.25, 0.5, 1.0, 2.0)  # [s] after the first passage through the rest direction
FAR, PIXELS = 30.0, (360, 720)  # [m] of the eye, so that the view is nearly parallel; width, height
AXES = ("along the arm", "across", "out of the swing")
MEASURED, SIMULATED, PAINTED, CLOTH, ARM = "#c2410c", "#1d4ed8", "#9ca3af", (120, 170, 235), (225, 205, 175)


@dataclass(frozen=True)
class Swung:
    """A simulated run: x [T, V, 3] m in the frame of the arm, NaN where the simulation did not get to."""

    run: Run
    garment: Sleeve
    x: np.ndarray
    seconds_per_frame: float

    def at(self, place: int) -> np.ndarray:
        """The path [T, 3] m of a numbered place."""
        nodes, w = self.garment.places[place]
        return np.einsum("k,tkc->tc", w, self.x[:, nodes])


def sleeve_page(rows: Sequence[Mapping], mean: Mapping[str, float], swung: Mapping[tuple[int, int], Swung]) -> str:
    """HTML of the table's rows and the simulated swing of repeat 4 of every pair of places."""
    names = ("raw", "motion", "painted", "mean_trajectory")
    columns = ("place", "simulated", "simulated, offset removed", "painted on the arm", "mean trajectory")
    table = Table(columns, [[str(row["place"]), *(row[n] for n in names)] for row in (*rows, {"place": "mean", **mean})])
    verdict = (
        f"Mean of {len(rows)} places on repeats 4 and 5: simulated {mean['raw']:.1f} mm, {mean['motion']:.1f} mm with the constant offset of repeats 1–3 "
        f"removed; painted on the arm {mean['painted']:.1f} mm; mean trajectory of repeats 1–3 {mean['mean_trajectory']:.1f} mm."
    )
    told = "Pattern, arm and clamps as measured or photographed; jersey, friction and the thickness of the arm guessed; nothing fitted. Rms over time, in 3-D, mm."
    errors = Figure(figure_uri(_bars(rows)), "Held-out error of each place.", plot=True)
    sections = [
        Section("Error at each place", [told], [table], [errors]),
        Section("The sleeve on the arm", figures=[_pictures(swung)]),
        Section(
            "Paths",
            figures=[Figure(figure_uri(_paths(swung)), "Repeat 4 in the frame of the arm: measured orange, simulated blue.", plot=True)],
        ),
    ]
    return page("Sleeve on a swinging arm", "simulated from its measured pattern and two sensors on the arm", verdict, sections)


def _bars(rows: Sequence[Mapping]) -> Canvas:
    canvas, k = Canvas(figsize=(9, 3), layout="constrained"), np.arange(len(rows))
    axes = canvas.add_subplot()
    shown = {"raw": SIMULATED, "motion": "#93b4f5", "painted": PAINTED, "mean_trajectory": "#15803d"}
    for n, (name, colour) in enumerate(shown.items()):
        axes.bar(k + 0.2 * (n - 1.5), [row[name] for row in rows], 0.2, color=colour, label=name.replace("_", " "))
    axes.set(xticks=k, xticklabels=[row["place"] for row in rows], xlabel="place", ylabel="rms mm")
    axes.legend(fontsize=8, ncols=4)
    return canvas


def _paths(swung: Mapping[tuple[int, int], Swung]) -> Canvas:
    shown = [(place, read_run(pair, SHOWN_REPEAT), s.at(place)) for pair, s in swung.items() for place in pair]
    canvas = Canvas(figsize=(9, 1.25 * len(shown)), layout="constrained")
    grid = canvas.subplots(len(shown), 3, squeeze=False, sharex=True)
    for (place, run, found), row in zip(shown, grid, strict=True):
        truth = in_arm_frame(run, run.places[place])
        for c, axes in enumerate(row):
            axes.plot(run.time, 1e3 * truth[:, c], color=MEASURED, lw=1)
            axes.plot(run.time, 1e3 * found[:, c], color=SIMULATED, lw=1)
            axes.tick_params(labelsize=7)
        row[0].set_ylabel(f"{place}: mm", fontsize=8)
    for axes, name in zip(grid[0], AXES, strict=True):
        axes.set_title(name, fontsize=9)
    for axes in grid[-1]:
        axes.set_xlabel("time s", fontsize=8)
    return canvas


def _pictures(swung: Mapping[tuple[int, int], Swung]) -> Figure:
    """The cloth of one run from two sides, with all places: their measured positions of the same moment come from the run of each pair."""
    whole = max(swung.values(), key=lambda s: np.isfinite(s.x).sum())
    reached = np.isfinite(whole.x).all((1, 2)).sum() - 1
    frames = sorted({min(int(np.argmin(np.abs(whole.run.time - t))), reached) for t in SHOWN})
    views = [strip([_picture(whole, swung, frame, camera) for frame in frames], height=PIXELS[1] * 3 // 4) for camera in range(2)]
    times = ", ".join(f"{abs(whole.run.time[f]):.2f}" for f in frames)
    caption = (
        f"At {times} s: above looking along the pivot, below along the swing. Orange: where the places were measured; blue: the same "
        "places of the simulated sleeve; lines join them. The arm is sand-coloured, the pivot on top."
    )
    return Figure(data_uri(np.concatenate(views, 0)), caption)


def _picture(whole: Swung, pairs: Iterable[tuple[int, int]], frame: int, camera: int) -> np.ndarray:
    cameras = _cameras()
    arm, collider = arm_plate()
    arm = in_arm_frame(whole.run, posed(arm, whole.run))[frame]
    image = np.full((PIXELS[1], PIXELS[0], 3), 255, np.uint8)
    image = draw_mesh(image, cameras, camera, arm, collider.faces, colour=ARM, opacity=1.0)
    image = draw_mesh(image, cameras, camera, whole.x[frame], whole.garment.cloth.faces, colour=CLOTH, opacity=0.6)
    for run in (read_run(pair, SHOWN_REPEAT) for pair in pairs):
        for number, path in run.places.items():
            x = np.stack([in_arm_frame(run, path)[frame], whole.at(number)[frame]])
            truth, found = (tuple(int(v) for v in uv) for uv in np.rint(project(cameras, x)[0][camera]))
            cv2.line(image, truth, found, (60, 60, 60), 1, cv2.LINE_AA)
            cv2.circle(image, found, 5, _rgb(SIMULATED), -1, cv2.LINE_AA)
            cv2.circle(image, truth, 5, _rgb(MEASURED), -1, cv2.LINE_AA)
            cv2.putText(image, str(number), (truth[0] + 7, truth[1] + 4), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (20, 20, 20), 1, cv2.LINE_AA)
    return image


def _cameras() -> Cameras:
    """Two distant eyes in the frame of the arm (along, across, out; origin s2): along the pivot onto the measured layer, and along the swing."""
    middle = np.array([0.32 - S2, 0.0, 0.0])
    R = np.array([[[0, 1, 0], [1, 0, 0], [0, 0, -1]], [[0, 0, 1], [1, 0, 0], [0, 1, 0]]], float)  # rows: right, down, forward
    t = np.array([0, 0, FAR]) - R @ middle
    f = FAR * PIXELS[1] / 0.72  # the picture is 0.72 m tall at the arm
    K = np.array([[f, 0, PIXELS[0] / 2], [0, f, PIXELS[1] / 2], [0, 0, 1]])
    return Cameras(("pivot", "swing"), np.stack([K, K]), R, t, np.tile(np.int32(PIXELS), (2, 1)), np.zeros((2, 5)))


def _rgb(colour: str) -> tuple[int, int, int]:
    return tuple(int(colour[k : k + 2], 16) for k in (1, 3, 5))
