"""What the report shows of each stage, from plain arrays."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cameras import Cameras
from tasks.geometry.parts import SKIN
from tasks.report.page import Figure, Section, Table
from tasks.report.pictures import crop_to, data_uri, draw_keypoints, draw_mesh, figure_uri, heat, strip

GROUPS = {"body": slice(0, 17), "feet": slice(17, 23), "face": slice(23, 91), "hands": slice(91, 133)}
CLASSES = 6  # shown
GARMENT_COLOURS = ((255, 150, 60), (90, 170, 255), (170, 230, 90), (240, 110, 190))


def keypoint_section(
    images: Sequence[NDArray],
    keypoints: NDArray,
    score: NDArray,
    limbs: Sequence[tuple[int, int]],
    people: NDArray | None,
    cameras: Cameras,
    detector: str,
) -> Section:
    """Overlays of one frame in some cameras; keypoints [camera, 133, 2] px, score [camera, 133], people [n, 3] m to crop to, if known."""
    drawn = [draw_keypoints(i, k, s, limbs) for i, k, s in zip(images, keypoints, score)]
    if people is not None:
        drawn = [crop_to(picture, cameras, c, people) for c, picture in enumerate(drawn)]
    return Section(
        "Keypoints", [f"Detector: {detector}."], figures=[Figure(data_uri(strip(drawn)), "Points with a score of at least 0.3.")]
    )


def body_section(
    images: Sequence[NDArray],
    cameras: Cameras,
    vertices: NDArray,
    faces: NDArray,
    reprojection_px: NDArray,
    camera_names: Sequence[str],
    point_names: Sequence[str],
    ending: str,
) -> Section:
    """The fitted body over the pictures, and reprojection errors [frame, camera, 133] px by group, by joint and by camera."""
    drawn = [crop_to(draw_mesh(i, cameras, c, vertices, faces), cameras, c, vertices) for c, i in enumerate(images)]
    joints = range(GROUPS["feet"].stop)
    parts = [*GROUPS.items(), *((point_names[k], slice(k, k + 1)) for k in joints)]
    rows = [[name, *(_median(reprojection_px[:, c, part]) for c in range(len(camera_names)))] for name, part in parts]
    table = Table(["median error px", *camera_names], rows)
    return Section("Body", [ending], [table], [Figure(data_uri(strip(drawn)), "The fitted body over the recording.")])


def _median(values: NDArray) -> float | None:
    """Of what was detected."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def tracking_section(
    images: Sequence[NDArray],
    cameras: Cameras,
    t: int,
    vertices: NDArray,
    faces: NDArray,
    part: NDArray,
    rms: NDArray,
    seen: NDArray,
    noise_m: NDArray,
) -> Section:
    """The tracked surface over the pictures of frame t; vertices [frame, vertex, 3] m, rms [frame], seen and noise_m [frame, vertex].

    Skin that no two cameras saw is not drawn: it went with the body of the keypoints, through the garments where that errs.
    """
    names = sorted(set(part.tolist()) - {SKIN})
    colour = np.full((len(faces), 3), 200.0)
    for name, rgb in zip(names, GARMENT_COLOURS):
        colour[part == name] = rgb
    x, followed = vertices[t].astype(float), (part != SKIN) | seen[t][faces].all(1)
    drawn = [
        crop_to(draw_mesh(i, cameras, c, x, faces[followed], colour=colour[followed], opacity=0.55), cameras, c, x)
        for c, i in enumerate(images)
    ]
    rows = [
        ["photometric rms, last frame", float(rms[-1])],
        ["vertices seen, mean over frames", float(seen.mean())],
        ["standard deviation of a seen vertex, median mm", float(1e3 * np.median(noise_m[seen])) if seen.any() else None],
    ]
    return Section(
        "Tracking",
        tables=[Table(["figure", "value"], rows)],
        figures=[Figure(data_uri(strip(drawn)), f"Tracked surface, without skin that no two cameras saw; garments: {', '.join(names)}.")],
    )


def cloth_section(parameters: dict[str, dict[str, Any]], history: dict[str, list], endings: Sequence[str]) -> Section:
    """Estimates with intervals, and how each fit went."""
    rows = [
        [garment, name, e["value"], e["low"], e["high"], e["unit"], e.get("sentence", "")]
        for garment, found in parameters.items()
        for name, e in found.items()
    ]
    steps = [
        [garment, i, row.get("rms_mm"), row["kappa_s"], row["kappa_b"]] for garment, rows_ in history.items() for i, row in enumerate(rows_)
    ]
    tables = [
        Table(["garment", "parameter", "value", "low (90 %)", "high", "unit", ""], rows),
        Table(["garment", "iteration", "rms mm", "κ_s", "κ_b"], steps),
    ]
    return Section("Fabric", ["Motion without air fixes only ratios to the density.", *endings], tables)


def gap_section(
    image: NDArray, cameras: Cameras, camera: int, x: NDArray, faces: NDArray, residual_mm: NDArray, tables: dict[str, Any], fps: float
) -> Section:
    """Heat map on the simulated garments, error over time, and the tables by zone, direction and band; residual_mm [frame, vertex]."""
    vertex_mm = _vertex_rms(residual_mm)
    top = float(np.nanpercentile(vertex_mm, 95)) if np.isfinite(vertex_mm).any() else 0.0
    colour = heat(vertex_mm[faces].mean(1), top)
    picture = draw_mesh(np.full_like(image, 24), cameras, camera, x, faces, colour=colour, opacity=1.0)
    zones = Table(
        ["zone", "vertices", "rms mm", "share of squared error"],
        [[z["zone"], z["vertices"], z["rms_mm"], z["share"]] for z in tables["zones"]],
    )
    directions = Table(["direction", "rms mm"], [[k, v] for k, v in tables["directions_mm"].items()])
    bands = Table(["frequency", "rms mm"], [[b["band"], b["rms_mm"]] for b in tables["bands"]])
    told = f"Error by vertex, black 0 to yellow {top:.1f} mm (rms over time); grey where a corner was never seen."
    figures = [
        Figure(data_uri(crop_to(picture, cameras, camera, x)), told),
        Figure(figure_uri(_timeline(np.asarray(tables["frame_mm"], float), fps)), "Error over time.", plot=True),
    ]
    paragraph = "What was tracked minus the fitted fabric simulated in one run from the first frame, where it was seen."
    return Section("Where the gap lies", [paragraph], tables=[zones, directions, bands], figures=figures)


def _vertex_rms(residual_mm: NDArray) -> NDArray:
    """Root mean square [V] mm over the frames in which a vertex was seen; NaN where it never was."""
    seen = np.isfinite(residual_mm)
    squared = np.where(seen, residual_mm, 0.0) ** 2
    return np.sqrt(squared.sum(0) / np.where(seen.any(0), seen.sum(0), np.nan))


def cause_section(answer: dict[str, Any], links: Sequence[tuple[str, str]]) -> Section:
    """What the diagnosis weighed: classes that the recording cannot tell apart, their probabilities and strengths; links to the
    evidence, as of a section.
    """
    rows = [
        [
            ", ".join(row["class"]),
            row["probability"],
            "; ".join(f"{n} {s['value']:.3g} {s['unit']} ({s['low']:.3g} to {s['high']:.3g})" for n, s in row["strength"].items()),
        ]
        for row in answer["ranking"][:CLASSES]
    ]
    shown = ("before_mm", "after_mm")[: 1 + (answer["verdict"]["kind"] == "effect")]  # without a name there is no after
    zones = [[z["zone"], *(z[k] for k in shown)] for z in answer["where"]["zones"]]
    tables = [Table(["class", "probability", "strength (90 %)"], rows), Table(["zone", *(k.replace("_", " ") for k in shown)], zones)]
    told = f"Weighed on the {answer['garment']}, in windows of a fifth to a third of a second and over the whole recording. Record next: {answer['record_next']}."
    return Section("Which effect is missing", [told], tables, links=links)


def appearance_section(albedo: NDArray, psnr: NDArray, frames: Sequence[int], camera_names: Sequence[str]) -> Section:
    """The texture (sRGB 8 bit) and the likeness per frame and camera [dB]."""
    rows = [[int(f), *(None if not np.isfinite(p) else float(p) for p in row)] for f, row in zip(frames, psnr)]
    return Section(
        "Appearance", tables=[Table(["frame", *camera_names], rows)], figures=[Figure(data_uri(albedo), "Albedo; likeness in dB above.")]
    )


def truth_section(scores: dict[str, Any]) -> Section:
    """Errors against the truth, which no stage could see."""
    rows = [[name, s["value"], s["unit"]] for name, s in scores.items()]
    return Section(
        "Against the truth",
        ["The recording is synthetic: these figures come from a scorer outside the pipeline."],
        [Table(["figure", "value", "unit"], rows)],
    )


def provenance_section(stages: dict[str, dict[str, Any]], warnings: Sequence[str]) -> Section:
    """Seconds each stage took when it was computed, its key and the warnings."""
    rows = [[name, s["seconds"], s["key"][:12]] for name, s in stages.items()]
    return Section("Stages", tables=[Table(["stage", "seconds when computed", "key"], rows)], warnings=warnings)


def _timeline(frame_mm: NDArray, fps: float):
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(7, 2.4))
    axes = canvas.add_subplot()
    axes.plot(np.arange(len(frame_mm)) / fps, frame_mm, color="#c2410c")
    axes.set(xlabel="time s", ylabel="rms error mm", ylim=(0, None))
    axes.grid(alpha=0.3)
    return canvas
