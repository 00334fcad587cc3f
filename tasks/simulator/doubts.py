"""Inputs that can be simulated but are probably not meant; what cannot be simulated is refused (`Cloth`, `simulate`).

Whoever reads geometry asks for doubts, once: parameters outside the range of real cloth, a piece that nothing can hold, a collider that
leaps, prescribed nodes under the skin. `simulate`, which windows call by the hundred, does not. Range of the fabric: design's for the
ratios; densities from voile to felt.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import signed_distance
from tasks.geometry.faults import Fault
from tasks.geometry.meshes import components
from tasks.simulator.cloth import Cloth, Collider
from tasks.simulator.fabric import Fabric

Array = NDArray[np.float64]
PLAUSIBLE = {  # of the fabric's fields
    "density": (50.0, 3000.0),
    "membrane": (0.02, 200.0),
    "bending": (0.1, 500.0),
    "friction": (0.0, 1.5),
    "self_friction": (0.0, 1.5),
    "orthotropy": (-1.5, 1.5),
    "rest_scale": (0.8, 1.25),
    "poisson": (-0.5, 0.5),
}
POSITIVE = ("density", "membrane", "rest_scale")
NOT_NEGATIVE = ("bending", "friction", "self_friction")


def fabric_faults(fabric: Fabric) -> list[Fault]:
    """Parameters with which there is no motion: not finite, or negative where a mass, a stiffness or friction is meant."""
    given = {name: getattr(fabric, name) for name in PLAUSIBLE if getattr(fabric, name) is not None}
    faults = [Fault(f"fabric.{name}", f"{value}", "Give a finite number.") for name, value in given.items() if not np.isfinite(value)]
    faults += [Fault(f"fabric.{name}", f"{given[name]}", "It must be above 0.") for name in POSITIVE if given[name] <= 0]
    faults += [Fault(f"fabric.{name}", f"{given[name]}", "It must not be negative.") for name in NOT_NEGATIVE if given.get(name, 0) < 0]
    if abs(given["poisson"]) >= 1:
        faults.append(Fault("fabric.poisson", f"{given['poisson']}", "It must lie between -1 and 1."))
    return faults


def doubts(
    cloth: Cloth, fabric: Fabric, collider: Collider, x0: Array, collider_motion: Array, boundary_motion: Array, down: Array
) -> list[Fault]:
    """What looks wrong with a start x0 [V, 3] m and motions [T, C, 3], [T, B, 3] m; down [3]: the direction of gravity."""
    return [
        *_implausible(fabric),
        *_unheld(cloth, collider, x0, collider_motion, down),
        *_leaps(collider_motion),
        *_covered_pins(cloth, collider, collider_motion[0], boundary_motion[0]),
    ]


def _implausible(fabric: Fabric) -> list[Fault]:
    found = []
    for name, (low, high) in PLAUSIBLE.items():
        value = getattr(fabric, name)
        if value is not None and not low <= value <= high:
            found.append(Fault(f"fabric.{name}", f"{value:g} is outside {low:g} to {high:g}, the range of real cloth", "Check its unit."))
    return found


def _unheld(cloth: Cloth, collider: Collider, x0: Array, motion: Array, down: Array) -> list[Fault]:
    """Pieces without a prescribed node and, at the start, with no collider under their bounding box."""
    if not np.any(down):
        return []
    label = components(cloth.faces, len(x0))
    skin = motion[0][np.unique(collider.faces)]
    across = np.linalg.svd(np.asarray(down, float)[None])[2][1:]  # two directions square to gravity
    found = []
    for piece in np.setdiff1d(label, label[cloth.boundary]):
        x = x0[label == piece]
        low, high = (x @ across.T).min(0), (x @ across.T).max(0)
        below = skin[skin @ down > (x @ down).min()] @ across.T
        if not len(below) or (below.max(0) < low).any() or (below.min(0) > high).any():
            first = int(np.flatnonzero(label == piece)[0])
            found.append(
                Fault("cloth", f"the piece of vertex {first} has neither boundary nor collider below it", "It will fall for ever.")
            )
    return found


def _leaps(motion: Array) -> list[Fault]:
    """Frames in which the collider's middle moves further than the collider is large."""
    if not motion.shape[1] or len(motion) < 2:
        return []
    middle = motion.mean(1)
    step, size = np.linalg.norm(np.diff(middle, axis=0), axis=1), np.linalg.norm(np.ptp(motion[0], axis=0))
    found = np.flatnonzero(step > size)
    return [
        Fault("collider_motion", f"it moves {step[i]:.3g} m to frame {i + 1} and is {size:.3g} m large", "Check the order of its frames.")
        for i in found[:3]
    ]


def _covered_pins(cloth: Cloth, collider: Collider, skin: Array, pins: Array) -> list[Fault]:
    if not len(pins) or not len(collider.faces):
        return []
    distance = signed_distance(pins, skin, collider.faces)
    if distance.min() >= 0:
        return []
    worst, count = int(distance.argmin()), np.count_nonzero(distance < 0)
    return [
        Fault(
            "boundary_motion",
            f"{count} prescribed nodes lie inside the collider at frame 0, vertex {cloth.boundary[worst]} by {-1e3 * distance[worst]:.2g} mm",
            "The collider gives way there unless yield_collider is off; fit it more closely.",
        )
    ]
