"""The surface of the actor at one frame: one welded triangle mesh with its own UV indices and a part name per face.

Wavefront OBJ (`v`, `vt`, `f`, `g`/`o`; polygons become fans) keeps UV and groups; PLY, read with trimesh, holds vertices and faces only.
Normals and materials are not kept. UV seams live in `uv_faces`: vertices are never doubled for them, and a file that doubles them is
refused.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.faults import BadInput, Fault, refuse
from tasks.geometry.meshes import mesh_faults
from tasks.geometry.parts import SKIN

MAX_BYTES = 1 << 30


@dataclass(frozen=True)
class Template:
    """vertices [V, 3] m; faces [F, 3]; uv_vertices [U, 2] and uv_faces [F, 3] into them (both empty without UV); part [F] str."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    uv_vertices: NDArray[np.float64]
    uv_faces: NDArray[np.int32]
    part: NDArray[np.str_]


def read_template(path: Path) -> Template:
    """A template fit to be tracked: readable, manifold, oriented, welded, in metres. Raises BadInput with every fault."""
    template = read_mesh(path)
    faults = mesh_faults(template.vertices, template.faces, str(path))
    doubled = len(template.vertices) - len(np.unique(template.vertices, axis=0))
    if doubled:
        faults.append(
            Fault(str(path), f"{doubled} vertices lie exactly on others", "Merge them; UV seams belong into the `vt` indices of the faces.")
        )
    refuse(faults)
    return template


def read_mesh(path: Path) -> Template:
    """OBJ or PLY, without the demands that tracking makes on it. Raises BadInput."""
    path = Path(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"is larger than {MAX_BYTES >> 20} MiB")
        template = {".obj": _read_obj, ".ply": _read_ply}[path.suffix.lower()](path)
    except KeyError:
        raise BadInput([Fault(str(path), f"has the ending {path.suffix!r}", "Give the mesh as .obj or .ply.")]) from None
    except (OSError, ValueError) as error:
        raise BadInput([Fault(str(path), str(error), "Export the mesh again as a triangle mesh.")]) from None
    refuse(_index_faults(template, str(path)))
    return template


def write_obj(path: Path, template: Template) -> None:
    """Writes vertices, UV, faces and groups; `read_mesh` gives the same arrays back to the last bit."""
    t = template
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in t.vertices.tolist()] + [f"vt {u!r} {v!r}" for u, v in t.uv_vertices.tolist()]
    previous = None
    for f, corners in enumerate((t.faces + 1).tolist()):
        if t.part[f] != previous:
            previous = t.part[f]
            lines.append(f"g {previous}")
        uv = (t.uv_faces[f] + 1).tolist() if len(t.uv_faces) else None
        lines.append("f " + " ".join(f"{a}/{b}" for a, b in zip(corners, uv, strict=True)) if uv else "f {} {} {}".format(*corners))
    Path(path).write_text("\n".join(lines) + "\n")


def _read_obj(path: Path) -> Template:
    vertices, uv_vertices, faces, uv_faces, part = [], [], [], [], []
    group = SKIN
    with path.open(encoding="utf-8-sig", errors="replace") as file:  # Windows programs write a mark before the first line
        for number, line in enumerate(file, 1):
            words = line.split()
            try:
                match words[:1]:
                    case ["v"]:
                        vertices.append((float(words[1]), float(words[2]), float(words[3])))
                    case ["vt"]:
                        uv_vertices.append((float(words[1]), float(words[2])))
                    case ["f"]:
                        corners = [_corner(word, len(vertices), len(uv_vertices)) for word in words[1:]]
                        if len(corners) < 3:
                            raise ValueError(f"a face of {len(corners)} corners")
                        for fan in pairwise(corners[1:]):
                            triangle = (corners[0], *fan)
                            faces.append([c[0] for c in triangle])
                            uv_faces.append([c[1] for c in triangle])
                            part.append(group)
                    case ["g"] | ["o"]:
                        group = words[1] if len(words) > 1 else SKIN
            except (ValueError, IndexError) as error:
                raise ValueError(f"line {number} ({line[:60].strip()!r}) is not understood: {error}") from None
    return _assemble(vertices, faces, uv_vertices, uv_faces, part)


def _corner(word: str, vertex_count: int, uv_count: int) -> tuple[int, int]:
    """0-based (vertex, uv) of `v`, `v/vt`, `v//vn` or `v/vt/vn`; negative numbers count back; uv is -1 where absent."""
    numbers = word.split("/")
    vertex = int(numbers[0])
    uv = int(numbers[1]) if len(numbers) > 1 and numbers[1] else 0
    if not vertex or abs(vertex) > 2**31 - 1 or abs(uv) > 2**31 - 1:
        raise ValueError(f"index {word}")
    return (vertex - 1 if vertex > 0 else vertex_count + vertex), (uv - 1 if uv > 0 else uv_count + uv if uv else -1)


def _assemble(vertices: list, faces: list, uv_vertices: list, uv_faces: list, part: list) -> Template:
    has_uv = bool(uv_vertices) and bool(uv_faces) and any(u >= 0 for corner in uv_faces for u in corner)
    return Template(
        np.array(vertices, float).reshape(-1, 3),
        np.array(faces, np.int64).reshape(-1, 3).astype(np.int32),
        np.array(uv_vertices if has_uv else [], float).reshape(-1, 2),
        np.array(uv_faces if has_uv else [], np.int64).reshape(-1, 3).astype(np.int32),
        np.array(part, np.str_).reshape(-1),
    )


def _read_ply(path: Path) -> Template:
    _check_ply_counts(path)
    import trimesh

    try:
        with path.open("rb") as file:
            mesh = trimesh.load(file, file_type="ply", process=False)
        faces = np.asarray(mesh.faces).reshape(-1, 3)
        vertices = np.asarray(mesh.vertices, float).reshape(-1, 3)
    except Exception as error:  # noqa: BLE001  trimesh raises whatever a hostile file makes it
        raise ValueError(f"cannot be read as PLY ({type(error).__name__}: {error})") from None
    return _assemble(vertices.tolist(), faces.tolist(), [], [], [SKIN] * len(faces))


def _check_ply_counts(path: Path) -> None:
    """A header that promises more elements than the file has bytes would be allocated before it is read."""
    with path.open("rb") as file:
        header = file.read(1 << 16).split(b"end_header")[0].decode("ascii", errors="replace")
    if not header.startswith("ply"):
        raise ValueError("does not begin with 'ply'")
    for line in header.splitlines():
        words = line.split()
        if words[:1] == ["element"] and (
            len(words) != 3 or not words[2].isascii() or not words[2].isdigit() or int(words[2]) > path.stat().st_size
        ):
            raise ValueError(f"header line {line[:60]!r} does not fit the size of the file")


def _index_faults(template: Template, where: str) -> list[Fault]:
    faults = []
    if not len(template.faces) or not np.isfinite(template.vertices).all():
        faults.append(Fault(where, "has no faces, or vertices that are not finite", "Export the mesh again as a triangle mesh."))
    for name, index, count in (("vertex", template.faces, len(template.vertices)), ("uv", template.uv_faces, len(template.uv_vertices))):
        wild = np.flatnonzero(((index < 0) | (index >= count)).any(axis=1)) if len(index) else []
        if len(wild):
            f = wild[0]
            faults.append(Fault(where, f"face {f} names {name} indices {index[f].tolist()} but there are {count}", "Repair the face list."))
    if np.isfinite(template.vertices).all() and np.abs(template.vertices).max(initial=0) > 1e6:
        faults.append(Fault(where, "has coordinates above 1e6", "Lengths must be in metres; rescale the file."))
    if not np.isfinite(template.uv_vertices).all():
        faults.append(Fault(where, "has UV coordinates that are not finite", "Unwrap the mesh again."))
    return faults
