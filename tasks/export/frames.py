"""One mesh file per frame: PLY (binary, with a value per vertex if wanted) or OBJ (text, with texture coordinates and parts).

    skirt_0000.ply  skirt_0001.ply  …

Units: metres, y up. Source: G. Turk, The PLY Polygon File Format (1994); Wavefront, Advanced Visualizer manual, appendix B1 (OBJ).
Limits: OBJ is written with 6 decimals, a micrometre.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def write_ply_frames(
    folder: Path, name: str, vertices: NDArray, faces: NDArray, *, values: Mapping[str, NDArray] | None = None
) -> list[Path]:
    """Writes vertices [T, V, 3] and faces [F, 3]; `values` maps a property's name to [T, V], such as a residual in mm."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}_{frame:04d}.ply" for frame in range(len(vertices))]
    for frame, path in enumerate(paths):
        _write_ply(path, vertices[frame], faces, {label: value[frame] for label, value in (values or {}).items()})
    return paths


def write_obj_frames(
    folder: Path,
    name: str,
    vertices: NDArray,
    faces: NDArray,
    *,
    uv_vertices: NDArray | None = None,
    uv_faces: NDArray | None = None,
    part: NDArray | None = None,
) -> list[Path]:
    """Writes vertices [T, V, 3] and faces [F, 3]; uv_vertices [U, 2] with uv_faces [F, 3]; part [F] str becomes groups."""
    folder.mkdir(parents=True, exist_ok=True)
    texture = [] if uv_vertices is None else [f"vt {u:.6f} {v:.6f}" for u, v in uv_vertices]
    topology = "\n".join(texture + _obj_faces(faces, uv_faces, part))
    paths = [folder / f"{name}_{frame:04d}.obj" for frame in range(len(vertices))]
    for x, path in zip(vertices, paths, strict=True):
        places = "\n".join(f"v {a:.6f} {b:.6f} {c:.6f}" for a, b, c in x.tolist())
        path.write_text(f"{places}\n{topology}\n")
    return paths


def _write_ply(path: Path, vertices: NDArray, faces: NDArray, values: Mapping[str, NDArray]) -> None:
    labels = ["x", "y", "z", *values]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {label}" for label in labels]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    rows = np.column_stack([vertices, *values.values()]).astype("<f4")
    corners = np.empty(len(faces), [("count", "u1"), ("vertex", "<i4", 3)])
    corners["count"], corners["vertex"] = 3, faces
    path.write_bytes("\n".join(header).encode() + rows.tobytes() + corners.tobytes())


def _obj_faces(faces: NDArray, uv_faces: NDArray | None, part: NDArray | None) -> list[str]:
    corners = [[str(vertex) for vertex in face] for face in (faces + 1).tolist()]  # OBJ counts from 1
    if uv_faces is not None:
        corners = [
            [f"{v}/{t}" for v, t in zip(face, texels, strict=True)] for face, texels in zip(corners, (uv_faces + 1).tolist(), strict=True)
        ]
    lines = ["f " + " ".join(face) for face in corners]
    if part is None:
        return lines
    groups = dict.fromkeys(part.tolist())
    return [line for group in groups for line in (f"g {group}", *(lines[face] for face in np.flatnonzero(part == group)))]
