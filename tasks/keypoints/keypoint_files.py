"""Keypoints that the user brings: COCO-WholeBody or OpenPose, as one .npz or as JSON files, brought to the 133 of COCO-WholeBody.

    .npz                  keypoints [frame, camera, 133 or 134, 3] (x, y, score), px
    camera.json           COCO-WholeBody results, one entry per frame: keypoints, foot_kpts, face_kpts, lefthand_kpts, righthand_kpts
    camera/*.json         OpenPose, one file per frame in the order of their names: people with pose_keypoints_2d (18 or 25), face, hands

Many DWPose wrappers give 134 points: the body reordered to OpenPose-18 with a neck at 1, or COCO's order with a neck at 17. Which of them
is told once for all frames and cameras, by the neck, which is the exact mean of the shoulders; when that does not decide, the file is
refused. Pixel coordinates have the centre of the first pixel at (0.5, 0.5); most tools count that centre as (0, 0): `pixel_centre` says
which.
Limits: one person per file, the one whose body's scores sum highest when OpenPose lists several.
"""

from __future__ import annotations

import json
import zlib
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


def read_keypoints(path: Path | str, cameras: tuple[str, ...], *, pixel_centre: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Keypoints uv [frame,camera,133,2] px and score [frame,camera,133] of a .npz file, or of a folder with JSON named after `cameras`.

    `pixel_centre` is what the file calls the centre of the first pixel: 0.0 (OpenCV, DWPose, OpenPose) or 0.5. Missing points are NaN with
    score 0. Raises BadInput naming every file that cannot be read, has another layout, or another number of frames.
    """
    path = Path(path)
    if path.suffix == ".npz":
        return _shifted(wholebody133(_read_npz(path, len(cameras)), str(path)), pixel_centre)
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
    return _shifted(wholebody133(np.stack(views, axis=1), str(path)), pixel_centre)


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


def _disagreement(path: Path, views: dict[str, np.ndarray]) -> list[Fault]:
    """What keeps views {camera: [frame, 133 or 134, 3]} from being one array."""
    frames, points = ({camera: view.shape[axis] for camera, view in views.items()} for axis in (0, 1))
    faults = []
    if len(set(frames.values())) > 1:
        faults.append(Fault(str(path), f"cameras have different numbers of frames: {frames}", "Give every camera the same frames."))
    if len(set(points.values())) > 1:
        faults.append(Fault(str(path), f"cameras have different numbers of keypoints: {points}", "Write all cameras with one tool."))
    return faults


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


def _read_camera(folder: Path, camera: str) -> np.ndarray:
    """Keypoints [frame,133 or 134,3] of one camera, from `camera`.json (COCO-WholeBody) or `camera`/*.json (OpenPose)."""
    single, many = folder / f"{camera}.json", sorted((folder / camera).glob("*.json"))
    if single.is_file():
        return _coco_results(_load_json(single), single)
    if many:
        return np.stack([_openpose_frame(_load_json(path), path) for path in many])
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


def _coco_results(entries, path: Path) -> np.ndarray:
    """Keypoints [frame,133 or 134,3] in the order of image_id, or of the file where no result has one."""
    remedy = "Expected a list of COCO-WholeBody results, one per frame, with " + ", ".join(name for name, _ in COCO_PARTS) + "."
    if not isinstance(entries, list) or not entries or not all(isinstance(e, dict) and "keypoints" in e for e in entries):
        refuse([Fault(str(path), "not a list of results with `keypoints`", remedy)])
    kinds = {type(entry.get("image_id")) for entry in entries}
    if not (kinds <= {int, float} or kinds in ({str}, {type(None)})):
        refuse([Fault(str(path), "image_id is missing in some results, or not of one kind", "Number the results of all frames.")])
    ordered = entries if kinds == {type(None)} else sorted(entries, key=lambda entry: entry["image_id"])
    frames = [_coco_frame(entry, f"{path}: frame {entry.get('image_id', i)}", remedy) for i, entry in enumerate(ordered)]
    counts = sorted({len(frame) for frame in frames})
    if len(counts) > 1:
        refuse([Fault(str(path), f"some frames have {counts[0]} keypoints, some {counts[1]}", LAYOUTS)])
    return np.stack(frames)


def _coco_frame(entry: dict, where: str, remedy: str) -> np.ndarray:
    """Keypoints [133 or 134,3] of one result: all in `keypoints`, or part by part."""
    parts = {name: _points(entry.get(name), f"{where}: {name}") for name, _ in COCO_PARTS}
    if len(parts["keypoints"]) in (133, 134):
        return parts["keypoints"]
    wrong = [f"{name} has {len(parts[name])} points" for name, count in COCO_PARTS if len(parts[name]) != count]
    if wrong:
        refuse([Fault(where, ", ".join(wrong), remedy)])
    return np.concatenate(list(parts.values()))


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
