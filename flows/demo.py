"""The demo actor: its recording is made on first use, and its results are compared with a truth that no stage can open."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field
from rich.console import Console
from rich.progress import Progress

from storage_schemas.appearance import Appearance
from storage_schemas.body import Body
from storage_schemas.cloth import Cloth
from storage_schemas.gap import Gap
from storage_schemas.reference import ArtifactRef
from storage_schemas.registration import Registration
from storage_schemas.store import Store
from storage_schemas.tracking import Tracking
from tasks.exam.scorer.demo import demo_scores
from tasks.stage import Count, Parameters

DEMO, SEQUENCE = "demo", "Sequence1"
PLANTED = "air_normal_drag"  # the garments move in air, which the base model lacks
TRUTH = "demo.truth"  # the ending closes it to every stage
COMPARED = ("body", "tracking", "registration", "cloth", "appearance", "gap")


class DemoParameters(Parameters):
    """Size of the demo recording. Another size wants another data folder: a recording is never overwritten."""

    cameras: int = Field(default=8, ge=2)
    frames: int = Field(default=30, ge=2)
    size: Count = 512
    spp: Count = 16
    seed: int = Field(default=2026, ge=0)


def ensure_demo(data: Path, parameters: DemoParameters, console: Console) -> None:
    """Make the demo recording below `data`, or go on with one that was interrupted; returns at once when it is there."""
    from tasks.capture.demo.plan import Request
    from tasks.capture.demo.recording import make_demo_recording

    cache = Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser()
    with Progress(console=console, transient=True) as progress:
        row = progress.add_task("demo recording", total=None)

        def report(what: str, done: int, total: int) -> None:
            progress.update(row, description=f"demo recording: {what}", completed=done, total=total)

        request = Request(**parameters.model_dump())
        make_demo_recording(data, data / TRUTH, cache=cache, actor=DEMO, sequence=SEQUENCE, request=request, on_progress=report)


def compare_with_truth(data: Path, store: Store, artifacts: dict[str, ArtifactRef]) -> dict[str, Any] | None:
    """The scorer's figures, once all compared stages have run."""
    if any(name not in artifacts for name in COMPARED):
        return None
    truth = {name: dict(np.load(data / TRUTH / DEMO / SEQUENCE / f"{name}.npz", allow_pickle=False)) for name in ("body", "template")}
    body, tracking = store.open(artifacts["body"], Body), store.open(artifacts["tracking"], Tracking)
    registered = store.open(artifacts["registration"], Registration)
    cloth, appearance = store.open(artifacts["cloth"], Cloth), store.open(artifacts["appearance"], Appearance)
    of = {name: vertices_of(tracking, name) for name in cloth.garment_names}
    fabrics = {name: dict(np.load(data / TRUTH / DEMO / SEQUENCE / f"{name}.npz", allow_pickle=False)) for name in cloth.garment_names}
    return demo_scores(
        joints=(registered.joints, truth["body"]["joints"]),
        keypoint_joints=body.joints,
        vertices=(tracking.vertices, truth["template"]["vertices"]),
        garment=of,
        fabric=cloth.parameters,
        true_fabric={name: _fabric(f) for name, f in fabrics.items()},
        psnr=appearance.psnr,
        planted=PLANTED,
        verdict=store.open(artifacts["gap"], Gap).verdict,
    )


def _fabric(truth: dict[str, np.ndarray]) -> dict[str, float]:
    ratios = {f"{name}_over_rho": float(truth[name] / truth["density"]) for name in ("kappa_s", "kappa_b")}
    return {**ratios, PLANTED: float(truth[PLANTED])}


def vertices_of(tracking: Tracking, garment: str) -> np.ndarray:
    """Mask [V] of the tracked vertices of a garment."""
    of = np.zeros(tracking.vertices.shape[1], bool)
    of[tracking.faces[tracking.part_of_face == tracking.part_names.index(garment)]] = True
    return of
