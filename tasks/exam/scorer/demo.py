"""The demo's answers against its truth. Arrays in, figures out; the only reader of the truth calls this, after the stages are done."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
BODY_JOINTS = slice(0, 22)  # pelvis to wrists


def mean_joint_error_mm(found: Array, truth: Array) -> float:
    """Mean distance [mm] of the 22 body joints; found and truth [frame, 55, 3] m."""
    return float(1e3 * np.linalg.norm(found[:, BODY_JOINTS] - truth[:, BODY_JOINTS], axis=-1).mean())


def vertex_rmse_mm(found: Array, truth: Array, *, of: NDArray[np.bool_]) -> float:
    """Root mean square distance [mm] of the vertices `of` [V]; found and truth [frame, V, 3] m."""
    return float(1e3 * np.sqrt(np.mean(np.sum((found[:, of] - truth[:, of]) ** 2, -1))))


def ratio(estimate: Mapping[str, Any], truth: float) -> float | None:
    """Estimate over truth, None where there is no estimate."""
    return None if estimate["value"] is None else float(estimate["value"] / truth)


def demo_scores(
    *,
    joints: tuple[Array, Array],
    keypoint_joints: Array,
    vertices: tuple[Array, Array],
    garment: Mapping[str, NDArray[np.bool_]],
    fabric: Mapping[str, Mapping[str, Mapping[str, Any]]],
    true_fabric: Mapping[str, Mapping[str, float]],
    psnr: Array,
    planted: str,
    verdict: Mapping[str, Any],
) -> dict[str, dict[str, Any]]:
    """All figures of the report's section on the truth; pairs are (found, truth), `garment` marks each garment's vertices [V].

    keypoint_joints [frame, 55, 3] m: before registration; planted: the effect that the garments were made with and the base model lacks, its
    strength in true_fabric; verdict: the diagnosis' answer. Where the fabric was fitted with that effect there is nothing left to be
    named, and its strength is compared instead.
    """
    scores = {
        "mean joint error": {"value": mean_joint_error_mm(*joints), "unit": "mm"},
        "mean joint error before registration": {"value": mean_joint_error_mm(keypoint_joints, joints[1]), "unit": "mm"},
    }
    for name, of in garment.items():
        scores[f"{name}: tracked vertices, rms error"] = {"value": vertex_rmse_mm(*vertices, of=of), "unit": "mm"}
    for name, found in fabric.items():
        for parameter, true in true_fabric[name].items():
            if parameter in found:
                scores[f"{name}: {parameter}, estimate/truth"] = {"value": ratio(found[parameter], true), "unit": "1"}
    if not any(planted in found for found in fabric.values()):
        named = {n for names in verdict["verdict"]["class"] for n in names}
        scores[f"planted {planted} is in the class named"] = {"value": float(planted in named), "unit": "1"}
        believed = [row["probability"] for row in verdict["ranking"] if planted in row["class"]]
        scores[f"probability given to {planted}"] = {"value": float(sum(believed)), "unit": "1"}
    if np.isfinite(psnr).any():
        scores["image likeness, mean PSNR"] = {"value": float(np.nanmean(psnr)), "unit": "dB"}
    return scores
