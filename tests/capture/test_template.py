"""Meshes of the first frame: indices of both kinds, groups, and files that lie."""

from contextlib import suppress

import numpy as np
import pytest

from tasks.capture.template import Template, read_mesh, read_template, write_obj
from tasks.geometry.faults import BadInput

SEAM = """# two triangles that share an edge in space and not in the plane
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0.5 0.5
vt 0.9 0.9
vt 0.5 0.9
vn 0 0 1
g skirt
f 1/1/1 2/2/1 3/3/1
g top left
f -4/-3/1 -2/-2/1 -1/-1/1
"""


def write(tmp_path, text, name="m.obj"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_uv_seams_do_not_double_vertices(tmp_path):
    t = read_template(write(tmp_path, SEAM))
    np.testing.assert_array_equal(t.faces, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(t.uv_faces, [[0, 1, 2], [3, 4, 5]])
    assert t.uv_vertices.shape == (6, 2)
    assert t.part.tolist() == ["skirt", "top"]


@pytest.mark.parametrize("seed", range(3))
def test_written_meshes_read_back_to_the_last_bit(tmp_path, seed):
    rng = np.random.default_rng(seed)
    V, F = 30, 50
    faces = np.array([rng.choice(V, 3, replace=False) for _ in range(F)], np.int32)
    part = np.sort(rng.choice(["body", "skirt", "top"], F))
    t = Template(rng.normal(size=(V, 3)), faces, rng.random((40, 2)), rng.integers(0, 40, (F, 3)).astype(np.int32), part)
    write_obj(tmp_path / "m.obj", t)
    back = read_mesh(tmp_path / "m.obj")
    for name in t.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(back, name), getattr(t, name))


def test_polygons_become_fans(tmp_path):
    quad = SEAM.split("g skirt")[0] + "f 1/1 2/2 3/3 4/4\n"
    t = read_mesh(write(tmp_path, quad))
    np.testing.assert_array_equal(t.faces, [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(t.uv_faces, t.faces)
    assert t.part.tolist() == ["body", "body"]


def test_a_byte_order_mark_belongs_to_no_line(tmp_path):
    text = SEAM.split("\n", 1)[1]  # the first vertex on the first line
    marked = tmp_path / "marked.obj"
    marked.write_text(text, encoding="utf-8-sig")
    t, plain = read_template(marked), read_template(write(tmp_path, text))
    for name in t.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(t, name), getattr(plain, name))


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_against_obj(tmp_path, encoding):
    import trimesh

    t = read_mesh(write(tmp_path, SEAM))
    trimesh.Trimesh(t.vertices, t.faces, process=False).export(tmp_path / "m.ply", encoding=encoding)
    p = read_mesh(tmp_path / "m.ply")
    np.testing.assert_array_equal(p.faces, t.faces)
    np.testing.assert_allclose(p.vertices, t.vertices)
    assert p.uv_faces.shape == (0, 3)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("f 1/1/1 2/2/1 3/3/1", "f 1 2 9", "names vertex indices [0, 1, 8] but there are 4"),
        ("f 1/1/1 2/2/1 3/3/1", "f 1/9 2/2 3/3", "names uv indices [8, 1, 2]"),
        ("f 1/1/1 2/2/1 3/3/1", "f 0 1 2", "line 14"),
        ("f 1/1/1 2/2/1 3/3/1", "f 1 2", "a face of 2 corners"),
        ("f 1/1/1 2/2/1 3/3/1", "f 1 2 99999999999999999999", "index"),
        ("f 1/1/1 2/2/1 3/3/1", "f one two three", "line 14"),
        ("v 1 0 0", "v 1 0", "line 3"),
        ("v 1 0 0", "v nan 0 0", "not finite"),
        ("v 1 0 0", "v 1e300 0 0", "above 1e6"),
        ("v 1 0 0", "v 1000 0 0", "metres"),
        ("v 1 0 0", "v 0 0 0", "lie exactly on others"),
        ("vt 1 1", "vt nan 1", "UV coordinates"),
        ("-4/-3/1 -2/-2/1", "-2/-2/1 -4/-3/1", "run the same way"),
    ],
)
def test_faults(tmp_path, old, new, says):
    with pytest.raises(BadInput) as caught:
        read_template(write(tmp_path, SEAM.replace(old, new, 1)))
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("m.obj", ""),
        ("m.stl", "solid"),
        ("m.ply", "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n"),
        ("m.ply", "ply\nformat ascii 1.0\nelement vertex x\nend_header\n"),
        ("m.ply", "not a ply"),
        ("m.ply", "ply\n"),
    ],
)
def test_files_that_are_no_mesh(tmp_path, name, text):
    with pytest.raises(BadInput):
        read_mesh(write(tmp_path, text, name))
    with pytest.raises(BadInput):
        read_mesh(tmp_path / "absent.obj")


@pytest.mark.parametrize("seed", range(40))
def test_damaged_files_give_bad_input_or_a_mesh(tmp_path, seed, damage):
    import trimesh

    path, t = tmp_path / ("m.obj", "a.ply", "b.ply")[seed % 3], read_mesh(write(tmp_path, SEAM, "whole.obj"))
    if path.suffix == ".obj":
        path.write_text(SEAM)
    else:
        trimesh.Trimesh(t.vertices, t.faces, process=False).export(path, encoding=("ascii", "binary")[seed % 3 - 1])
    damage(path, np.random.default_rng(seed))
    with suppress(BadInput):
        read_template(path)
