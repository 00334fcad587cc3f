"""The avatar as one .glb file: a skinned body, textured, and garments that move as they were simulated.

* The body is bound to the skeleton by its strongest joints (JOINTS_0/WEIGHTS_0 and, beyond four, JOINTS_1/WEIGHTS_1) and moves by
  the skeleton's animation: linear blend skinning of the rest pose, which the viewer computes. Where garments are all there is, the
  skeleton moves alone.
* Each garment is a mesh of its own whose frames are morph targets, one per frame after the first; the animation blends from one
  to the next, so at every frame time the garment stands exactly where the simulation left it.
* One texture for all, sRGB, row 0 at v = 1. Rough, not metallic, seen from both sides: cloth is open.

Units: metres, seconds, y up, as glTF has them. Source: Khronos glTF 2.0 specification, sections 3.7 (meshes, skins) and 3.11 (animations).
Limits: viewers that read only JOINTS_0 need `influences=4`; some blend only a few morph targets at once, which two neighbours are.
A garment takes frames × vertices × 24 bytes.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tasks.export.glb import INDICES, VERTICES, Glb
from tasks.export.influences import Influences, strongest
from tasks.export.skeleton import LocalMotion, Skeleton, inverse_bind_matrices, local_motion, rest_translations
from tasks.export.surface import Surface
from tasks.geometry.faults import Fault, refuse
from tasks.geometry.meshes import vertex_normals
from tasks.geometry.seams import Corners, cut_seams

BODY = -1  # owner of the faces that no garment has
UNIT_SCALE_TO = 1e-6


@dataclass(frozen=True)
class Garment:
    """Simulated motion of some of the surface's vertices: index [G] of each in the surface, x [T, G, 3] m."""

    name: str
    index: NDArray
    x: NDArray


@dataclass(frozen=True)
class Exported:
    """The file, and the largest skin weight that was cut off at any vertex (0: nothing was lost)."""

    path: Path
    dropped_weight: float


def write_gltf(
    path: Path,
    surface: Surface,
    *,
    skeleton: Skeleton,
    weights: NDArray,
    transforms: NDArray,
    fps: float,
    texture: NDArray | None = None,
    garments: Sequence[Garment] = (),
    influences: int = 8,
) -> Exported:
    """Writes surface, weights [V, J], transforms [T, J, 4, 4], texture [row, column, 3] uint8 sRGB and garments. Raises BadInput."""
    refuse(_faults(surface, weights, transforms, garments, influences))
    glb, frames = Glb(), len(transforms)
    times = glb.accessor(np.arange(frames) / fps, "f4", limits=True)
    material = _add_material(glb, texture)
    joints = _add_joints(glb, skeleton)
    owner = _garment_of_face(surface, garments)
    kept = strongest(weights, influences)

    bare = owner == BODY
    body = [_add_body(glb, surface, bare, kept, _add_skin(glb, skeleton, joints), material)] if bare.any() else []
    worn = [_add_garment(glb, surface, owner == number, garment, material) for number, garment in enumerate(garments)]
    animation = Animation(glb, times)
    _animate_joints(animation, joints, local_motion(skeleton, transforms))
    for node in worn:
        animation.channel(node, "weights", glb.accessor(np.eye(frames)[:, 1:].ravel(), "f4"))
    glb.add("animations", {"name": "motion", "channels": animation.channels, "samplers": animation.samplers})
    glb.json |= {"scene": 0, "scenes": [{"nodes": [joints[0], *body, *worn]}]}
    glb.write(path)
    return Exported(path, float(kept.dropped.max(initial=0)))


@dataclass
class Animation:
    """Channels that share one clock; `times` is the accessor of its seconds."""

    glb: Glb
    times: int
    channels: list[dict[str, Any]] = field(default_factory=list)
    samplers: list[dict[str, Any]] = field(default_factory=list)

    def channel(self, node: int, path: str, values: int) -> None:
        """Moves one property of a node through the values of an accessor, linearly in between."""
        self.samplers.append({"input": self.times, "output": values, "interpolation": "LINEAR"})
        self.channels.append({"sampler": len(self.samplers) - 1, "target": {"node": node, "path": path}})


def _add_material(glb: Glb, texture: NDArray | None) -> int:
    surface: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    if texture is not None:
        png = io.BytesIO()
        Image.fromarray(texture).save(png, "PNG")
        image = glb.add("images", {"bufferView": glb.view(png.getvalue()), "mimeType": "image/png"})
        surface["baseColorTexture"] = {"index": glb.add("textures", {"source": image})}
    return glb.add("materials", {"name": "surface", "doubleSided": True, "pbrMetallicRoughness": surface})


def _add_joints(glb: Glb, skeleton: Skeleton) -> list[int]:
    nodes = []
    for joint, (name, translation) in enumerate(zip(skeleton.names, rest_translations(skeleton).tolist(), strict=True)):
        children = (np.flatnonzero(skeleton.parents == joint)).tolist()
        nodes.append(glb.add("nodes", {"name": name, "translation": translation} | ({"children": children} if children else {})))
    return nodes  # the first nodes of the document, so a joint's number is its node's


def _add_skin(glb: Glb, skeleton: Skeleton, joints: list[int]) -> int:
    matrices = glb.accessor(inverse_bind_matrices(skeleton), "f4")
    return glb.add("skins", {"joints": joints, "inverseBindMatrices": matrices, "skeleton": joints[0]})


def _animate_joints(animation: Animation, joints: list[int], motion: LocalMotion) -> None:
    for joint in joints:
        animation.channel(joint, "rotation", animation.glb.accessor(motion.rotation[:, joint], "f4"))
        animation.channel(joint, "translation", animation.glb.accessor(motion.translation[:, joint], "f4"))
        if np.abs(motion.scale[:, joint] - 1).max() > UNIT_SCALE_TO:
            animation.channel(joint, "scale", animation.glb.accessor(np.repeat(motion.scale[:, joint, None], 3, axis=1), "f4"))


def _add_body(glb: Glb, surface: Surface, faces: NDArray, kept: Influences, skin: int, material: int) -> int:
    corners = cut_seams(surface.faces[faces], surface.uv_faces[faces])
    primitive = _primitive(glb, surface, corners, surface.vertices, material)
    for group in range(kept.joints.shape[1] // 4):
        four = slice(4 * group, 4 * group + 4)
        primitive["attributes"] |= {
            f"JOINTS_{group}": glb.accessor(kept.joints[corners.vertex, four], "u2", bound_as=VERTICES),
            f"WEIGHTS_{group}": glb.accessor(kept.weights[corners.vertex, four], "f4", bound_as=VERTICES),
        }
    return glb.add("nodes", {"name": "body", "skin": skin, "mesh": glb.add("meshes", {"name": "body", "primitives": [primitive]})})


def _add_garment(glb: Glb, surface: Surface, faces: NDArray, garment: Garment, material: int) -> int:
    corners = cut_seams(surface.faces[faces], surface.uv_faces[faces])
    frames = [_placed(surface, garment, x) for x in garment.x]
    normals = [vertex_normals(x, surface.faces[faces])[corners.vertex] for x in frames]
    primitive = _primitive(glb, surface, corners, frames[0], material)
    primitive["targets"] = [
        {
            "POSITION": glb.accessor((x - frames[0])[corners.vertex], "f4", bound_as=VERTICES, limits=True),
            "NORMAL": glb.accessor(normal - normals[0], "f4", bound_as=VERTICES),
        }
        for x, normal in zip(frames[1:], normals[1:], strict=True)
    ]
    mesh = {"name": garment.name, "primitives": [primitive], "weights": [0.0] * (len(frames) - 1)}
    return glb.add("nodes", {"name": garment.name, "mesh": glb.add("meshes", mesh)})


def _primitive(glb: Glb, surface: Surface, corners: Corners, vertices: NDArray, material: int) -> dict[str, Any]:
    normals = vertex_normals(vertices, corners.vertex[corners.faces])  # of the welded mesh: a texture seam is no crease
    uv = surface.uv_vertices[corners.uv] * [1, -1] + [0, 1]  # glTF counts v from the top
    attributes = {
        "POSITION": glb.accessor(vertices[corners.vertex], "f4", bound_as=VERTICES, limits=True),
        "NORMAL": glb.accessor(normals[corners.vertex], "f4", bound_as=VERTICES),
        "TEXCOORD_0": glb.accessor(uv, "f4", bound_as=VERTICES),
    }
    indices = glb.accessor(corners.faces.ravel(), "u4", bound_as=INDICES)
    return {"attributes": attributes, "indices": indices, "material": material}


def _placed(surface: Surface, garment: Garment, x: NDArray) -> NDArray:
    vertices = surface.vertices.astype(float)
    vertices[garment.index] = x
    return vertices


def _garment_of_face(surface: Surface, garments: Sequence[Garment]) -> NDArray:
    owner = np.full(len(surface.faces), BODY)
    for number, garment in enumerate(garments):
        owner[np.isin(surface.faces, garment.index).all(axis=1)] = number
    return owner


def _faults(surface: Surface, weights: NDArray, transforms: NDArray, garments: Sequence[Garment], influences: int) -> list[Fault]:
    found = []
    if influences not in (4, 8):
        found.append(Fault("influences", f"is {influences}", "give 4 or 8: glTF carries joints by fours"))
    if len(weights) != len(surface.vertices):
        found.append(
            Fault("weights", f"are for {len(weights)} vertices, the surface has {len(surface.vertices)}", "take both from one skinning")
        )
    for garment in garments:
        if garment.x.shape[:2] != (len(transforms), len(garment.index)):
            what = f"has shape {garment.x.shape} for {len(transforms)} frames and {len(garment.index)} vertices"
            found.append(Fault(f"garment {garment.name}", what, "export the frames that body and garment share"))
        elif not np.isfinite(garment.x).all():
            found.append(Fault(f"garment {garment.name}", "holds NaN or infinity", "export simulated motion, not observations"))
    return found
