"""ActorsHQ folders, to the letter: calibration.csv, rgbs, masks, aabbs.csv, light_annotations.csv, scene.json, meshes, template.

    Sequence/  aabbs.csv  scene.json  physavatar.json  meshes/FrameFFFFFF.obj  template/template.obj
        4x/    calibration.csv  light_annotations.csv  rgbs/CamCCC/CamCCC_rgbFFFFFF.jpg  masks/CamCCC/CamCCC_maskFFFFFF.png

Cameras have their own sizes (Cam127 stands upright). physavatar.json {fps, up, mass_kg, first_frame} and template/ are this project's
additions; both may be absent. `fps` counts consecutive frame numbers. template/ shows the recording's first frame by its parts, which
meshes/ do not tell: it is taken for that frame, for any other that frame's own mesh. Source: synthesiaresearch/humanrf, actorshq/dataset
(Işık et al. 2023).

Before anything else runs, every file of the selection is looked at: name, header, size, last bytes; decoded are each camera's first mask,
which tells how masks are stored, and those small enough to be empty. `deep=True` decodes every picture. What neither sees is damage inside
a JPEG whose end is intact. Files of cameras and frames that were not selected are not looked at.
"""

import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from tasks.capture.calibration_actorshq import read_calibration_csv, read_csv
from tasks.capture.frame_rate import rate_of, rate_warnings, spacing_faults
from tasks.capture.images import picture_fault
from tasks.capture.recording import Recording, to_y_up, up_faults, validate_name
from tasks.capture.template import read_template
from tasks.geometry.cameras import Cameras
from tasks.geometry.faults import BadInput, Fault, refuse
from tasks.geometry.parts import SKIN, part_faults

AABB_COLUMNS = ["frame_number"] + [f"aabb_{end}_{axis}" for end in ("min", "max") for axis in "xyz"]
FPS = 25.0  # ActorsHQ's own; the folders do not store it
MAX_JSON_BYTES = 1 << 20
PERSON_M = (0.2, 4.0)  # the tallest side of a box around a person, m
THREADS = 8


def find_sequence(dataset: Path, actor: str, sequence: str) -> Path:
    """`dataset/actor/sequence`, or BadInput that lists what is there instead."""
    folder = Path(dataset)
    for name in (validate_name(actor, "actor"), validate_name(sequence, "sequence")):
        inside = sorted(p.name for p in folder.iterdir() if p.is_dir()) if folder.is_dir() else []
        if name not in inside:
            refuse([Fault(str(folder), f"has no folder {name!r}", f"It holds: {', '.join(inside[:20]) or 'no folders'}.")])
        folder /= name
    return folder


def read_actorshq(
    folder: Path, *, scale: str | None = None, cameras: Sequence[str] | None = None, frames: Sequence[int] | None = None, deep: bool = False
) -> Recording:
    """A sequence folder (with `scale`, such as "4x", where it has several) or one of its scale folders.

    `cameras` (names) and `frames` (numbers) select; default all. Raises BadInput with every fault of the selection.
    """
    folder = _scale_folder(Path(folder), scale)
    sequence = folder.parent
    warnings = []
    meta, faults = _read_meta(sequence)
    faults += _light_faults(folder)
    try:
        rig = read_calibration_csv(folder / "calibration.csv")
        rig = rig.subset(_selected(rig.names, cameras, folder))
    except BadInput as bad:
        raise BadInput([*bad.faults, *faults]) from None
    numbers, opening, listing_faults = _list_frames(folder, rig.names, frames, first=meta["first_frame"], everything=cameras is None)
    has_masks = (folder / "masks").is_dir()
    faults += listing_faults + spacing_faults(numbers, str(folder)) + _picture_faults(folder, rig, numbers, has_masks, deep)
    faults += _aabb_faults(sequence, numbers, warnings) + _scene_faults(sequence, numbers, warnings)
    template, template_warnings = _find_template(sequence, folder, int(numbers[0]), opening)
    parts, template_faults = _parts(template)
    refuse(faults + template_faults)
    warnings += rate_warnings(numbers, float(meta["fps"])) + template_warnings + _part_warnings(template, parts)
    patterns = [tuple(f"{kind}s/{n}/{n}_{kind}{{frame:06d}}.{end}" for n in rig.names) for kind, end in (("rgb", "jpg"), ("mask", "png"))]
    return Recording(
        root=folder,
        cameras=to_y_up(rig, meta["up"]),
        frames=numbers,
        fps=rate_of(numbers, float(meta["fps"])),
        up=meta["up"],
        rgb=patterns[0],
        mask=patterns[1] if has_masks else None,
        template=template,
        mass_kg=meta["mass_kg"],
        warnings=tuple(warnings if has_masks else [*warnings, "The recording has no masks."]),
    )


def _scale_folder(folder: Path, scale: str | None) -> Path:
    if not folder.is_dir():
        refuse([Fault(str(folder), "is no folder", "Give the folder of a sequence or of one of its scales.")])
    if scale is not None:
        validate_name(scale, "scale")
    if (folder / "calibration.csv").exists() and scale in (None, folder.name):
        return folder
    scales = sorted(p.parent.name for p in folder.glob("*/calibration.csv"))
    if scale in scales or (scale is None and len(scales) == 1):
        return folder / (scale or scales[0])
    what = f"has no scale {scale!r} with a calibration.csv" if scale else "names no scale"
    raise BadInput([Fault(str(folder), what, f"Choose one of: {', '.join(scales) or 'none found; is this an ActorsHQ sequence?'}.")])


def _selected(names: tuple[str, ...], wanted: Sequence[str] | None, folder: Path) -> list[int]:
    if wanted is None:
        return list(range(len(names)))
    faults = [
        Fault(str(folder), f"has no camera {n!r} in calibration.csv", f"It has {names[0]} to {names[-1]}.")
        for n in wanted
        if n not in names
    ]
    faults += [Fault("cameras", f"{n} is selected {c} times", "Name each camera once.") for n, c in Counter(wanted).items() if c > 1]
    refuse(faults if wanted else [Fault("cameras", "none is selected", "Name at least one.")])
    return [names.index(n) for n in wanted]


def _list_frames(
    folder: Path, names: tuple[str, ...], wanted: Sequence[int] | None, *, first: int, everything: bool
) -> tuple[np.ndarray, int, list[Fault]]:
    """Frames that should be there, the recording's first, and a fault per camera and kind of file with too few or too many."""
    kinds = [("rgb", "jpg")] + ([("mask", "png")] if (folder / "masks").is_dir() else [])
    found = {(k, n): _frames_in(folder / f"{k}s" / n, rf"{re.escape(n)}_{k}(\d{{6}})\.{end}") for k, end in kinds for n in names}
    recorded = [n for n in sorted(set().union(*found.values())) if n >= first]
    numbers = recorded if wanted is None else sorted(set(wanted))
    faults = []
    for (kind, name), present in found.items():
        where = str(folder / f"{kind}s" / name)
        missing = sorted(set(numbers) - present)
        if not present:
            faults.append(Fault(where, "the camera stands in calibration.csv but has no pictures", "Copy them, or leave the camera out."))
        elif missing:
            what = f"{len(missing)} of {len(numbers)} frames are missing: {_some(f'{m:06d}' for m in missing)}"
            faults.append(Fault(where, what, "Copy them, leave the camera out, or select evenly spaced frames that it has."))
    for kind, _ in kinds if everything else []:
        strangers = sorted(p.name for p in (folder / f"{kind}s").glob("*") if p.is_dir() and p.name not in names)
        faults += [
            Fault(str(folder / f"{kind}s" / s), "has pictures but no row in calibration.csv", "Add its row or remove the folder.")
            for s in strangers
        ]
    if not numbers:
        refuse([*faults, Fault(str(folder), "no frame is there or selected", "Copy the recording again, or select frames.")])
    return np.array(numbers, np.int64), (recorded or numbers)[0], faults


def _frames_in(folder: Path, pattern: str) -> set[int]:
    matches = (re.fullmatch(pattern, p.name) for p in folder.iterdir()) if folder.is_dir() else ()
    return {int(m[1]) for m in matches if m}


def _picture_faults(folder: Path, rig: Cameras, numbers: np.ndarray, has_masks: bool, deep: bool) -> list[Fault]:
    kinds = [("rgb", "jpg")] + ([("mask", "png")] if has_masks else [])
    jobs = [
        (
            (kind, name),
            folder / f"{kind}s" / name / f"{name}_{kind}{n:06d}.{end}",
            tuple(rig.size[k].tolist()),
            deep or (kind == "mask" and n == numbers[0]),
        )
        for kind, end in kinds
        for k, name in enumerate(rig.names)
        for n in numbers
    ]
    grouped = defaultdict(list)
    with ThreadPoolExecutor(THREADS) as pool:
        check = lambda job: picture_fault(job[1], job[2], mask=job[0][0] == "mask", deep=job[3]) if job[1].exists() else None  # noqa: E731
        for job, fault in zip(jobs, pool.map(check, jobs, chunksize=256), strict=True):
            if fault:
                grouped[job[0], fault.what].append(fault)
    return [_together(faults) for faults in grouped.values()]


def _together(faults: list[Fault]) -> Fault:
    """One fault for all files of one camera with the same thing wrong."""
    if len(faults) == 1:
        return faults[0]
    others = _some(Path(f.where).name for f in faults[1:])
    return Fault(faults[0].where, f"{faults[0].what}; so are {len(faults) - 1} more of this camera: {others}", faults[0].remedy)


def _some(names) -> str:
    names = list(names)
    return ", ".join(names[:5]) + (" ..." if len(names) > 5 else "")


def _read_meta(sequence: Path) -> tuple[dict, list[Fault]]:
    """physavatar.json {fps, up, mass_kg, first_frame} with its defaults."""
    path, meta = sequence / "physavatar.json", {"fps": FPS, "up": "y", "mass_kg": None, "first_frame": 0}
    if not path.exists():
        return meta, []
    try:
        given = _read_json(path)
    except BadInput as bad:
        return meta, list(bad.faults)
    faults = [Fault(str(path), f"{key!r} is not understood", f"Known: {', '.join(meta)}.") for key in given if key not in meta]
    meta |= {k: v for k, v in given.items() if k in meta}
    faults += up_faults(meta["up"], str(path))
    if not _number(meta["fps"], 1, 2000):
        faults.append(Fault(str(path), f"fps is {meta['fps']!r}", "Give frames per second, 1 to 2000."))
    if meta["mass_kg"] is not None and not _number(meta["mass_kg"], 0.001, 50):
        faults.append(Fault(str(path), f"mass_kg is {meta['mass_kg']!r}", "Give the garment's mass in kilograms, or leave it out."))
    if not isinstance(meta["first_frame"], int):
        faults.append(Fault(str(path), f"first_frame is {meta['first_frame']!r}", "Give the number of the first frame, an integer."))
        meta["first_frame"] = 0
    return meta, faults


def _aabb_faults(sequence: Path, numbers: np.ndarray, warnings: list[str]) -> list[Fault]:
    """Boxes that are not finite, inside out, or not of a person's size; frames without a box are only warned about."""
    path = sequence / "aabbs.csv"
    if not path.exists():
        warnings.append("There is no aabbs.csv; ActorsHQ's own loader would show no frames.")
        return []
    try:
        rows = np.array([[float(row[c]) for c in AABB_COLUMNS] for row in read_csv(path, AABB_COLUMNS)]).reshape(-1, 7)
    except BadInput as bad:
        return list(bad.faults)
    except (TypeError, ValueError) as error:
        return [Fault(str(path), str(error), f"Every row holds {','.join(AABB_COLUMNS)}, all numbers.")]
    faults = []
    for frame, *box in rows:
        side = np.subtract(box[3:], box[:3])
        if not np.isfinite(side).all() or not math.isfinite(frame) or (side <= 0).any():
            faults.append(Fault(str(path), f"frame {frame:g} has the box {box}", "Boxes need finite corners, max above min."))
    if not faults and len(rows):
        side = np.median(rows[:, 4:] - rows[:, 1:4], axis=0)
        if not PERSON_M[0] < side.max() < PERSON_M[1]:
            faults.append(
                Fault(str(path), f"the boxes imply a person of {side.max():.4g} m", "Lengths must be in metres; rescale the recording.")
            )
    absent = sorted(set(numbers.tolist()) - set(rows[:, 0].tolist()))
    if absent and not faults:
        warnings.append(f"aabbs.csv lacks {len(absent)} frames ({_some(map(str, absent))}); ActorsHQ's own loader would not show them.")
    return faults


def _light_faults(folder: Path) -> list[Fault]:
    path = folder / "light_annotations.csv"
    if not path.exists():
        return []
    try:
        for row in read_csv(path, ["camera", "x", "y", "r"]):
            if not np.isfinite([float(row[c]) for c in "xyr"]).all():
                raise ValueError(f"the lamp seen by {row['camera']} is not finite")
    except BadInput as bad:
        return list(bad.faults)
    except (TypeError, ValueError) as error:
        return [Fault(str(path), str(error), "Every row holds camera,x,y,r.")]
    return []


def _scene_faults(sequence: Path, numbers: np.ndarray, warnings: list[str]) -> list[Fault]:
    path = sequence / "scene.json"
    if path.exists():
        try:
            count = _read_json(path).get("num_frames")
        except BadInput as bad:
            return list(bad.faults)
        if count != len(numbers):
            warnings.append(f"scene.json counts {count} frames; {len(numbers)} are read.")
    return []


def _find_template(sequence: Path, folder: Path, first: int, opening: int) -> tuple[Path | None, list[str]]:
    """The surface at frame `first`, and a warning where template/, which shows frame `opening`, is not of that frame."""
    template, name = sequence / "template" / "template.obj", f"Frame{first:06d}.obj"
    mesh = next((p for p in (sequence / "meshes" / name, folder / "meshes" / name) if p.exists()), None)
    if not template.exists():
        return mesh, []
    if first == opening:
        return template, []
    odd = f"{template} shows frame {opening}, the recording's first, and frame {first} is the first that is read"
    if mesh is None:
        return template, [f"{odd}: unless the actor stands alike in both, begin at frame {opening} or store the surface of frame {first}."]
    return mesh, [f"{odd}: {mesh} is taken instead."]


def _parts(template: Path | None) -> tuple[list[str], list[Fault]]:
    """The names of the template's parts, and all that makes it unfit to be tracked."""
    if template is None:
        return [], []
    try:
        part = read_template(template).part
    except BadInput as bad:
        return [], list(bad.faults)
    return np.unique(part).tolist(), part_faults(part, str(template))


def _part_warnings(template: Path | None, parts: list[str]) -> list[str]:
    """A warning where no part of the template is skin: whatever a modelling program called the whole surface is taken for cloth."""
    odd = f"{template} has no part {SKIN!r}: all of it is taken for garments, by the names {', '.join(parts)}."
    return [odd] if parts and SKIN not in parts else []


def _read_json(path: Path) -> dict:
    try:
        if path.stat().st_size > MAX_JSON_BYTES:
            raise ValueError("is too large")
        content = json.loads(path.read_text("utf-8"))
        if not isinstance(content, dict):
            raise ValueError("holds no object")
    except (OSError, ValueError, RecursionError) as error:
        raise BadInput([Fault(str(path), f"cannot be read ({error})", "Write it as a JSON object.")]) from None
    return content


def _number(value: object, low: float, high: float) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high
