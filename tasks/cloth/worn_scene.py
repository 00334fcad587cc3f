"""A garment of the pipeline as a scene: rest shape from the pattern where there is one, the fitted body as collider, driven where it is fastened."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.boundary import fastened_nodes
from tasks.cloth.driven_motion import WornRest, quieted
from tasks.cloth.garment import Garment
from tasks.cloth.perseverance import PATIENT, Patience
from tasks.cloth.rest_shape import pattern
from tasks.cloth.scene import Scene
from tasks.cloth.start import start_velocity
from tasks.cloth.stated_noise import of_seen
from tasks.cloth.worn_collider import worn_collider
from tasks.simulator import Cloth, Collider, Settings
from tasks.simulator.settings import BASE

Array = NDArray[np.float64]


def worn_scene(
    garment: Garment,
    body: Array,
    body_faces: NDArray[np.int32],
    uv_vertices: Array,
    *,
    fps: float,
    rest: Literal["pattern", "worn"] = "pattern",
    settings: Settings = BASE,
    patience: Patience = PATIENT,
) -> Scene:
    """Of a garment over T frames on body [T, C, 3] m; uv_vertices [U, 2] of the tracked surface's atlas (may be empty)."""
    observed = garment.observed
    fastening = fastened_nodes(observed, garment.faces, body, body_faces)
    noise_m = of_seen(garment.noise_m, garment.seen)
    noise = float(np.median(noise_m))
    driven = quieted(observed[:, fastening.nodes], noise)
    collider = worn_collider(body, body_faces, observed, garment.faces, fastened=fastening.nodes, noise=noise)
    x0 = observed[0].copy()
    uv = pattern(x0, garment.faces, uv_vertices, garment.uv_faces) if rest == "pattern" else None
    if uv is None:
        driven = WornRest(x0[fastening.nodes], driven[0]).kept(driven)
    x0[fastening.nodes] = driven[0]
    return Scene(
        cloth=Cloth(x0, garment.faces, fastening.nodes, uv=uv, rest_angles="worn" if uv is None else "flat"),
        collider=Collider(collider.faces),
        collider_motion=collider.motion,
        boundary_motion=driven,
        x0=x0,
        v0=start_velocity(observed, fps),
        observed=np.where(garment.seen[..., None], observed, np.nan),
        noise_m=noise_m,
        fps=fps,
        settings=settings,
        patience=patience,
    )
