"""How far the edges of a coarse cloth hold its vertices off a curved body, and the body drawn in by as much.

Real cloth lies on the body. A mesh touches it with its edges first, which leaves their ends, and so the vertices that are compared, above
it by

    s = κ ℓ²/8        κ: curvature of the body along an edge of length ℓ  (the sagitta of a chord)

and the barrier holds them half its distance higher. On an arm and 25 mm edges that is 2–3 mm, systematic, and it looks like a thinner body.
So the body is drawn in by the mean, and of what is left nobody can say within that much whether the body is thinner or the mesh coarse.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion
from tasks.effects.inflated_body import inflated
from tasks.geometry.distances import closest_points
from tasks.geometry.meshes import edges, vertex_normals
from tasks.simulator import Cloth

Array = NDArray[np.float64]

NEAR = 0.008  # [m] of the body: an edge there lies on it
EVERY = 5  # frames


def contact_sagitta(cloth: Cloth, recordings: Sequence[Recording], barrier_distance: float) -> float:
    """Mean height [m] at which contact holds the vertices of edges on the body; 0 where none lie on it."""
    each = np.concatenate([_sagittas(cloth, r, t) for r in recordings if r.collider.faces.size for t in range(0, len(r), EVERY)] or [[]])
    return float(each.mean() + barrier_distance / 2) if len(each) else 0.0


def drawn_in(recording: Recording, distance: float) -> Recording:
    """The recording before a body that is thinner by `distance` [m]."""
    if not recording.collider.faces.size or not distance:
        return recording
    collider = inflated(recording.motion.collider, recording.collider.faces, -distance)
    return replace(recording, motion=Motion(collider, recording.motion.boundary))


def body_speed(recordings: Sequence[Recording], fps: float) -> float:
    """Root mean square speed [m/s] of the vertices of all colliders: with it, a doubt of where the body is becomes one of when."""
    moved = [np.linalg.norm(np.diff(r.motion.collider, axis=0), axis=-1).ravel() for r in recordings]
    return fps * float(np.sqrt(np.mean(np.concatenate(moved) ** 2))) if sum(map(len, moved)) else 0.0


def _sagittas(cloth: Cloth, recording: Recording, t: int) -> Array:
    """κ ℓ²/8 [E] m of the edges that lie on the body at frame t."""
    x, body, faces = recording.observed[t], recording.motion.collider[t], recording.collider.faces
    seen = np.isfinite(x).all(-1)
    closest = closest_points(np.where(seen[:, None], x, 0.0), body, faces)
    e = edges(cloth.faces)
    on = (seen & (closest.distance < NEAR))[e].all(1)
    normals = np.einsum("vk,vki->vi", closest.barycentric, vertex_normals(body, faces)[faces[closest.face]])
    chord, turn = (a[e[on, 1]] - a[e[on, 0]] for a in (x, normals))
    return np.maximum(np.einsum("ei,ei->e", chord, turn), 0) / 8
