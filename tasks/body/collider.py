"""A lighter surface for contact: the skin decimated by edge collapse (Garland & Heckbert 1997), posed by interpolated skin weights.

Collapses that would make the surface cut itself are blocked, so it serves as an IPC collider wherever the full skin does.
Limits: it keeps the mouth and the eye sockets, which cloth never meets; a body that cuts itself when posed (armpits, crouching) still does.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.body.model import Array, BodyModel
from tasks.geometry.distances import closest_points
from tasks.geometry.meshes import submesh


@dataclass(frozen=True)
class Collider:
    """rest [C,3] m; faces [F,3]; weights [C,55]."""

    rest: Array
    faces: NDArray[np.int32]
    weights: Array

    def posed(self, transforms: Array) -> Array:
        """Vertices [..., C, 3] m, by linear blend skinning with a posed body's transforms [..., 55, 4, 4]."""
        blended = np.einsum("cj,...jab->...cab", self.weights, transforms[..., :3, :], optimize=True)
        return np.einsum("...cab,cb->...ca", blended[..., :3], self.rest) + blended[..., 3]


def decimate(model: BodyModel, faces: int = 6000, *, vertices: Array | None = None) -> Collider:
    """The skin with about `faces` triangles; `vertices` [V,3] m: rest vertices of a shape (default: the template).

    Skin weights are those of the closest point of the full skin. They are not put on it: that would let the lips cut each other.
    """
    import igl

    full = model.template if vertices is None else vertices
    skin, kept = submesh(model.faces, model.skin)
    rest, light, *_ = igl.qslim(np.asfortranarray(full[kept]), np.asfortranarray(skin), faces, True)
    at = closest_points(rest, full[kept], skin)
    weights = np.einsum("ckj,ck->cj", model.weights[kept[skin[at.face]]], at.barycentric)
    return Collider(np.ascontiguousarray(rest), np.ascontiguousarray(light, dtype=np.int32), weights)
