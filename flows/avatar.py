"""What leaves the store: the avatar and the motion of one sequence, from its newest cloth, as files other programs read."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from flows.lineage import Lineage
from storage_schemas.appearance import Appearance
from storage_schemas.capture import Capture
from storage_schemas.cloth import Cloth
from storage_schemas.record import Record
from storage_schemas.registration import Registration
from storage_schemas.skinning import Skinning
from storage_schemas.store import Store
from storage_schemas.tracking import Tracking
from tasks.appearance.colour import srgb8_from_linear
from tasks.body.skeleton import JOINT_NAMES, PARENTS
from tasks.export.frames import write_obj_frames, write_ply_frames
from tasks.export.gltf import Garment, write_gltf
from tasks.export.point_cache import write_npz
from tasks.export.preview import shaded, write_video
from tasks.export.skeleton import Skeleton
from tasks.export.surface import Surface
from tasks.recorded import cameras_of
from tasks.skinning.linear_blend import repose

R = TypeVar("R", bound=Record)
FORMATS = ("glb", "npz", "ply", "obj", "mp4")


class Avatar:
    """Artifacts of one sequence that belong together, opened as they are asked for. Raises Refused where one is missing."""

    def __init__(self, store: Store, actor: str, sequence: str) -> None:
        self.store, self.lineage = store, Lineage(store, actor, sequence)

    def open(self, schema: type[R]) -> R:
        """The artifact of this schema."""
        return self.store.open(self.lineage.artifact(schema.schema_name), schema)

    def motion(self) -> tuple[np.ndarray, Tracking, Cloth]:
        """The surface with simulated garments and skinned body [T, V, 3] m, over the simulated frames."""
        tracking, cloth = self.open(Tracking), self.open(Cloth)
        skinning, body = self.open(Skinning), self.open(Registration)
        frames = len(cloth.simulated)
        x = repose(skinning.rest_vertices.astype(float), skinning.weights.astype(float), body.transforms[:frames].astype(float))
        x[:, cloth.vertices_index] = cloth.simulated
        return x, tracking, cloth


def export(avatar: Avatar, folder: Path, formats: tuple[str, ...]) -> list[Path]:
    """Write the formats asked for; returns what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    writers: dict[str, Callable[[Avatar, Path], list[Path]]] = {"glb": _glb, "npz": _npz, "ply": _ply, "obj": _obj, "mp4": _mp4}
    return [path for name in formats for path in writers[name](avatar, folder)]


def _surface(tracking: Tracking, rest: np.ndarray) -> Surface:
    return Surface(rest, tracking.faces, tracking.uv_vertices, tracking.uv_faces)


def _texture(avatar: Avatar) -> np.ndarray:
    return srgb8_from_linear(avatar.open(Appearance).albedo)


def _glb(avatar: Avatar, folder: Path) -> list[Path]:
    body, skinning = avatar.open(Registration), avatar.open(Skinning)
    tracking, cloth = avatar.open(Tracking), avatar.open(Cloth)
    T = body.transforms[0].astype(float)
    at_rest = np.linalg.solve(T, np.concatenate([body.joints[0].astype(float), np.ones((55, 1))], 1)[..., None])[:, :3, 0]
    garments = [
        Garment(name, cloth.vertices_index[own], cloth.simulated[:, own].astype(float))
        for k, name in enumerate(cloth.garment_names)
        for own in [cloth.garment_of_vertex == k]
    ]
    written = write_gltf(
        folder / "avatar.glb",
        _surface(tracking, skinning.rest_vertices.astype(float)),
        skeleton=Skeleton(JOINT_NAMES, PARENTS, at_rest),
        weights=skinning.weights.astype(float),
        transforms=body.transforms[: len(cloth.simulated)].astype(float),
        fps=avatar.open(Capture).fps,
        texture=_texture(avatar),
        garments=garments,
    )
    return [written.path]


def _npz(avatar: Avatar, folder: Path) -> list[Path]:
    """The tracked garments in the interchange format that `physavatar gap` reads."""
    tracking, body = avatar.open(Tracking), avatar.open(Registration)
    cloth, capture = avatar.open(Cloth), avatar.open(Capture)
    frames, own = len(cloth.simulated), cloth.vertices_index
    more = {
        "collider_vertices": body.vertices[:frames],
        "collider_faces": body.faces,
        "boundary": np.flatnonzero(cloth.boundary),
        "observed": tracking.seen[:frames, own],
        "noise_m": tracking.noise_m[:frames, own],
    }
    return [write_npz(folder / "tracked.npz", tracking.vertices[:frames, own], cloth.faces, fps=capture.fps, **more)]


def _ply(avatar: Avatar, folder: Path) -> list[Path]:
    x, tracking, _ = avatar.motion()
    return write_ply_frames(folder / "ply", "avatar", x, tracking.faces)


def _obj(avatar: Avatar, folder: Path) -> list[Path]:
    x, tracking, _ = avatar.motion()
    part = np.asarray(tracking.part_names)[tracking.part_of_face]
    return write_obj_frames(
        folder / "obj", "avatar", x, tracking.faces, uv_vertices=tracking.uv_vertices, uv_faces=tracking.uv_faces, part=part
    )


def _mp4(avatar: Avatar, folder: Path) -> list[Path]:
    x, tracking, _ = avatar.motion()
    capture = avatar.open(Capture)
    images = shaded(cameras_of(capture), 0, _surface(tracking, x[0]), x, texture=_texture(avatar))
    return [write_video(folder / "preview.mp4", images, fps=capture.fps)]
