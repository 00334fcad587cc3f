"""Small scenes that the tests of the simulator share."""

import ipctk
import numpy as np

from tasks.geometry.meshes import edges
from tasks.simulator import NO_COLLIDER, Cloth, Collider, Fabric, Frame, Settings, simulate
from tasks.simulator.settings import BASE


def sheet(rows: int, columns: int, *, length: float = 1.0, width: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal sheet at y = 0: vertices [rows·columns, 3] (x along the rows), faces with alternating diagonals."""
    X, Z = np.meshgrid(np.linspace(0, length, rows), np.linspace(0, width, columns), indexing="ij")
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (corner.ravel() for corner in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    odd = (np.add.outer(np.arange(rows - 1), np.arange(columns - 1)) % 2).ravel().astype(bool)
    one = np.where(
        odd[:, None, None], np.stack([[a, d, c], [a, c, b]]).transpose(2, 0, 1), np.stack([[a, d, b], [b, d, c]]).transpose(2, 0, 1)
    )
    return np.stack([X.ravel(), np.zeros(rows * columns), Z.ravel()], 1), one.reshape(-1, 3).astype(np.int32)


def sphere(subdivisions: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Icosphere: vertices, faces."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions, radius=radius)
    return np.array(mesh.vertices), np.array(mesh.faces, np.int32)


def plane(size: float, *, slope: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A square of two triangles about the origin, tilted about z by `slope` [rad], so that +x goes down for a negative slope."""
    corners = size / 2 * np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1.0]])
    c, s = np.cos(slope), np.sin(slope)
    return corners @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T, np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def free(frames: int) -> dict:
    """Motions of nothing: no collider, no boundary."""
    return {"collider": NO_COLLIDER, "collider_motion": np.zeros((frames, 0, 3)), "boundary_motion": np.zeros((frames, 0, 3))}


def still(frames: int, cloth: Cloth, collider: tuple[np.ndarray, np.ndarray] | None = None, x: np.ndarray | None = None) -> dict:
    """Motions of a boundary that stays where x (default: rest) has it, and of a collider (vertices, faces) that stays."""
    x = cloth.x_rest if x is None else x
    vertices, faces = (np.zeros((0, 3)), np.zeros((0, 3), np.int32)) if collider is None else collider
    return {
        "collider": Collider(faces),
        "collider_motion": np.tile(vertices, (frames, 1, 1)),
        "boundary_motion": np.tile(x[cloth.boundary], (frames, 1, 1)),
    }


def run(cloth: Cloth, fabric: Fabric, motions: dict, *, fps: float = 25.0, settings: Settings = BASE, **others):
    """All frames, each of them converged."""
    frames = list(simulate(cloth, fabric, fps=fps, settings=settings, **motions, **others))
    assert frames[-1].converged, frames[-1].ending
    return frames


def crosses(frame: Frame, cloth: Cloth, collider_faces: np.ndarray) -> bool:
    """Exact test of ipctk on cloth and collider; pairs of collider and collider left out."""
    V = len(frame.x)
    X = np.asfortranarray(np.concatenate([frame.x, frame.collider]))
    F = np.asfortranarray(np.concatenate([cloth.faces, collider_faces + V]).astype(np.int32))
    mesh = ipctk.CollisionMesh(X, np.asfortranarray(edges(F)), F)
    mesh.can_collide = ipctk.make_vertex_patches_filter(
        np.concatenate([np.arange(1, V + 1), np.zeros(len(frame.collider))]).astype(np.int32)
    )
    return ipctk.has_intersections(mesh, X)
