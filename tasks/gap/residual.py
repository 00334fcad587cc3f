"""Where the gap lies: what was observed minus what the fitted physics does, by vertex, frame, zone, direction and frequency.

r[t, i] = x̂[t, i] − x[t, i]; NaN where a vertex was not seen. E = mean |r|² over what was seen; figures are √E in millimetres.
Directions follow the cloth: along its normal and, in its plane, along the pattern's weft (u) and warp (v).
Frequencies by the periodogram of r over time (Hann window, mean removed; a constant offset is its own band).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.gap.zones import ZONES
from tasks.geometry.meshes import vertex_normals

Array = NDArray[np.float64]
BANDS_HZ = ((0.0, 1.0), (1.0, 2.5), (2.5, 6.0), (6.0, np.inf))


@dataclass(frozen=True)
class Where:
    """residual [frame, vertex, 3] m; rms_mm; floor_mm from the observation noise; vertex_mm [vertex]; frame_mm [frame]; tables by name."""

    residual: Array
    rms_mm: float
    floor_mm: float
    vertex_mm: Array
    frame_mm: Array
    by_zone: list[dict[str, Any]]
    by_direction: dict[str, float]
    by_band: list[dict[str, Any]]


def where(
    observed: Array,
    simulated: Array,
    *,
    seen: NDArray[np.bool_],
    noise_m: Array,
    zone: NDArray[np.int32],
    faces: NDArray[np.int32],
    weft: Array | None,
    fps: float,
) -> Where:
    """Split the residual of observed and simulated [T, V, 3] m; seen, noise_m [T, V] (per coordinate); zone [V]; weft [T, V, 3] unit or None."""
    r = np.where((seen & np.isfinite(observed).all(-1))[..., None], observed - simulated, np.nan)
    free = zone != ZONES.index("pinned")
    noise = np.where(np.isfinite(r[..., 0]), noise_m, np.nan)
    return Where(
        residual=r,
        rms_mm=rms_mm(r[:, free]),
        floor_mm=float(1e3 * np.sqrt(3 * np.nanmean(noise[:, free] ** 2))) if np.isfinite(noise[:, free]).any() else float("nan"),
        vertex_mm=np.array([rms_mm(r[:, i]) for i in range(r.shape[1])]),
        frame_mm=np.array([rms_mm(r[t, free]) for t in range(len(r))]),
        by_zone=[_zone_row(r, zone, k, name) for k, name in enumerate(ZONES) if (zone == k).any()],
        by_direction=_by_direction(r[:, free], simulated, faces, weft, free),
        by_band=_by_band(r[:, free], fps),
    )


def rms_mm(r: Array) -> float:
    """√(mean |r|²) in mm over what is not NaN; r [..., 3] m."""
    squared = np.sum(r**2, -1)
    return float(1e3 * np.sqrt(np.nanmean(squared))) if np.isfinite(squared).any() else float("nan")


def _zone_row(r: Array, zone: NDArray[np.int32], k: int, name: str) -> dict[str, Any]:
    squared = np.sum(r**2, -1)
    share = np.nansum(squared[:, zone == k]) / max(np.nansum(squared), 1e-30)
    return {"zone": name, "vertices": int((zone == k).sum()), "rms_mm": rms_mm(r[:, zone == k]), "share": float(share)}


def _by_direction(r: Array, simulated: Array, faces: NDArray[np.int32], weft: Array | None, free: NDArray[np.bool_]) -> dict[str, float]:
    n = np.stack([vertex_normals(x, faces) for x in simulated])[:, free]
    along = {"normal": n}
    if weft is not None:
        u = weft[:, free] - np.sum(weft[:, free] * n, -1, keepdims=True) * n
        u = u / np.maximum(np.linalg.norm(u, axis=-1, keepdims=True), 1e-12)
        along |= {"weft": u, "warp": np.cross(n, u)}
    return {name: float(1e3 * np.sqrt(np.nanmean(np.sum(r * d, -1) ** 2))) for name, d in along.items()}


def _by_band(r: Array, fps: float) -> list[dict[str, Any]]:
    whole = r[:, np.isfinite(r).all((0, 2))]
    if len(whole) < 8 or whole.shape[1] == 0:
        return []
    offset = whole.mean(0)
    power = np.abs(np.fft.rfft((whole - offset) * np.hanning(len(whole))[:, None, None], axis=0)) ** 2
    f = np.fft.rfftfreq(len(whole), 1 / fps)
    moving = np.mean(np.sum((whole - offset) ** 2, -1))
    rows = [{"band": "constant", "rms_mm": rms_mm(offset)}]
    for low, high in BANDS_HZ:
        inside = (f >= low) & (f < high) & (f > 0)
        if not inside.any():
            continue  # slower than the recording is long, or faster than its frames
        part = power[inside].sum() / max(power[1:].sum(), 1e-30)
        rows.append(
            {"band": f"{low:g}–{high:g} Hz" if np.isfinite(high) else f"above {low:g} Hz", "rms_mm": float(1e3 * np.sqrt(part * moving))}
        )
    return rows


def weft_direction(x: Array, faces: NDArray[np.int32], uv_vertices: Array, uv_faces: NDArray[np.int32]) -> Array:
    """The pattern's u direction on the surface, unit [T, V, 3]: ∂x/∂u of each face, averaged by area at its corners. x [T, V, 3] m."""
    e1, e2 = (uv_vertices[uv_faces[:, k]] - uv_vertices[uv_faces[:, 0]] for k in (1, 2))
    det = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    du = np.stack([e2[:, 1], -e1[:, 1]], 1) / np.where(np.abs(det) > 1e-14, det, np.inf)[:, None]  # [F, 2]
    out = np.zeros_like(x)
    for t in range(len(x)):
        d1, d2 = (x[t, faces[:, k]] - x[t, faces[:, 0]] for k in (1, 2))
        g = (d1 * du[:, :1] + d2 * du[:, 1:]) * np.linalg.norm(np.cross(d1, d2), axis=1, keepdims=True)
        for k in range(3):
            np.add.at(out[t], faces[:, k], g)
    return out / np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-12)
