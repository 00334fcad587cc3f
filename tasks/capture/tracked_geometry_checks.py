"""What can be wrong with the arrays of a tracked garment; every array is looked at before anything is refused.

Shapes are written with named axes, which must agree between arrays. Values are looked at only where the shape holds, and the surface only
where the values do: an array that is faulty by itself is left out of what follows, the others are not.
"""

import json
import math

import numpy as np

from tasks.capture.hang_checks import hang_faults
from tasks.capture.pattern_checks import pattern_faults
from tasks.geometry.faults import Fault
from tasks.geometry.meshes import edge_lengths, edges, loose_vertex_faults, mesh_faults

AXES = {
    "vertices": ("T", "V", 3),
    "faces": ("F", 3),
    "fps": (),
    "collider_vertices": ("T", "C", 3),
    "collider_faces": ("G", 3),
    "boundary": ("B",),
    "rest_vertices": ("V", 3),
    "up": (),
    "mass_kg": (),
    "observed": ("T", "V"),
    "noise_m": None,  # scalar, [V] or [T, V]
    "noise_cov": ("T", "V", 3, 3),
    "uv": ("V", 2),
    "zone": ("V",),
    "rest_flat": (),
    "base": (),
    "clamp_force": ("T",),
    "markers": ("T", "M", 3),
    "marker_faces": ("M",),
    "marker_barycentric": ("M", 3),
}
KEYS = tuple(AXES)
KINDS = {"observed": "b", "rest_flat": "b", "up": "U", "base": "U", "zone": "U"} | dict.fromkeys(
    ("faces", "collider_faces", "boundary", "marker_faces"), "iu"
)
FARTHEST = 1000.0  # m
FASTEST = 50.0  # m/s; a cracking whip's tip is faster, cloth on a person is not
FACTOR = 2.0  # between edges at rest and as worn, in the median: beyond it lies another unit
ODD, MOST_ODD = 3.0, 0.25  # where the vertices stand in another order, more edges than this share differ by more than this factor
COLLAPSED = 0.01  # of the median frame's extent


def tracked_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    """Every fault of these arrays, keyed as in `tracked_geometry`."""
    size, faults = _shape_faults(arrays, name)
    faults += _presence_faults(arrays, name)
    sound = _without_faulty(arrays, faults, name)
    faults += _scalar_faults(sound, name) + _index_faults(sound, name, size) + _value_faults(sound, name)
    sound = _without_faulty(sound, faults, name)
    faults += _collapse_faults(sound, name)
    sound = _without_faulty(sound, faults, name)
    return faults + _surface_faults(sound, name) + _motion_faults(sound, name)


def _without_faulty(arrays: dict[str, np.ndarray], faults: list[Fault], name: str) -> dict[str, np.ndarray]:
    faulty = {fault.where.removeprefix(f"{name}: ") for fault in faults}
    return {key: array for key, array in arrays.items() if key in KEYS and key not in faulty}


def _shape_faults(arrays: dict[str, np.ndarray], name: str) -> tuple[dict[str, int], list[Fault]]:
    size, faults = {}, []
    for key, axes in AXES.items():
        if key not in arrays:
            continue
        array, kinds = arrays[key], KINDS.get(key, "fiu")
        if array.size and array.dtype.kind not in kinds and not (key in ("observed", "rest_flat") and array.dtype.kind in "iu"):
            faults.append(Fault(f"{name}: {key}", f"has type {array.dtype}", f"Expected {_kind_name(kinds)}."))
        if axes is not None and not _fits(array.shape, axes, size):
            expected = ", ".join(f"{a}={size[a]}" if a in size else str(a) for a in axes)
            faults.append(Fault(f"{name}: {key}", f"has shape {array.shape}", f"Expected [{expected}]."))
    if "noise_m" in arrays and arrays["noise_m"].shape not in ((), (size.get("V"),), (size.get("T"), size.get("V"))):
        faults.append(Fault(f"{name}: noise_m", f"has shape {arrays['noise_m'].shape}", f"Expected a scalar, [V] or [T, V] of {size}."))
    return size, faults


def _fits(shape: tuple[int, ...], axes: tuple, size: dict[str, int]) -> bool:
    if len(shape) != len(axes):
        return False
    return all(n == (size.setdefault(a, n) if isinstance(a, str) else a) for n, a in zip(shape, axes, strict=True))


def _kind_name(kinds: str) -> str:
    return {"b": "booleans", "U": "text", "iu": "integers"}.get(kinds, "real numbers")


def _presence_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    faults = [Fault(name, f"has no {key!r}", "It is required.") for key in ("faces", "fps") if key not in arrays]
    if "vertices" not in arrays and not ("markers" in arrays and "rest_vertices" in arrays):
        faults.append(Fault(name, "has no 'vertices'", "Give them, or markers together with rest_vertices."))
    for together in (("collider_vertices", "collider_faces"), ("markers", "marker_faces", "marker_barycentric")):
        given = [k for k in together if k in arrays]
        if given and len(given) < len(together):
            faults.append(Fault(name, f"has {given} alone", f"{', '.join(together)} belong together."))
    faults += [
        Fault(f"{name}: {k}", "is empty", "Leave the key out.")
        for k in ("vertices", "faces", "markers", "collider_vertices", "collider_faces")
        if k in arrays and not arrays[k].size
    ]
    return faults


def _scalar_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    faults = []
    for key, low, high, unit in (("fps", 1, 2000, "frames per second"), ("mass_kg", 0.001, 50, "kilograms")):
        if key in arrays and not low <= float(arrays[key]) <= high:
            faults.append(Fault(f"{name}: {key}", f"is {arrays[key]}", f"Give it in {unit}, {low} to {high}."))
    if "base" in arrays and not _is_json_object(str(arrays["base"])):
        faults.append(
            Fault(f"{name}: base", f"is {str(arrays['base'])[:80]!r}", "Give a JSON object of base parameters with finite numbers.")
        )
    return faults


def _is_json_object(text: str) -> bool:
    try:
        content = json.loads(text, parse_constant=lambda _: math.nan)
    except (ValueError, RecursionError):
        return False
    return isinstance(content, dict) and not any(isinstance(v, float) and not math.isfinite(v) for v in content.values())


def _index_faults(arrays: dict[str, np.ndarray], name: str, size: dict[str, int]) -> list[Fault]:
    faults = []
    for key, axis in (("faces", "V"), ("collider_faces", "C"), ("boundary", "V"), ("marker_faces", "F")):
        index = arrays.get(key, np.zeros(0, int)) if axis in size else np.zeros(0, int)
        wild = index[(index < 0) | (index >= size.get(axis, 0))]
        if len(wild):
            faults.append(Fault(f"{name}: {key}", f"names {wild[0]} but there are {size[axis]}", "Indices count from 0."))
    if "boundary" in arrays and len(np.unique(arrays["boundary"])) < len(arrays["boundary"]):
        faults.append(Fault(f"{name}: boundary", "names a vertex twice", "Name each boundary vertex once."))
    return faults


def _value_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    faults = []
    for key in ("vertices", "markers"):
        if key in arrays and np.isinf(arrays[key]).any():
            faults.append(Fault(f"{name}: {key}", "holds infinite values", "Mark what was not seen with NaN."))
    for key in ("vertices", "markers", "collider_vertices", "rest_vertices", "uv"):
        if key in arrays and (np.abs(arrays[key][np.isfinite(arrays[key])]) > FARTHEST).any():
            faults.append(Fault(f"{name}: {key}", f"holds lengths above {FARTHEST:g} m", "Lengths must be in metres; rescale the file."))
    for key in ("collider_vertices", "rest_vertices", "uv", "noise_m", "clamp_force", "marker_barycentric"):
        if key in arrays and not np.isfinite(arrays[key]).all():
            faults.append(Fault(f"{name}: {key}", _not_finite(key, arrays[key]), "It must be known everywhere."))
    faults += _observed_faults(arrays, name) + _noise_faults(arrays, name)
    b = arrays.get("marker_barycentric")
    if b is not None and np.isfinite(b).all() and ((np.abs(b) > 10).any() or (np.abs(b.sum(1) - 1) > 1e-4).any()):
        faults.append(
            Fault(
                f"{name}: marker_barycentric",
                f"ranges from {b.min():.4g} to {b.max():.4g}",
                "Its rows must sum to 1 and lie near the face.",
            )
        )
    return faults


def _not_finite(key: str, array: np.ndarray) -> str:
    """How many values, and of an array over time in which frames."""
    wild = ~np.isfinite(array)
    said = f"{np.count_nonzero(wild)} values are not finite"
    if (AXES[key] or ("",))[0] != "T":
        return said
    frames = np.flatnonzero(wild.reshape(len(array), -1).any(1))
    return f"{said}, in {len(frames)} of {len(array)} frames, the first is frame {frames[0]}"


def _observed_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    if "vertices" not in arrays:
        return []
    seen, faults = np.isfinite(arrays["vertices"]).all(2), []
    if "observed" in arrays and (arrays["observed"].astype(bool) & ~seen).any():
        t, v = np.argwhere(arrays["observed"].astype(bool) & ~seen)[0]
        faults.append(Fault(f"{name}: observed", f"vertex {v} of frame {t} counts as seen but is NaN", "Set observed to false there."))
    if not seen.any() and "markers" not in arrays:
        faults.append(Fault(f"{name}: vertices", "no vertex is seen in any frame", "Give at least one frame."))
    B = arrays.get("boundary", np.zeros(0, int))
    if B.size and B.min() >= 0 and B.max() < seen.shape[1] and not seen[:, B].all():
        t, k = np.argwhere(~seen[:, B])[0]
        faults.append(
            Fault(
                f"{name}: boundary",
                f"vertex {B[k]} is not known in frame {t}",
                "Boundary vertices drive the motion; know them in all frames.",
            )
        )
    return faults


def _noise_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    faults = []
    s = arrays.get("noise_m")
    if s is not None and np.isfinite(s).all() and (s.min() < 0 or s.max() >= 1):
        faults.append(Fault(f"{name}: noise_m", f"ranges from {s.min():.4g} to {s.max():.4g} m", "Give a standard deviation in metres."))
    if "noise_cov" in arrays and not _are_covariances(_covariances_of_seen(arrays)):
        faults.append(
            Fault(f"{name}: noise_cov", "is no covariance in m² where vertices are seen", "It must be symmetric, positive and below 1 m².")
        )
    return faults


def _covariances_of_seen(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """noise_cov [n, 3, 3] m² of the vertices seen; of all where markers stand for vertices."""
    Σ = arrays["noise_cov"].astype(float)
    return Σ[np.isfinite(arrays["vertices"]).all(2)] if "vertices" in arrays else Σ.reshape(-1, 3, 3)


def _are_covariances(Σ: np.ndarray) -> bool:
    """Whether all Σ [n, 3, 3] m² are finite, symmetric, positive definite and below 1 m²."""
    if not len(Σ):
        return True
    if not np.isfinite(Σ).all() or Σ.max() > 1:
        return False
    return np.abs(Σ - Σ.transpose(0, 2, 1)).max() <= 1e-6 * np.abs(Σ).max() and np.linalg.eigvalsh(Σ).min() > 0


def _collapse_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    """Frames in which garment or collider is gone to a point, of those that show at least half of it: few vertices may lie close together."""
    faults = []
    for key, remedy in (("vertices", "Mark what was not seen with NaN."), ("collider_vertices", "Give the body there, or cut that off.")):
        if key not in arrays:
            continue
        x = arrays[key].astype(float)
        known = _known(arrays) if key == "vertices" else np.ones(x.shape[:2], bool)
        frames = np.flatnonzero(known.mean(1) >= 0.5)
        extent = np.array([np.linalg.norm(np.ptp(x[t, known[t]], axis=0)) for t in frames])
        usual = np.median(extent) if len(frames) else np.nan
        gone = frames[extent <= COLLAPSED * usual]
        if len(gone):
            where = f"in {len(gone)} of {len(x)} frames, the first is frame {gone[0]}"
            faults.append(Fault(f"{name}: {key}", f"{extent.min():.3g} m across {where}; the median is {usual:.3g} m", remedy))
    return faults


def _known(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """Which vertices [T, V] the file tells: those that are finite, and observed or driven."""
    finite = np.isfinite(arrays["vertices"]).all(2)
    told = arrays["observed"].astype(bool) if "observed" in arrays else finite.copy()
    told[:, arrays.get("boundary", np.zeros(0)).astype(np.int64)] = True
    return finite & told


def _surface_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    """The garment at rest and as worn, its pattern and the collider as meshes in metres, and noise beside them."""
    faults, faces = [], arrays.get("faces")
    surface = _surface(arrays)
    if surface is None and faces is not None and "vertices" in arrays and "rest_vertices" not in arrays:
        faults.append(Fault(name, "no frame shows the whole garment and there is no rest shape", "Give rest_vertices."))
    if faces is not None and surface is not None:
        where = f"{name}: rest_vertices" if "rest_vertices" in arrays else name
        faults += mesh_faults(surface.astype(float), faces.astype(np.int64), where) + loose_vertex_faults(faces, len(surface), name)
        faults += _worn_faults(arrays, name, faults) if {"vertices", "rest_vertices"} <= set(arrays) else []
    sound = not faults
    if sound and faces is not None and surface is not None:
        faults += _wide_noise_faults(arrays, surface, name)
    if sound and faces is not None and "uv" in arrays:
        faults += pattern_faults(arrays["uv"].astype(float), faces.astype(np.int64), surface, name)
    if "collider_vertices" in arrays and "collider_faces" in arrays:
        faults += mesh_faults(arrays["collider_vertices"][0].astype(float), arrays["collider_faces"].astype(np.int64), f"{name}: collider")
    return faults


def _worn_faults(arrays: dict[str, np.ndarray], name: str, at_rest: list[Fault]) -> list[Fault]:
    """Of the frame that is known best, by itself and beside the rest shape, whose own faults are told already."""
    known, rest, faces = _known(arrays), arrays["rest_vertices"].astype(float), arrays["faces"].astype(np.int64)
    frame = int(known.sum(1).argmax())
    worn = arrays["vertices"][frame].astype(float)
    told = {fault.what for fault in at_rest}
    faults = mesh_faults(worn, faces, f"{name}: vertices") if known[frame].all() else []
    faults = [fault for fault in faults if fault.what not in told]
    e = edges(faces)
    e = e[known[frame][e].all(1)]
    length, length_at_rest = edge_lengths(worn, e), edge_lengths(rest, e)
    if faults or at_rest or not length.any():
        return faults
    ratio = length_at_rest[length > 0] / length[length > 0]
    low, usual, high = np.quantile(ratio, [0.25, 0.5, 0.75])
    if 1 / FACTOR <= usual <= FACTOR and np.mean(np.abs(np.log(ratio)) > np.log(ODD)) <= MOST_ODD:
        return []
    what = f"its edges are {usual:.3g} times as long as those of frame {frame}, half of them {low:.3g} to {high:.3g} times"
    remedy = "Give this garment's rest shape in metres, its vertices in the order of `vertices`, or leave it out."
    return [Fault(f"{name}: rest_vertices", what, remedy)]


def _wide_noise_faults(arrays: dict[str, np.ndarray], surface: np.ndarray, name: str) -> list[Fault]:
    """Noise in another unit: beyond the length of an edge of the surface [V, 3] m a track would tell nothing of the cloth."""
    edge, stated = float(np.median(edge_lengths(surface.astype(float), edges(arrays["faces"])))), {}
    if "noise_m" in arrays:
        stated["noise_m"] = _noise_of_known(arrays)
    if "noise_cov" in arrays:
        stated["noise_cov"] = np.sqrt(np.trace(_covariances_of_seen(arrays), axis1=1, axis2=2) / 3)
    return [
        Fault(
            f"{name}: {key}", f"is {np.median(σ):.3g} m in the median, and the edges of the garment are {edge:.3g} m long", "Give metres."
        )
        for key, σ in stated.items()
        if σ.size and np.median(σ) > edge
    ]


def _noise_of_known(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """noise_m [n] m of what is known; all of it where markers stand for vertices."""
    s = arrays["noise_m"].astype(float)
    if "vertices" not in arrays:
        return s.ravel()
    known = _known(arrays)
    return np.broadcast_to(s, known.shape)[known]


def _surface(arrays: dict[str, np.ndarray]) -> np.ndarray | None:
    """The rest shape, or of the frames with a place for everything the best known one [V, 3] m."""
    if "rest_vertices" in arrays or "vertices" not in arrays:
        return arrays.get("rest_vertices")
    whole = np.flatnonzero(np.isfinite(arrays["vertices"]).all((1, 2)))
    return arrays["vertices"][whole[_known(arrays)[whole].sum(1).argmax()]] if len(whole) else None


def _motion_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    """How fast everything moves, and which way free cloth hangs."""
    if "fps" not in arrays:
        return []
    faults = []
    for key in ("vertices", "collider_vertices", "markers"):
        if key in arrays and len(arrays[key]) > 1:
            step = np.linalg.norm(np.diff(arrays[key].astype(float), axis=0), axis=2) * float(arrays["fps"])
            step = np.where(np.isfinite(step), step, 0)
            if step.max() > FASTEST:
                t, v = np.unravel_index(step.argmax(), step.shape)
                what = f"point {v} moves at {step.max():.4g} m/s after frame {t}"
                faults.append(Fault(f"{name}: {key}", what, "Check the unit (metres), fps and the order of frames."))
    return faults or hang_faults(arrays, name)
