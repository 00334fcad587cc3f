"""Before the first step: where cloth crosses itself or the collider, and the smallest move that frees it from the collider.

`inspect` lists places. `separate` draws the collider in wherever it is in the way and lets it push out again, as slowly as contact
needs, against ½‖x − x₀‖²_M/s² and the cloth's own stiffness: of all shapes free of contact the one that costs least. Cloth that
crosses *itself* is reported, not repaired: which side it should be on is not in the data.
"""

from dataclasses import dataclass, replace

import ipctk
import numpy as np
from numpy.typing import NDArray

from tasks.geometry.distances import closest_points, signed_distance
from tasks.geometry.faults import Fault
from tasks.geometry.meshes import vertex_normals
from tasks.simulator.cloth import Cloth, Collider
from tasks.simulator.contact_barrier import ContactBarrier
from tasks.simulator.contact_surface import ContactSurface
from tasks.simulator.hinge_bending import HingeBending
from tasks.simulator.inertia import Inertia
from tasks.simulator.membrane_neohookean import MembraneNeoHookean
from tasks.simulator.membrane_stvk import MembraneStVK
from tasks.simulator.newton import CONVERGED, Problem, solve
from tasks.simulator.potential import Step
from tasks.simulator.yielding import draw_in

Array = NDArray[np.float64]
TIME = 0.02  # s of the inertia that holds cloth in its place [s]: the larger, the more its own stiffness decides
NEAREST = 0.01  # share of the barrier distance that a start may keep: cloth pressed onto a body rests at 0.03 of it, and goes on from there
ATTEMPTS = 12
FAR = 1e3  # [m] from which no collider touches cloth
# of terms: weight, wind or friction would move cloth by themselves
HOLDING = (Inertia, MembraneStVK, MembraneNeoHookean, HingeBending, ContactBarrier)


@dataclass(frozen=True)
class Separated:
    """x [V, 3] free of contact, the largest move [m], how it ended: "converged" or a reason; and where cloth was moved, what was minimised."""

    x: Array
    moved: float
    ending: str = CONVERGED
    by: tuple[Problem, Step] | None = None


def inspect(
    problem: Problem, cloth: Cloth, collider: Collider, x: Array, collider_x: Array, *, least: float, most: int = 10
) -> list[Fault]:
    """Crossings of x [V, 3] with itself and the collider [C, 3], at most `most` places, the rest counted; where nothing crosses, the two
    surfaces that are nearest, if that is no more than `least` [m].
    """
    surface = problem.surface
    X = surface.join(x, collider_x)
    crossings = _crossings(problem, X) if surface.intersects(X) else []
    faults = [_describe(cloth, collider, X, edge, face) for edge, face in crossings[:most]]
    if len(crossings) > most:
        faults.append(Fault("x0", f"{len(crossings) - most} further crossings", "See the places above."))
    surface.forget()
    if not crossings and surface.least_distance(X) <= least:
        remedy = "Lower contact_offset, weld or move them apart." if surface.offset else "Weld or move them apart."
        faults.append(Fault("x0", f"{surface.tightest(X)}, a start needs {1e3 * least:.3g}", remedy))
    return faults


def separate(problem: Problem, cloth: Cloth, collider: Collider, x: Array, collider_x: Array) -> Separated:
    """Free x [V, 3] from the collider [C, 3]; boundary nodes stay."""
    surface = problem.surface
    if surface.barrier_distance <= 0 or not _blocked(problem, x, collider_x):
        return Separated(x, 0.0)
    small = _drawn_in(problem, collider, x, collider_x)
    if small is None:
        alone = inspect(problem, cloth, collider, x, collider_x + FAR, least=_least(surface))  # no drawing in helps cloth in its own way
        reasons = alone or inspect(problem, cloth, collider, x, collider_x, least=_least(surface))
        return Separated(x, 0.0, "cloth cannot be freed: " + "; ".join(map(str, reasons[:3])))
    held = replace(problem, potentials=[p for p in problem.potentials if isinstance(p, HOLDING)])
    still = np.zeros_like(x)
    step = Step(TIME, TIME, x, still, x, still, collider_x, small, small)
    surface.forget()
    solution = solve(held, x, step, boundary_target=x[problem.boundary])
    moved = float(np.linalg.norm(solution.x - x, axis=1).max())
    if not solution.converged:
        return Separated(solution.x, moved, f"separating cloth from the collider: {solution.ending}")
    return Separated(solution.x, moved, by=(held, step))


def _blocked(problem: Problem, x: Array, collider_x: Array) -> bool:
    surface = problem.surface
    X = surface.join(x, collider_x)
    surface.forget()
    return surface.intersects(X) or surface.least_distance(X) < _least(surface)


def _drawn_in(problem: Problem, collider: Collider, x: Array, collider_x: Array) -> Array | None:
    """The collider drawn in until nothing touches the cloth; None if that does not help."""
    surface, faces = problem.surface, collider.faces
    clear = surface.offset + surface.barrier_distance
    if not len(faces):
        return None
    normals = vertex_normals(collider_x, faces)
    depth = np.zeros(len(collider_x))
    need = clear - signed_distance(x[problem.system.free], collider_x, faces)
    _demand(depth, collider, collider_x, x[problem.system.free][need > 0], need[need > 0])
    for _ in range(ATTEMPTS):
        small = draw_in(collider_x, normals, depth)
        if not _blocked(problem, x, small):
            return small
        X = surface.join(x, small)
        touched = [np.concatenate(pair) for pair in _crossings(problem, X)] or [np.flatnonzero(signed_distance(x, small, faces) < clear)]
        touched += _too_near(problem, X)  # edges may meet where every vertex is clear
        places = X[np.unique(np.concatenate(touched))]
        _demand(depth, collider, collider_x, places, np.full(len(places), 1.3 * depth.max() + 2 * clear))
    return None


def _demand(depth: Array, collider: Collider, collider_x: Array, places: Array, need: Array) -> None:
    """Raise depth [C] to `need` [P] m for the skin around places [P, 3], out to twice that far and fading until four times."""
    if not len(places):
        return
    foot = closest_points(places, collider_x, collider.faces).point
    for q, n in zip(foot, need, strict=True):
        distance = np.linalg.norm(collider_x - q, axis=1)
        reach = 4 * n + np.sort(distance)[min(3, len(distance) - 1)]
        depth[:] = np.maximum(depth, n * np.clip(2 - 2 * distance / reach, 0, 1))


def _crossings(problem: Problem, X: Array) -> list[tuple[NDArray, NDArray]]:
    """(edge [2], face [3]) pairs that cross at X and of which some vertex is free."""
    mesh = problem.surface.mesh
    broad = ipctk.LBVH()
    broad.can_vertices_collide = mesh.can_collide
    broad.build(X, mesh.edges, mesh.faces)
    found = []
    for candidate in broad.detect_edge_face_candidates():
        e, f = mesh.edges[candidate.edge_id], mesh.faces[candidate.face_id]
        if not np.intersect1d(e, f).size and ipctk.is_edge_intersecting_triangle(X[e[0]], X[e[1]], X[f[0]], X[f[1]], X[f[2]]):
            found.append((e, f))
    return found


def _too_near(problem: Problem, X: Array) -> list[NDArray]:
    """Vertices of each pair that is nearer at X than a start may be."""
    surface, found = problem.surface, []
    near = surface.pairs(X)
    for pair in (*near.vv_collisions, *near.ev_collisions, *near.ee_collisions, *near.fv_collisions):
        ids = np.array([i for i in pair.vertex_ids(surface.mesh.edges, surface.mesh.faces) if i >= 0])
        if pair.compute_distance(X[ids].ravel()) < _least(surface) ** 2:
            found.append(ids)
    return found


def _least(surface: ContactSurface) -> float:
    """Distance [m] that a start must have."""
    return surface.offset + NEAREST * surface.barrier_distance


def _describe(cloth: Cloth, collider: Collider, X: Array, edge: NDArray, face: NDArray) -> Fault:
    V = len(cloth.x_rest)
    side = ["collider" if index[0] >= V else "cloth" for index in (edge, face)]
    e, f = (index - V if index[0] >= V else index for index in (edge, face))
    place = ", ".join(f"{value:.4f}" for value in X[edge].mean(0))
    remedy = "Repair the mesh there." if side == ["cloth", "cloth"] else "Let the start be separated, or move the collider."
    return Fault("x0", f"{side[0]} edge {e.tolist()} crosses {side[1]} face {f.tolist()} at ({place}) m", remedy)
