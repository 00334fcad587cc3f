"""How a simulation is computed, apart from what is simulated."""

from dataclasses import dataclass, fields
from typing import Literal

from tasks.geometry.faults import Fault


@dataclass(frozen=True)
class Settings:
    """Numerical choices. Accelerations in m/s², lengths in m, velocities in m/s.

    integrator, substeps: implicit rule and steps per frame (h = 1/(fps·substeps)).
    membrane: "stvk" (the base model) or "neo_hookean" (C-IPC). bending "coupled": hinge stiffness carries κ_s as well, as in
    PhysAvatar's code. barrier_distance d̂: cloth is repelled within it. contact_offset: least distance kept between surfaces (thickness).
    contact_acceleration c: strength of the barrier per areal density. barrier "cipc": the original's stiffness rule.
    friction_velocity ε_v: slip below which friction is smoothed.
    acceleration_tolerance: a step is done when the residual force per mass, root mean square, is below it (in large systems, below a
    hundredth of it: newton.py).
    velocity_tolerance: it is also done when Newton's step divided by h, root mean square, is below it (C-IPC's rule, 1e-3; 0: never).
    solver: "exact" (newton.py), or "cipc" (cipc_newton.py: ends where C-IPC would, for comparison only; needs velocity_tolerance).
    newton_iterations: most iterations per step. halvings: how often a step that fails may be halved.
    gravity [3]. yield_collider: let a collider that pinches cloth between two of its own parts, or covers a prescribed node, give way
    there. separate_start: free a start that touches the collider by the smallest move; otherwise such a start ends the simulation with
    the places.
    """

    integrator: Literal["bdf2", "backward_euler"] = "bdf2"
    substeps: int = 4
    mass: Literal["lumped", "consistent"] = "lumped"
    membrane: Literal["stvk", "neo_hookean"] = "stvk"
    bending: Literal["independent", "coupled"] = "independent"
    barrier: Literal["per_area", "cipc"] = "per_area"
    barrier_distance: float = 1e-3
    contact_offset: float = 0.0
    contact_acceleration: float = 100.0
    friction_velocity: float = 1e-3
    acceleration_tolerance: float = 1e-3
    velocity_tolerance: float = 0.0
    solver: Literal["exact", "cipc"] = "exact"
    newton_iterations: int = 100
    halvings: int = 3
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    yield_collider: bool = True
    separate_start: bool = True


BASE = Settings()
AT_LEAST = {"substeps": 1, "newton_iterations": 1, "halvings": 0, "contact_offset": 0.0, "velocity_tolerance": 0.0}
POSITIVE = ("barrier_distance", "contact_acceleration", "friction_velocity", "acceleration_tolerance")


def settings_faults(settings: Settings) -> list[Fault]:
    """Numbers with which nothing can be computed."""
    given = {f.name: getattr(settings, f.name) for f in fields(settings)}
    faults = [Fault(n, f"{given[n]}", f"Give {least} or more.") for n, least in AT_LEAST.items() if not given[n] >= least]
    return faults + [Fault(n, f"{given[n]}", "Give a positive number.") for n in POSITIVE if not given[n] > 0]
