"""Anybody's tracked garment as a scene: boundary, rest shape, density and start from what the file holds.

| the file gives | then | else |
|---|---|---|
| boundary | those nodes are driven | borders that move least against the collider (`boundary.py`); without collider nothing is |
| uv | the pattern is the rest shape, hinges unfolded | rest_vertices; else the first frame as worn |
| mass_kg | the density is known: mass over rest area over t | density 320 kg/m³, only ratios mean anything |
| noise_cov, noise_m | weights (`stated_noise.py`) | 1 mm |

Driven nodes follow the tracked surface, quieted where the file tells its noise (`driven_motion.py`), or ride on the nearest face of the
collider ("skinned": linear blending by the nearest skin, for a surface that is already posed). A collider that the tracked garment pokes
through is drawn in (`collider.py`). What the file says was not observed is not known here either (`known_vertices.py`).
"""

from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tasks.capture.tracked_geometry import TrackedGeometry
from tasks.cloth.boundary import carried, fastened_nodes
from tasks.cloth.collider import deepest_poke, explained, fitted_collider
from tasks.cloth.driven_motion import WornRest, quieted
from tasks.cloth.frame_rate import FEWEST
from tasks.cloth.garment import weighed
from tasks.cloth.known_vertices import first_frame, from_whole, known_vertices
from tasks.cloth.perseverance import PATIENT, Patience
from tasks.cloth.scene import Scene
from tasks.cloth.start import start_velocity
from tasks.cloth.stated_noise import noise_of
from tasks.geometry.faults import Fault, refuse
from tasks.simulator import NO_COLLIDER, Cloth, Collider, Fabric, Settings
from tasks.simulator.doubts import doubts, fabric_faults
from tasks.simulator.settings import BASE

Array = NDArray[np.float64]
Driver = Literal["tracked", "skinned"]

START = Fabric(320.0, 4.0, 60.0)
FEWEST_FRAMES = 1 + FEWEST
FEWEST_FREE = 3  # vertices: fewer have no modes in which a start may be wrong
LEAST_SEEN = 0.3  # share of the positions of vertices that are not driven


@dataclass(frozen=True)
class TrackedScene:
    """The scene, the fabric to start from, whether its density was weighed, its boundary driven the other way [T, B, 3] m (None: there is
    no other), and sentences on what was chosen.
    """

    scene: Scene
    fabric: Fabric
    weighed: bool
    otherwise: Array | None
    chosen: tuple[str, ...]


def tracked_scene(
    track: TrackedGeometry,
    *,
    name: str,
    driver: Driver = "tracked",
    frames: int | None = None,
    at_rest: bool = False,
    fabric: Fabric = START,
    settings: Settings = BASE,
    patience: Patience = PATIENT,
) -> TrackedScene:
    """A scene of `frames` frames after the first one that is wholly known, or best. `name` stands in messages. Raises BadInput with every
    fault.

    The file's `base` overrides the fabric to start from; `at_rest`: the garment is still in its first frame.
    """
    track = replace(track, vertices=known_vertices(track))
    refuse(_faults(track, name, driver, frames, fabric))
    first = first_frame(track.vertices)
    cut = slice(first, None if frames is None else first + frames + 1)
    x, missing = from_whole(track.vertices, track.faces, first)
    x = x[: None if frames is None else frames + 1]
    fabric = replace(fabric, **{k: float(v) for k, v in track.base.items()})
    body = None if track.collider_vertices is None else track.collider_vertices[cut]
    nodes, chosen = _nodes(track, x, body, name)
    refuse([*_driven_faults(track.vertices[cut], nodes, first, name), *_free_faults(nodes, x.shape[1], name)])
    cloth = _cloth(track, x[0], nodes)
    fabric = weighed(fabric, [cloth], track.mass_kg)
    measured = track.noise_m is not None or track.noise_cov is not None
    noise = noise_of(track)[cut]
    collider, motion, drawn = _collider(track, x, body, cloth, float(np.median(noise)))
    quiet = quieted(x[:, nodes], float(np.median(noise)) if measured else 0.0, cloth.x_rest[nodes])
    driven = {"tracked": WornRest(x[0, nodes], quiet[0]).kept(quiet) if worn_at_rest(track) else quiet}
    if body is not None and len(nodes):
        driven["skinned"] = carried(x[0, nodes], body, track.collider_faces)
    scene = Scene(
        cloth=cloth,
        collider=collider,
        collider_motion=motion,
        boundary_motion=driven[driver],
        x0=x[0],
        v0=np.zeros_like(x[0]) if at_rest else start_velocity(x, track.fps),
        observed=np.where(track.observed[cut][..., None], x, np.nan),
        noise_m=noise,
        fps=track.fps,
        settings=settings,
        patience=patience,
        noise_cov=None if track.noise_cov is None else track.noise_cov[cut],
    )
    others = [path for kind, path in driven.items() if kind != driver]
    frames_told = f"frames {first} to {first + len(x) - 1} of {len(track.vertices)}"
    if missing:
        frames_told += f"; no frame shows the whole garment, and {missing} vertices of the first were filled in from the frames around it"
    told = (frames_told, *chosen, *_driven_said(driven, driver), *drawn)
    told += tuple(f"doubtful: {d}" for d in doubts(cloth, fabric, collider, x[0], motion, driven[driver], np.array(settings.gravity)))
    return TrackedScene(scene, fabric, track.mass_kg is not None, others[0] if others else None, told)


def worn_at_rest(track: TrackedGeometry) -> bool:
    """Whether a frame as tracked is the rest shape, for the file gives no other."""
    return track.uv is None and track.rest_vertices is None


def _faults(track: TrackedGeometry, name: str, driver: Driver, frames: int | None, fabric: Fabric) -> list[Fault]:
    faults = _free_faults(track.boundary, track.vertices.shape[1], name)
    known = np.isfinite(track.vertices).all(2)
    never = np.flatnonzero(~known.any(0))
    share = float(np.delete(track.observed & known, track.boundary, 1).mean()) if len(track.boundary) < known.shape[1] else 1.0
    if not known.any():
        faults.append(Fault(f"{name}: vertices", "are absent", "Fitting needs the tracked surface, not only markers."))
    elif len(never):
        what = f"{len(never)} of {known.shape[1]} are never seen, the first is vertex {never[0]}"
        faults.append(Fault(f"{name}: vertices", what, "Cut the mesh to what was tracked, or give them in at least one frame."))
    elif (left := len(known) - first_frame(track.vertices)) < FEWEST_FRAMES:
        faults.append(Fault(f"{name}: vertices", f"{left} frames from the one to start from on", f"Give at least {FEWEST_FRAMES}."))
    elif frames is not None and frames + 1 < FEWEST_FRAMES:
        what = f"{frames + 1} frames from the one to start from on, as many as are asked for"
        faults.append(Fault(f"{name}: vertices", what, f"Ask for at least {FEWEST_FRAMES - 1} after the first."))
    if known.any() and share < LEAST_SEEN:
        what = f"only {share:.0%} of the positions of vertices that are not driven are seen"
        faults.append(Fault(f"{name}: vertices", what, f"Give frames that show at least {LEAST_SEEN:.0%}."))
    if driver == "skinned" and track.collider_vertices is None:
        faults.append(Fault(f"{name}: collider_vertices", "are absent", "Nodes can ride on a body only where there is one; use tracked."))
    return faults + _base_faults(track, name, fabric)


def _base_faults(track: TrackedGeometry, name: str, fabric: Fabric) -> list[Fault]:
    """Of the file's `base`, beside which the other parameters are those of the fabric to start from."""
    faults, numbers, known = [], {}, {f.name for f in fields(Fabric)}
    for key, value in track.base.items():
        if key not in known:
            faults.append(Fault(f"{name}: base", f"has the parameter {key!r}", f"Known are {', '.join(sorted(known))}."))
        elif not isinstance(value, int | float):
            faults.append(Fault(f"{name}: base", f"{key} is {value!r}", "Give a number."))
        else:
            numbers[key] = float(value)
    faults += [Fault(f"{name}: base: {f.where}", f.what, f.remedy) for f in fabric_faults(replace(fabric, **numbers))]
    if numbers.get("bending") == 0:
        faults.append(Fault(f"{name}: base: fabric.bending", "0.0", "It must be above 0: its logarithm is fitted."))
    return faults


def _free_faults(nodes: NDArray[np.int32], count: int, name: str) -> list[Fault]:
    """Where hardly a vertex of `count` is left beside the driven `nodes`."""
    driven = len(np.unique(nodes))
    if count - driven >= FEWEST_FREE:
        return []
    remedy = f"Name those that are held; the others, at least {FEWEST_FREE}, are what is compared."
    return [Fault(f"{name}: boundary", f"{driven} of {count} vertices are driven", remedy)]


def _nodes(track: TrackedGeometry, x: Array, body: Array | None, name: str) -> tuple[NDArray[np.int32], list[str]]:
    """The driven nodes [B], and how they were chosen."""
    if len(track.boundary):
        return track.boundary, [f"boundary: the {len(track.boundary)} nodes that the file names"]
    if body is None:
        return np.empty(0, np.int32), ["boundary: none; the file names none and has no collider, so the garment flies freely"]
    found = fastened_nodes(x, track.faces, body, track.collider_faces)
    if found.unjudged:
        what = f"names no node, and {found.unjudged} borders near the collider are known in too few frames to tell whether it holds them"
        refuse([Fault(f"{name}: boundary", what, "Name the nodes that are held.")])
    motion = [f"{mm:.1f} mm" if np.isfinite(mm) else "hardly known" for _, mm, _ in found.borders]
    each = zip(found.borders, motion, strict=True)
    rows = "; ".join(f"border of {n} nodes, {moves}, {'held' if held else 'free'}" for (n, _, held), moves in each)
    return found.nodes, [
        f"boundary: {len(found.nodes)} nodes chosen where garment and body move least against one another ({rows or 'no border'})"
    ]


def _driven_faults(x: Array, nodes: NDArray[np.int32], first: int, name: str) -> list[Fault]:
    unseen = np.argwhere(~np.isfinite(x[:, nodes]).all(-1))
    if not len(unseen):
        return []
    t, k = unseen[0]
    return [
        Fault(f"{name}: vertices", f"driven vertex {nodes[k]} is not known in frame {first + t}", "Give `boundary` nodes that always are.")
    ]


def _cloth(track: TrackedGeometry, x0: Array, nodes: NDArray[np.int32]) -> Cloth:
    if track.uv is not None:
        return Cloth(x0, track.faces, nodes, uv=track.uv[track.faces], rest_angles="flat")
    rest = x0 if track.rest_vertices is None else track.rest_vertices
    return Cloth(rest, track.faces, nodes, rest_angles="flat" if track.rest_flat else "worn")


def _collider(track: TrackedGeometry, x: Array, body: Array | None, cloth: Cloth, noise: float) -> tuple[Collider, Array, tuple[str, ...]]:
    if body is None:
        return NO_COLLIDER, np.zeros((len(x), 0, 3)), ()
    depth = deepest_poke(body, track.collider_faces, x)
    if depth <= explained(noise):
        return Collider(track.collider_faces), body, ()
    fitted = fitted_collider(body, track.collider_faces, x, track.faces, fastened=cloth.boundary, noise=noise)
    said = f"collider: drawn in by up to {1e3 * fitted.drawn_in.max():.1f} mm, as the tracked garment was {1e3 * depth:.1f} mm inside"
    return Collider(fitted.faces), fitted.motion, (said,)


def _driven_said(driven: dict[str, Array], driver: Driver) -> tuple[str, ...]:
    if len(driven) < 2:
        return (f"boundary driven by {driver} positions",)
    apart = 1e3 * np.linalg.norm(driven["tracked"] - driven["skinned"], axis=2)
    other = next(kind for kind in driven if kind != driver)
    rms, most = float(np.sqrt(np.mean(apart**2))), float(apart.max())
    return (f"boundary driven by {driver} positions; {other} ones lie {rms:.1f} mm away (root mean square, at most {most:.1f} mm)",)
