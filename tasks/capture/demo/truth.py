"""What the demo knows and no stage may see: the true body, garments, fabrics, paint and cameras, as NPZ files of plain arrays.

body.npz       shape [S], expression [E], pose [T, 55, 3] rad, translation [T, 3] m, joints [T, 55, 3] m, keypoints [T, 133, 3] m,
               vertices [T, V, 3] m (float32), faces [F, 3], colours [V, 3] linear albedo
<garment>.npz  vertices [T, V, 3] m as simulated, faces, uv_vertices [U, 2] m, uv_faces, boundary [B]; albedo [h, w, 3] linear, over
               `uv_extent` [2] m; fabric in SI (areal_density, stretch, bending_rigidity, friction) and in the units ρ, κ_s, κ_b;
               air_normal_drag m²/kg, the effect that the base model lacks
template.npz   vertices [T, V, 3] m: where the template's vertices truly are at every frame (without the scan's noise)
cameras.npz    names, K, R, t, size, gains [camera, 3]
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.body.wholebody import keypoints133
from tasks.capture.demo.dressing import Fitting
from tasks.capture.demo.files import write_whole
from tasks.capture.demo.plan import Plan
from tasks.capture.demo.rendering import Surface
from tasks.capture.demo.scan import Scan

Array = NDArray[np.float64]


def write_truth(folder: Path, plan: Plan, worn: dict[str, Array], scan: Scan) -> None:
    """Write all files of the truth; worn: simulated garment vertices [T, V, 3] m."""
    body, *garments = plan.surfaces
    arrays = {"body": _body(plan, body), "template": {"vertices": template_motion(plan, worn, scan)}, "cameras": _cameras(plan)}
    for surface in garments:
        arrays[surface.name] = _garment(plan.fittings[surface.name], worn[surface.name], surface)
    for name, content in arrays.items():
        write_whole(folder / f"{name}.npz", lambda aside, content=content: _save(aside, content))


def template_motion(plan: Plan, worn: dict[str, Array], scan: Scan) -> Array:
    """True places [T, V, 3] m of the template's vertices."""
    surfaces = {"body": plan.actor.posed.vertices, **worn}
    return np.concatenate([place.of(surfaces[name]) for name, place in scan.places.items()], 1)


def _body(plan: Plan, surface: Surface) -> dict[str, np.ndarray]:
    actor = plan.actor
    return {
        "shape": actor.shape,
        "expression": actor.expression,
        "pose": actor.motion.pose,
        "translation": actor.motion.translation,
        "joints": actor.posed.joints,
        "keypoints": keypoints133(actor.model, actor.posed.vertices, actor.posed.joints),
        "vertices": actor.posed.vertices.astype(np.float32),
        "faces": actor.model.faces,
        "colours": surface.colours,
    }


def _garment(fitting: Fitting, worn: Array, surface: Surface) -> dict[str, np.ndarray]:
    garment, fabric = fitting.garment, fitting.fabric
    return {
        "vertices": worn,
        "faces": garment.faces,
        "uv_vertices": garment.uv_vertices,
        "uv_faces": garment.uv_faces,
        "boundary": garment.boundary,
        "albedo": surface.texture.astype(np.float16),
        "uv_extent": garment.uv_vertices.max(0),
        "areal_density": np.array(fabric.areal_density),
        "stretch": np.array(fabric.stretch_stiffness),
        "bending_rigidity": np.array(fabric.bending_rigidity),
        "friction": np.array(fabric.friction),
        "density": np.array(fabric.density),
        **{name: np.squeeze(θ) for name, θ in fitting.unmodelled.items()},
        "kappa_s": np.array(fabric.membrane),
        "kappa_b": np.array(fabric.bending),
    }


def _cameras(plan: Plan) -> dict[str, np.ndarray]:
    c = plan.cameras
    return {"names": np.array(c.names), "K": c.K, "R": c.R, "t": c.t, "size": c.size, "gains": plan.gains}


def _save(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)
