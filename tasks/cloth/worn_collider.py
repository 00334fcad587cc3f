"""The body that the pipeline fitted as collider of a garment worn on it: its skin near the garment, decimated, drawn in (`collider.py`).

What is left out of it is known of that body: it is one piece of skin with eyes and teeth inside, much finer than the cloth, and where it
would have to give way by more than `DEEPEST` it is not there. Of a collider from somebody's file none of this is known.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.collider import DEEPEST, Faces, FittedCollider, fitted_collider
from tasks.geometry.distances import closest_points
from tasks.geometry.faults import Fault, refuse
from tasks.geometry.meshes import components, submesh

Array = NDArray[np.float64]

REACH = 0.25  # [m] body farther from the garment than this in all frames is left out
FACES = 2400  # contact costs grow with both meshes: triangles no finer than the cloth's


def worn_collider(body: Array, body_faces: Faces, garment: Array, garment_faces: Faces, *, fastened: Faces, noise: float) -> FittedCollider:
    """The collider for a garment [T, V, 3] m, noise [m] per coordinate, driven at the nodes `fastened` [B], worn on a body [T, C, 3] m.

    Raises BadInput where nothing is left of it.
    """
    near, faces = _near(*_skin(body, body_faces), garment)
    _refuse_none(faces, f"none of it lies within {REACH:g} m of the garment", "Give body and garment in the same coordinates.")
    fitted = fitted_collider(*_decimated(near, faces), garment, garment_faces, fastened=fastened, noise=noise)
    left = _without_deepest(fitted)
    what = f"the garment lies more than {1e3 * DEEPEST:g} mm inside all of it that is near"
    _refuse_none(left.faces, what, "Look at the registered body: it does not lie inside this garment.")
    return left


def _refuse_none(faces: Faces, what: str, remedy: str) -> None:
    refuse([] if len(faces) else [Fault("body", what, remedy)])


def _skin(body: Array, faces: Faces) -> tuple[Array, Faces]:
    """The largest piece: eyes and teeth are pieces of their own."""
    label = components(faces, body.shape[1])
    own, kept = submesh(faces, label == np.argmax(np.bincount(label)))
    return body[:, kept], own


def _near(body: Array, faces: Faces, garment: Array) -> tuple[Array, Faces]:
    """What lies within `REACH` of the garment: faces by their corners, and those that it lies nearest to, however far off their corners are."""
    from scipy.spatial import cKDTree

    keep = np.zeros(body.shape[1], bool)
    for t in range(0, len(body), 4):
        keep |= cKDTree(garment[t]).query(body[t], distance_upper_bound=REACH)[0] < REACH
        nearest = closest_points(garment[t], body[t], faces)
        keep[faces[nearest.face[nearest.distance < REACH]]] = True
    own, kept = submesh(faces, keep)
    return body[:, kept], own


def _decimated(body: Array, faces: Faces) -> tuple[Array, Faces]:
    """At most `FACES` triangles by edge collapse in frame 0 (Garland & Heckbert 1997), carried by the skin they lie on."""
    import igl

    if len(faces) <= FACES:
        return body, faces
    manifold, corner = igl.split_nonmanifold(
        faces.astype(np.int64)
    )  # qslim returns nothing where the patch's rim touches itself in a vertex
    x, light, *_ = igl.qslim(np.asfortranarray(body[0][corner]), np.asfortranarray(manifold), FACES, True)
    on = closest_points(np.ascontiguousarray(x), body[0], faces)
    return np.einsum("nk,tnkc->tnc", on.barycentric, body[:, faces[on.face]]), np.ascontiguousarray(light, dtype=np.int32)


def _without_deepest(fitted: FittedCollider) -> FittedCollider:
    own, kept = submesh(fitted.faces, fitted.drawn_in.max(0) < DEEPEST)
    return replace(fitted, motion=fitted.motion[:, kept], faces=own, drawn_in=fitted.drawn_in[:, kept])
