"""The door of capture: read and check a whole recording, keep its calibration and the digest of every picture."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal

from storage_schemas.capture import Capture
from storage_schemas.tree import sha256_of
from tasks.capture.actorshq import read_actorshq
from tasks.capture.calibrated_video import read_calibrated_video
from tasks.capture.recording import Recording
from tasks.geometry.faults import BadInput, Fault
from tasks.stage import Folder, Job, Parameters, stage

VIDEO_CALIBRATIONS = ("*.qca.txt", "calibration.json", "calibration.yml", "calibration.yaml")


class CaptureParameters(Parameters):
    """Which part of which recording."""

    recording: Folder = None
    layout: Literal["auto", "actorshq", "video"] = "auto"
    scale: str | None = None
    cameras: tuple[str, ...] | None = None
    frames: tuple[int, ...] | None = None


@stage("capture", version=2, pool="vision", timeout_s=3600)
def capture(job: Job, parameters: CaptureParameters) -> Capture:
    """Check the recording as a whole, then keep what the later stages need to find and trust its pictures."""
    recording = read_recording(parameters)
    for warning in recording.warnings:
        job.warn(warning)
    return _as_record(recording, Path(parameters.recording))


def read_recording(parameters: CaptureParameters) -> Recording:
    """The recording in its layout; raises BadInput with every fault found."""
    folder = Path(parameters.recording)
    if (folder / "calibration.csv").exists():
        remedy = f"Point at {folder.parent} and choose the scale with capture.scale={folder.name}."
        raise BadInput([Fault(str(folder), "this is the folder of a scale, not of a sequence", remedy)])
    calibration = sorted(p for pattern in VIDEO_CALIBRATIONS for p in folder.glob(pattern))
    if parameters.layout == "video" or (parameters.layout == "auto" and calibration):
        if len(calibration) > 1:
            named = ", ".join(p.name for p in calibration)
            raise BadInput([Fault(str(folder), f"it holds several calibrations: {named}", "Keep the one that belongs to these videos.")])
        where = calibration[0] if calibration else folder
        return read_calibrated_video(where, folder=folder, cameras=parameters.cameras, frames=parameters.frames)
    return read_actorshq(folder, scale=parameters.scale, cameras=parameters.cameras, frames=parameters.frames)


def _as_record(recording: Recording, folder: Path) -> Capture:
    below = recording.root.relative_to(folder).as_posix()
    prefix = "" if below == "." else f"{below}/"
    rig = recording.cameras
    fields = {
        "rgb": tuple(prefix + p for p in recording.rgb),
        "mask": None if recording.mask is None else tuple(prefix + p for p in recording.mask),
        "template": None if recording.template is None else recording.template.relative_to(folder).as_posix(),
    }
    files = {p.format(frame=int(n)) for p in (*fields["rgb"], *(fields["mask"] or ())) for n in recording.frames}
    files |= {fields["template"]} - {None}
    return Capture(
        K=rig.K,
        R=rig.R,
        t=rig.t,
        distortion=rig.distortion,
        size=rig.size,
        frame_numbers=recording.frames.astype("int32"),
        camera_names=rig.names,
        fps=recording.fps,
        up=recording.up,
        sha256=_digests(folder, sorted(files)),
        mass_kg=recording.mass_kg,
        warnings=recording.warnings,
        **fields,
    )


def _digests(folder: Path, files: list[str]) -> dict[str, str]:
    with ThreadPoolExecutor(4) as pool:
        return dict(zip(files, pool.map(sha256_of, (folder / file for file in files))))
