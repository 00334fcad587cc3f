"""`make_demo_recording`: an honest synthetic recording of a dressed actor, in the layout of ActorsHQ, with the truth stored apart.

    root/<actor>/<sequence>/   1x/{calibration.csv, light_annotations.csv, rgbs/, masks/}  aabbs.csv  scene.json  physavatar.json
                               template/template.obj
    truth_root/<actor>/<sequence>/   request.json  body.npz  top.npz  skirt.npz  template.npz  cameras.npz  states/  complete.json

The recording may be interrupted anywhere and called again: simulated frames and pictures that exist are kept, and the result is the same
to the bit. A finished one is recognised by `complete.json`; files of it that were altered are made again. Limits: diffuse surfaces, one
constant light, no background, no lens distortion, no motion blur; occupancy grids, meshes.abc and scene.blend of ActorsHQ are not written
(its loader does not need them).
"""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, as_completed, wait
from contextlib import contextmanager
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.body.anny_body import build_demo_body
from tasks.body.model import BodyModel
from tasks.capture.calibration_actorshq import write_calibration_csv
from tasks.capture.demo.dressing import Unmodelled
from tasks.capture.demo.files import COMPLETE, altered, seal, write_json, write_whole
from tasks.capture.demo.labour import photograph, simulate_garment
from tasks.capture.demo.plan import Plan, Request, make_plan, stream
from tasks.capture.demo.scan import scan
from tasks.capture.demo.truth import write_truth
from tasks.capture.template import write_obj
from tasks.geometry.faults import BadInput, Fault
from tasks.geometry.meshes import face_areas

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

STANDARD = Request()
EDITION = 4  # raise when the same request gives another recording
SCALE = "1x"
FRAMES_PER_PIECE = 3  # of photography: a piece takes seconds, and building its scene a fraction of one
POLL = 2.0  # [s] between looks at how many frames are simulated
MARGIN = 0.05  # [m] around the actor in aabbs.csv


def make_demo_recording(
    root: Path | str,
    truth_root: Path | str,
    *,
    cache: Path | str,
    actor: str = "Demo",
    sequence: str = "Sequence1",
    request: Request = STANDARD,
    unmodelled: Unmodelled | None = None,
    workers: int = 2,
    on_progress: Progress | None = None,
) -> Path:
    """Make (or go on with) a recording; the folder of the sequence. `cache` holds the body once it is built; unmodelled: what moves the
    garments beside the base model, air where nothing is given.

    on_progress(what, done, total) is called now and then. Raises BadInput if the folder holds a recording of another request,
    RuntimeError where a garment's simulation does not converge.
    """
    folder, truth = Path(root) / actor / sequence, Path(truth_root) / actor / sequence
    report = on_progress or (lambda what, done, total: None)
    body, whole = build_demo_body(cache), {"recording": folder, "truth": truth}
    planted = {} if unmodelled is None else {"unmodelled": {name: list(θ) for name, θ in unmodelled.items()}}
    _claim(truth / "request.json", {"edition": EDITION, "body": body.name, **asdict(request), **planted})
    if (differing := altered(truth / COMPLETE, whole)) == []:
        return folder
    for path in differing or []:
        path.unlink(missing_ok=True)
    plan = make_plan(request, BodyModel.load(body), unmodelled)
    with _pool(workers) as pool:
        worn = _simulate(pool, plan, truth / "states", report)
        _photograph(pool, plan, worn, folder / SCALE, report)
    garments = {name: fitting.garment for name, fitting in plan.fittings.items()}
    scanned = scan(plan.actor, garments, plan.scanned, {name: x[0] for name, x in worn.items()}, stream(request.seed, "scan"))
    write_whole(folder / "template/template.obj", lambda aside: write_obj(aside, scanned.template))
    _write_tables(folder, plan, worn)
    write_truth(truth, plan, worn, scanned)
    seal(truth / COMPLETE, whole)
    return folder


def _claim(path: Path, asked: dict) -> None:
    """Mark the folder as holding what is asked for; refuse if it holds something else."""
    if path.exists() and (there := json.loads(path.read_text())) != asked:
        other = {key: (there.get(key), value) for key, value in asked.items() if there.get(key) != value}
        raise BadInput(
            [Fault(str(path.parent), f"holds a recording of another request ((there, asked): {other})", "Choose an empty folder.")]
        )
    write_json(path, asked)


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes: neither Dr.Jit nor ipctk survives a fork."""
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _simulate(pool: ProcessPoolExecutor, plan: Plan, folder: Path, report: Progress) -> dict[str, Array]:
    jobs = {name: pool.submit(simulate_garment, fitting, folder / name) for name, fitting in plan.fittings.items()}
    pending = set(jobs.values())
    while pending and not any(job.done() and job.exception() for job in jobs.values()):
        pending = wait(pending, timeout=POLL, return_when=FIRST_COMPLETED).not_done
        report("frames simulated", sum(1 for _ in folder.glob("*/[0-9]*.npz")), len(jobs) * plan.request.frames)
    return {name: job.result() for name, job in jobs.items()}


def _photograph(pool: ProcessPoolExecutor, plan: Plan, worn: dict[str, Array], folder: Path, report: Progress) -> None:
    settings = {"surfaces": plan.surfaces, "cameras": plan.cameras, "gains": plan.gains, "spp": plan.request.spp, "seed": plan.request.seed}
    pieces = [range(first, min(first + FRAMES_PER_PIECE, plan.request.frames)) for first in range(0, plan.request.frames, FRAMES_PER_PIECE)]
    jobs = [pool.submit(photograph, piece, [plan.surface_vertices(worn, t) for t in piece], folder=folder, **settings) for piece in pieces]
    for done, job in enumerate(as_completed(jobs), 1):
        job.result()
        report("groups of frames photographed", done, len(jobs))


def _write_tables(folder: Path, plan: Plan, worn: dict[str, Array]) -> None:
    write_whole(folder / SCALE / "calibration.csv", lambda aside: write_calibration_csv(aside, plan.cameras))
    write_whole(folder / SCALE / "light_annotations.csv", b"camera,x,y,r\n")  # no lamp is visible: the light comes from everywhere
    write_whole(folder / "aabbs.csv", _boxes(plan, worn).encode())
    write_json(folder / "scene.json", {"num_frames": plan.request.frames})
    write_json(folder / "physavatar.json", {"fps": plan.request.fps, "up": "y", "mass_kg": _mass(plan), "first_frame": 0})


def _boxes(plan: Plan, worn: dict[str, Array]) -> str:
    lines = ["frame_number," + ",".join(f"aabb_{end}_{axis}" for end in ("min", "max") for axis in "xyz")]
    for frame in range(plan.request.frames):
        x = np.concatenate(plan.surface_vertices(worn, frame))
        lines.append(f"{frame}," + ",".join(f"{value:.6f}" for value in np.r_[x.min(0) - MARGIN, x.max(0) + MARGIN]))
    return "\n".join(lines) + "\n"


def _mass(plan: Plan) -> float:
    """Both garments together, to the gram, as a kitchen balance gives it [kg]."""
    masses = []
    for fitting in plan.fittings.values():
        pattern = np.c_[fitting.garment.uv_vertices, np.zeros(len(fitting.garment.uv_vertices))]
        masses.append(fitting.fabric.areal_density * face_areas(pattern, fitting.garment.uv_faces).sum())
    return round(float(sum(masses)), 3)
