"""Keypoints that the user brings: COCO-WholeBody or OpenPose, as one .npz or as JSON files, brought to the 133 of COCO-WholeBody.

    .npz                  keypoints [frame, camera, 133 or 134, 3] (x, y, score), px
    camera.json           COCO-WholeBody results, one entry per frame: keypoints, foot_kpts, face_kpts, lefthand_kpts, righthand_kpts
    camera/*.json         OpenPose, one file per frame: people with pose_keypoints_2d (18 or 25), face, hands

Frames come in the order of image_id, or of the last number in which names differ, and must bear the same numbers in all cameras: somebody
found twice in one frame and nobody in the next would shift all that follow. Results without any image_id keep the order of the file.

Many DWPose wrappers give 134 points: the body reordered to OpenPose-18 with a neck at 1, or COCO's order with a neck at 17. Which of them
is told once for all frames and cameras, by the neck, which is the exact mean of the shoulders; when that does not decide, the file is
refused. Pixel coordinates have the centre of the first pixel at (0.5, 0.5); most tools count that centre as (0, 0): `pixel_centre` says
which. Scores may go beyond 1, as the height of a heat map does.
Limits: one person per file, the one whose body's scores sum highest when OpenPose lists several.
"""

from __future__ import annotations

import json
import math
import re
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from tasks.body.wholebody import FROM_OPENPOSE
from tasks.geometry.faults import BadInput, Fault, refuse

BODY_25 = (0, 16, 15, 18, 17, 5, 2, 6, 3, 7, 4, 12, 9, 13, 10, 14, 11, 19, 20, 21, 22, 23, 24)  # OpenPose BODY_25 in COCO order, with feet
OPENPOSE_18 = (0, 15, 14, 17, 16, 5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10)
COCO_PARTS = (("keypoints", 17), ("foot_kpts", 6), ("face_kpts", 68), ("lefthand_kpts", 21), ("righthand_kpts", 21))
OPENPOSE_PARTS = ("pose_keypoints_2d", "face_keypoints_2d", "hand_left_keypoints_2d", "hand_right_keypoints_2d")
LAYOUTS = "Give 133 keypoints in COCO-WholeBody order, or 134 with the neck where OpenPose-18 (index 1) or DWPose (index 17) has it."
NECK_TOLERANCE = 0.51  # [px] files round to whole pixels
CORNER = 1.5  # [px]: shares of the picture lie within, a whole person does not
SUREST = 30.0  # OpenPose and SimCC models go beyond 1, a few of them to 10; per cents go to 100


@dataclass(frozen=True)
class _View:
    """One camera's keypoints [frame, 133 or 134, 3], and the number that each frame bears; None where none bears any."""

    keypoints: np.ndarray
    numbers: tuple[float, ...] | None


def read_keypoints(
    path: Path | str, cameras: tuple[str, ...], *, frames: int | None = None, pixel_centre: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Keypoints uv [frame,camera,133,2] px and score [frame,camera,133] of a .npz file, or of a folder with JSON named after `cameras`.

    `frames` is how many there must be. `pixel_centre` is what the file calls the centre of the first pixel: 0.0 (OpenCV, DWPose, OpenPose)
    or 0.5. Missing points are NaN with score 0. Raises BadInput naming every file that cannot be read, has another layout or other frames,
    or whose numbers are no pixels and scores.
    """
    path = Path(path)
    found = _read_npz(path, len(cameras)) if path.suffix == ".npz" else _read_folder(path, cameras)
    keypoints = wholebody133(found, str(path))
    faults = _value_faults(keypoints, path, cameras)
    if frames is not None and len(keypoints) != frames:
        faults.append(Fault(str(path), f"it has {len(keypoints)} frames, the recording {frames}", "Give keypoints for every frame."))
    refuse(faults)
    return _shifted(keypoints, pixel_centre)


def wholebody133(keypoints: np.ndarray, where: str) -> np.ndarray:
    """Keypoints [...,133,3] from [...,133 or 134,3]; `where` names the file in the BadInput raised for any other or an unclear layout."""
    count = keypoints.shape[-2]
    if count == 133:
        return keypoints
    if count != 134:
        refuse([Fault(where, f"{count} keypoints per person{_guess(count)}", LAYOUTS)])
    openpose, inserted = _neck_error(keypoints, 1, (2, 5)), _neck_error(keypoints, 17, (5, 6))
    if np.isinf(openpose) and np.isinf(inserted):
        refuse([Fault(where, "134 keypoints, but no frame shows the neck and both shoulders, by which their order is told", LAYOUTS)])
    if not (openpose < NECK_TOLERANCE) and not (inserted < NECK_TOLERANCE):
        found = f"134 keypoints, but neither 1 nor 17 is the mean of the shoulders (off by {openpose:.1f} and {inserted:.1f} px)"
        refuse([Fault(where, found, LAYOUTS)])
    if openpose < NECK_TOLERANCE and inserted < NECK_TOLERANCE:
        refuse(
            [Fault(where, "134 keypoints, and both 1 and 17 could be the neck", "Remove the neck and give 133 in COCO-WholeBody order.")]
        )
    return keypoints[..., FROM_OPENPOSE, :] if openpose < inserted else np.delete(keypoints, 17, axis=-2)


def _neck_error(keypoints: np.ndarray, neck: int, shoulders: tuple[int, int]) -> float:
    """Median distance [px] of point `neck` from the mean of two others, over the frames that show all three; inf when none does."""
    trio = keypoints[..., [neck, *shoulders], :]
    shown = np.isfinite(trio).all((-1, -2)) & (trio[..., 2] > 0).all(-1)
    error = np.linalg.norm(trio[..., 0, :2] - trio[..., 1:, :2].mean(-2), axis=-1)
    return float(np.median(error[shown])) if shown.any() else np.inf


def _value_faults(keypoints: np.ndarray, path: Path, cameras: tuple[str, ...]) -> list[Fault]:
    """Of keypoints [frame,camera,133,3] that are in another unit than pixels, or not scored about 0 to 1."""
    shown = np.isfinite(keypoints).all(-1) & (keypoints[..., 2] > 0)
    reach = {c: np.abs(keypoints[:, k, :, :2][shown[:, k]]).max() for k, c in enumerate(cameras) if shown[:, k].any()}
    tiny, surest, faults = [c for c, r in reach.items() if r <= CORNER], keypoints[..., 2][shown].max(initial=0.0), []
    if tiny:
        what = f"all points of {', '.join(tiny)} lie within {max(reach[c] for c in tiny):.3g} px of (0, 0)"
        faults.append(Fault(str(path), what, "Give pixels, not shares of the picture."))
    if surest > SUREST:
        faults.append(Fault(str(path), f"scores reach {surest:.4g}", "Give them from 0 to about 1, not in per cent."))
    return faults


def _disagreement(path: Path, views: dict[str, _View]) -> list[Fault]:
    """What keeps views from being one array, by camera."""
    frames, points = ({camera: view.keypoints.shape[axis] for camera, view in views.items()} for axis in (0, 1))
    faults = []
    if len(set(frames.values())) > 1:
        faults.append(Fault(str(path), f"cameras have different numbers of frames: {frames}", "Give every camera the same frames."))
    else:
        faults += _other_frames(path, {camera: view.numbers for camera, view in views.items()})
    if len(set(points.values())) > 1:
        faults.append(Fault(str(path), f"cameras have different numbers of keypoints: {points}", "Write all cameras with one tool."))
    return faults


def _other_frames(path: Path, numbers: dict[str, tuple[float, ...] | None]) -> list[Fault]:
    """Cameras whose frames, as many as the first camera's, bear other numbers, by camera."""
    (first, own), *others = numbers.items()
    faults = []
    for camera, found in others:
        if (own is None) != (found is None):
            bare, told = (first, camera) if own is None else (camera, first)
            what = f"camera {told} numbers its frames, {bare} does not"
            faults.append(Fault(str(path), what, "Give the results of all cameras an image_id, or of none."))
        elif own is not None and found is not None and own != found:
            what = f"camera {camera} has frame {min(set(found) - set(own))}, which {first} lacks"
            remedy = "Give every camera the same frames by the same numbers; where nobody is seen, points with score 0."
            faults.append(Fault(str(path), what, remedy))
    return faults


def _frame_numbers(names: Sequence[str]) -> tuple[int, ...] | None:
    """The last number of each name; where it is the same in all, as a camera's or a version's is, the one before. None where one has none."""
    stems = [re.sub(r"\.[A-Za-z]\w*$", "", name) for name in names]
    columns = list(zip(*([int(digits) for digits in re.findall("[0-9]{1,4000}", stem)][::-1] for stem in stems)))
    return next((column for column in columns if len(set(column)) > 1), columns[0]) if columns else None


def _repeated(numbers: Sequence[float], where: str, of: str) -> list[Fault]:
    """Frames for which there are several."""
    number, count = Counter(numbers).most_common(1)[0]
    return [Fault(where, f"{count} {of} for frame {number}", "Keep one per frame, the actor's.")] if count > 1 else []


def _guess(count: int) -> str:
    known = {
        17: "COCO body only",
        18: "OpenPose body only",
        25: "OpenPose BODY_25 only",
        26: "Halpe body",
        135: "OpenPose 135",
        136: "Halpe 136",
    }
    return f" ({known[count]})" if count in known else ""


def _shifted(keypoints: np.ndarray, pixel_centre: float) -> tuple[np.ndarray, np.ndarray]:
    uv, score = keypoints[..., :2] + (0.5 - pixel_centre), keypoints[..., 2]
    absent = ~np.isfinite(keypoints).all(-1) | (score <= 0)
    return np.where(absent[..., None], np.nan, uv), np.where(absent, 0.0, score)


def _read_npz(path: Path, cameras: int) -> np.ndarray:
    remedy = "Save one array `keypoints` [frame, camera, 133 or 134, 3] (x, y, score)."
    try:
        with np.load(path, allow_pickle=False) as stored:
            names = list(stored)
            keypoints = np.asarray(stored["keypoints"], float) if "keypoints" in stored else None
    except (OSError, TypeError, ValueError, EOFError, BadZipFile, zlib.error) as error:
        raise BadInput([Fault(str(path), f"not a readable .npz of plain arrays ({error})", remedy)]) from error
    if keypoints is None:
        refuse([Fault(str(path), f"holds {', '.join(names) or 'nothing'}, no array `keypoints`", remedy)])
    if keypoints.ndim != 4 or keypoints.shape[1] != cameras or keypoints.shape[3] != 3:
        refuse([Fault(str(path), f"keypoints is {keypoints.shape}, and the recording has {cameras} cameras", remedy)])
    return keypoints


def _read_folder(path: Path, cameras: tuple[str, ...]) -> np.ndarray:
    """Keypoints [frame,camera,133 or 134,3] of a folder with JSON named after the cameras."""
    if not path.is_dir():
        refuse(
            [Fault(str(path), "neither a .npz file nor a folder", "Give keypoints.npz or a folder with one JSON or one folder per camera.")]
        )
    views, faults = [], []
    for camera in cameras:
        try:
            views.append(_read_camera(path, camera))
        except BadInput as bad:
            faults += bad.faults
    refuse(faults or _disagreement(path, dict(zip(cameras, views, strict=True))))
    return np.stack([view.keypoints for view in views], axis=1)


def _read_camera(folder: Path, camera: str) -> _View:
    """What one camera saw, from `camera`.json (COCO-WholeBody) or `camera`/*.json (OpenPose)."""
    single, many = folder / f"{camera}.json", sorted((folder / camera).glob("*.json"))
    if single.is_file():
        return _coco_results(_load_json(single), single)
    if many:
        return _openpose_frames(many)
    remedy = f"Give {camera}.json (COCO-WholeBody results) or a folder {camera}/ with one OpenPose JSON per frame."
    raise BadInput([Fault(str(folder), f"no keypoints of camera {camera}", remedy)])


def _load_json(path: Path):
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise BadInput([Fault(str(path), f"not readable JSON ({error})", "Write the file again.")]) from error


def _points(value, where: str) -> np.ndarray:
    """Points [n,3] (x, y, score) of a list that is flat or holds triples; none where it is absent. Raises BadInput."""
    try:
        points = np.asarray([] if value is None else value, float)
    except (TypeError, ValueError, OverflowError):
        points = None
    if points is None or not (points.size == 0 or (points.ndim == 1 and points.size % 3 == 0) or points.shape[1:] == (3,)):
        found = "not a list of numbers" if points is None else f"numbers of shape {points.shape}"
        refuse([Fault(where, found, "Give x, y and score of every point.")])
    return points.reshape(-1, 3)


def _coco_results(entries, path: Path) -> _View:
    """Results in the order of image_id, or of the file where none has one."""
    remedy = "Expected a list of COCO-WholeBody results, one per frame, with " + ", ".join(name for name, _ in COCO_PARTS) + "."
    if not isinstance(entries, list) or not entries or not all(isinstance(e, dict) and "keypoints" in e for e in entries):
        refuse([Fault(str(path), "not a list of results with `keypoints`", remedy)])
    numbers = _image_numbers([entry.get("image_id") for entry in entries], path)
    order = range(len(entries)) if numbers is None else sorted(range(len(entries)), key=numbers.__getitem__)
    frames = [_coco_frame(entries[i], f"{path}: frame {entries[i].get('image_id', i)}", remedy) for i in order]
    counts = sorted({len(frame) for frame in frames})
    if len(counts) > 1:
        refuse([Fault(str(path), f"some frames have {counts[0]} keypoints, some {counts[1]}", LAYOUTS)])
    return _View(np.stack(frames), None if numbers is None else tuple(sorted(numbers)))


def _image_numbers(ids: list, path: Path) -> tuple[float, ...] | None:
    """The number of each frame by its image_id, a number or a name with one; None where no result has one."""
    kinds, remedy = {type(i) for i in ids}, "Number the results of all frames."
    if kinds == {type(None)}:
        return None
    if not (kinds <= {int, float} or kinds == {str}) or any(isinstance(i, float) and not math.isfinite(i) for i in ids):
        refuse([Fault(str(path), "image_id is missing in some results, or not of one kind", remedy)])
    numbers = _frame_numbers(ids) if kinds == {str} else tuple(ids)
    if numbers is None:
        bare = next(i for i in ids if _frame_numbers([i]) is None)
        refuse([Fault(str(path), f"image_id {bare!r} holds no number", remedy)])
    refuse(_repeated(numbers, str(path), "results"))
    return numbers


def _coco_frame(entry: dict, where: str, remedy: str) -> np.ndarray:
    """Keypoints [133 or 134,3] of one result: all in `keypoints`, or part by part."""
    parts = {name: _points(entry.get(name), f"{where}: {name}") for name, _ in COCO_PARTS}
    if len(parts["keypoints"]) in (133, 134):
        return parts["keypoints"]
    wrong = [f"{name} has {len(parts[name])} points" for name, count in COCO_PARTS if len(parts[name]) != count]
    if wrong:
        refuse([Fault(where, ", ".join(wrong), remedy)])
    return np.concatenate(list(parts.values()))


def _openpose_frames(files: list[Path]) -> _View:
    """Files in the order of the numbers in their names."""
    numbers, folder = _frame_numbers([file.name for file in files]), files[0].parent
    if numbers is None:
        bare = next(file for file in files if _frame_numbers([file.name]) is None)
        refuse([Fault(str(bare), "its name holds no number", "Number the files by frame.")])
    refuse(_repeated(numbers, str(folder), "files"))
    ordered = sorted(zip(numbers, files, strict=True))
    return _View(np.stack([_openpose_frame(_load_json(file), file) for _, file in ordered]), tuple(number for number, _ in ordered))


def _openpose_frame(content, path: Path) -> np.ndarray:
    """133 keypoints of the surest person in an OpenPose file; what it lacks is NaN."""
    people = content.get("people") if isinstance(content, dict) else None
    if not isinstance(people, list) or not all(isinstance(person, dict) for person in people):
        refuse([Fault(str(path), "no list `people` of objects", "Expected OpenPose JSON output.")])
    frame = np.full((133, 3), np.nan)
    if not people:
        return frame
    points = {part: [_points(person.get(part), f"{path}: {part}") for person in people] for part in OPENPOSE_PARTS}
    surest = int(np.argmax([np.nansum(body[:, 2]) for body in points["pose_keypoints_2d"]]))
    body, face, *hands = (points[part][surest] for part in OPENPOSE_PARTS)
    if len(body) not in (18, 25):
        refuse([Fault(str(path), f"pose_keypoints_2d has {len(body)} points", "Use OpenPose's BODY_25 or its COCO model of 18 points.")])
    order = BODY_25 if len(body) == 25 else OPENPOSE_18
    frame[: len(order)] = body[list(order)]
    if len(face) in (68, 70):  # 68 and 69 are the pupils
        frame[23:91] = face[:68]
    for hand, first in zip(hands, (91, 112), strict=True):
        if len(hand) == 21:
            frame[first : first + 21] = hand
    return frame
