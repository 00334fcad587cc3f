"""Implicit cloth: every force is a term of one incremental potential. See README.md."""

from tasks.simulator.cloth import NO_COLLIDER, Cloth, Collider
from tasks.simulator.fabric import Fabric
from tasks.simulator.potential import Blocks, Potential, Step, StepTangent
from tasks.simulator.settings import Settings
from tasks.simulator.simulate import Frame, simulate
from tasks.simulator.standing import Standing

__all__ = [
    "NO_COLLIDER",
    "Blocks",
    "Cloth",
    "Collider",
    "Fabric",
    "Frame",
    "Potential",
    "Settings",
    "Standing",
    "Step",
    "StepTangent",
    "simulate",
]
