"""The base model: membrane, hinge bending, gravity, inertia, contact and friction of one fabric, ready to be solved."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.simulator.cloth import Cloth, Collider
from tasks.simulator.contact_barrier import ContactBarrier, cipc_stiffness, stiffness
from tasks.simulator.contact_friction import ContactFriction
from tasks.simulator.contact_surface import ContactSurface
from tasks.simulator.fabric import Fabric
from tasks.simulator.gravity import Gravity
from tasks.simulator.hinge_bending import HingeBending
from tasks.simulator.inertia import Inertia
from tasks.simulator.linear_system import LinearSystem
from tasks.simulator.membrane_neohookean import MembraneNeoHookean
from tasks.simulator.membrane_stvk import MembraneStVK
from tasks.simulator.newton import Problem
from tasks.simulator.potential import Potential
from tasks.simulator.settings import Settings

Array = NDArray[np.float64]


def base_problem(
    cloth: Cloth, fabric: Fabric, collider: Collider, collider_rest: Array, *, settings: Settings, potentials: Sequence[Potential] = ()
) -> Problem:
    """The base terms of a cloth in a fabric against a collider [C, 3], and any further `potentials`."""
    mass = fabric.areal_density * cloth.vertex_areas
    membrane = {"stvk": MembraneStVK, "neo_hookean": MembraneNeoHookean}[settings.membrane]
    surface = _surface(cloth, collider, collider_rest, settings)
    barrier = _barrier(surface, mass, fabric, settings)
    terms = [
        Inertia.of(cloth, fabric.areal_density, mass=settings.mass),
        Gravity(mass, settings.gravity),
        membrane.of(cloth, fabric),
        HingeBending.of(cloth, fabric, coupled=settings.bending == "coupled"),
        barrier,
        _friction(barrier, fabric, settings),
        *potentials,
    ]
    system = LinearSystem(len(cloth.x_rest), cloth.boundary, [cloth.faces, cloth.hinges])
    return Problem(
        terms,
        system,
        surface,
        mass,
        cloth.boundary,
        settings.acceleration_tolerance,
        settings.velocity_tolerance,
        settings.newton_iterations,
    )


def _surface(cloth: Cloth, collider: Collider, collider_rest: Array, settings: Settings) -> ContactSurface:
    return ContactSurface(
        cloth,
        collider,
        collider_rest,
        barrier_distance=settings.barrier_distance,
        offset=settings.contact_offset,
        area_weighting=settings.barrier == "per_area",
    )


def _barrier(surface: ContactSurface, mass: Array, fabric: Fabric, settings: Settings) -> ContactBarrier:
    d, ρ = settings.barrier_distance, fabric.areal_density
    if settings.barrier == "cipc":
        everything = np.concatenate([mass, ρ * surface.contact_areas[len(mass) :]])
        return ContactBarrier(surface, cipc_stiffness(float(everything.mean()), d), time_free=True)
    κ = stiffness(ρ, acceleration=settings.contact_acceleration, barrier_distance=d, offset=settings.contact_offset)
    return ContactBarrier(surface, κ)


def _friction(barrier: ContactBarrier, fabric: Fabric, settings: Settings) -> ContactFriction:
    cloth = fabric.friction if fabric.self_friction is None else fabric.self_friction
    return ContactFriction(barrier, collider=fabric.friction, cloth=cloth, velocity=settings.friction_velocity)
