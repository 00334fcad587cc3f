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
from tasks.geometry.meshes import loose_vertex_faults, mesh_faults

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


def tracked_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    """Every fault of these arrays, keyed as in `tracked_geometry`."""
    size, faults = _shape_faults(arrays, name)
    faults += _presence_faults(arrays, name)
    sound = _without_faulty(arrays, faults, name)
    faults += _scalar_faults(sound, name) + _index_faults(sound, name, size) + _value_faults(sound, name)
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
        for k in ("vertices", "faces", "markers")
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


def _surface_faults(arrays: dict[str, np.ndarray], name: str) -> list[Fault]:
    """The garment, its pattern and the collider as meshes in metres."""
    faults, faces = [], arrays.get("faces")
    surface = _surface(arrays)
    if surface is None and faces is not None and "vertices" in arrays and "rest_vertices" not in arrays:
        faults.append(Fault(name, "no frame shows the whole garment and there is no rest shape", "Give rest_vertices."))
    if faces is not None and surface is not None:
        faults += mesh_faults(surface.astype(float), faces.astype(np.int64), name) + loose_vertex_faults(faces, len(surface), name)
    if faces is not None and "uv" in arrays and not faults:
        faults += pattern_faults(arrays["uv"].astype(float), faces.astype(np.int64), surface, name)
    if "collider_vertices" in arrays and "collider_faces" in arrays:
        faults += mesh_faults(arrays["collider_vertices"][0].astype(float), arrays["collider_faces"].astype(np.int64), f"{name}: collider")
    return faults


def _surface(arrays: dict[str, np.ndarray]) -> np.ndarray | None:
    """The rest shape, or the first frame that shows everything [V, 3] m."""
    if "rest_vertices" in arrays or "vertices" not in arrays:
        return arrays.get("rest_vertices")
    whole = np.flatnonzero(np.isfinite(arrays["vertices"]).all((1, 2)))
    return arrays["vertices"][whole[0]] if len(whole) else None


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
