"""Tracked garments: every key of the format, its unit and axes, and files that lie."""

import io
import json
import pickle
import zipfile
from contextlib import suppress

import numpy as np
import pytest

from tasks.capture.template import read_mesh, write_obj
from tasks.capture.tracked_geometry import read_tracked_geometry, tracked_geometry, write_tracked_geometry
from tasks.geometry.faults import BadInput

T = 4


def square(n: int = 3) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[0 : 1 : n * 1j, 0 : 1 : n * 1j]
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = (k.ravel() for k in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    return np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], 1), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


@pytest.fixture
def full() -> dict:
    x, faces = square()
    V, rng = len(x), np.random.default_rng(0)
    moving = x + 0.01 * np.arange(T)[:, None, None] * [0, 1, 2]
    return {
        "vertices": moving,
        "faces": faces,
        "fps": 25,
        "collider_vertices": moving - [0, 0, 0.1],
        "collider_faces": faces,
        "boundary": np.array([0, 1]),
        "rest_vertices": x,
        "up": "y",
        "mass_kg": 0.2,
        "observed": rng.random((T, V)) < 0.8,
        "noise_m": 0.002,
        "noise_cov": np.broadcast_to(np.diag([1e-6, 2e-6, 3e-6]), (T, V, 3, 3)),
        "uv": x[:, :2],
        "zone": np.array(["hem"] * V),
        "rest_flat": True,
        "base": json.dumps({"friction": 0.2}),
        "clamp_force": np.ones(T),
        "markers": moving[:, :1] * [1, 1, 1],
        "marker_faces": np.array([0]),
        "marker_barycentric": np.array([[1.0, 0, 0]]),
    }


def read(tmp_path, arrays, **kwargs):
    np.savez_compressed(tmp_path / "t.npz", **arrays)
    return read_tracked_geometry(tmp_path / "t.npz", **kwargs)


def faults_of(tmp_path, arrays) -> str:
    with pytest.raises(BadInput) as caught:
        read(tmp_path, arrays)
    return str(caught.value)


def test_every_key_arrives(tmp_path, full):
    t = read(tmp_path, full)
    for key in ("vertices", "faces", "collider_vertices", "boundary", "rest_vertices", "noise_cov", "uv", "zone", "clamp_force", "markers"):
        np.testing.assert_array_equal(getattr(t, key), full[key])
    assert (t.fps, t.up, t.mass_kg, t.rest_flat, t.base, t.warnings) == (25, "y", 0.2, True, {"friction": 0.2}, ())
    assert t.noise_m.shape == (T, 9)
    np.testing.assert_array_equal(t.observed, full["observed"])


def test_a_written_track_reads_back_alike(tmp_path, full):
    t = read(tmp_path, full)
    write_tracked_geometry(tmp_path / "again.npz", t)
    again = read_tracked_geometry(tmp_path / "again.npz")
    for key in t.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, key), getattr(t, key))


def test_the_least_file(tmp_path, full):
    t = read(tmp_path, {k: full[k] for k in ("vertices", "faces", "fps")})
    assert t.observed.all()
    assert t.boundary.shape == (0,)
    assert t.collider_vertices is t.noise_m is t.mass_kg is None


def test_z_up_is_turned_whole(tmp_path, full):
    flat, turned = read(tmp_path, full), read(tmp_path, full | {"up": "z"})
    a, b = flat.vertices, turned.vertices
    np.testing.assert_allclose(b, np.stack([a[..., 0], a[..., 2], -a[..., 1]], -1))
    np.testing.assert_allclose(turned.noise_cov[0, 0], np.diag([1e-6, 3e-6, 2e-6]))
    np.testing.assert_allclose(turned.markers[:, 0], turned.vertices[:, 0])
    assert turned.up == "y"
    np.testing.assert_array_equal(read(tmp_path, full, up="z").vertices, b)


def test_unseen_is_nan_or_false(tmp_path, full):
    del full["observed"]
    full["vertices"][2, 5, 1] = np.nan
    t = read(tmp_path, full)
    assert not t.observed[2, 5]
    assert t.observed.sum() == T * 9 - 1
    assert np.isnan(t.vertices[2, 5]).all()
    full["observed"] = np.ones((T, 9), bool)
    assert "vertex 5 of frame 2 counts as seen but is NaN" in faults_of(tmp_path, full)


def test_a_blind_file_is_legal_but_its_boundary_must_be_known(tmp_path, full):
    del full["observed"], full["noise_cov"]
    full["vertices"][2:, 2:] = np.nan
    assert read(tmp_path, full).observed.sum() == 2 * 9 + 2 * 2
    full["vertices"][3, 1] = np.nan
    assert "vertex 1 is not known in frame 3" in faults_of(tmp_path, full)


def test_markers_alone(tmp_path, full):
    keep = {k: full[k] for k in ("faces", "fps", "rest_vertices", "markers", "marker_faces", "marker_barycentric")}
    t = read(tmp_path, keep)
    assert t.vertices.shape == (T, 9, 3)
    assert not t.observed.any()
    del keep["rest_vertices"]
    assert "has no 'vertices'" in faults_of(tmp_path, keep)


def test_covariances_are_needed_where_vertices_are_seen_and_without_vertices_everywhere(tmp_path, full):
    del full["observed"]
    full["vertices"][2, 5], full["noise_cov"] = np.nan, full["noise_cov"].copy()
    full["noise_cov"][2, 5] = np.nan
    assert np.isnan(read(tmp_path, full).noise_cov[2, 5]).all()
    keep = {k: full[k] for k in ("faces", "fps", "rest_vertices", "markers", "marker_faces", "marker_barycentric", "noise_cov")}
    assert "noise_cov: is no covariance" in faults_of(tmp_path, keep)


def test_a_garments_vertex_of_no_face_is_refused_and_a_colliders_is_not(tmp_path, full):
    stray = np.concatenate([full["collider_vertices"], np.ones((T, 1, 3))], axis=1)
    assert read(tmp_path, full | {"collider_vertices": stray}).collider_vertices.shape == (T, 10, 3)
    least = {"vertices": np.concatenate([full["vertices"], np.ones((T, 2, 3))], axis=1), "faces": full["faces"], "fps": 25}
    assert "2 vertices belong to no face, the first is 9. Remove them." in faults_of(tmp_path, least)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("vertices", np.zeros((4, 9, 2)), "Expected [T=4, V=9, 3]"),
        ("vertices", np.full((4, 9, 3), np.inf), "infinite values"),
        ("vertices", np.full((4, 9, 3), np.nan), "vertex 0 is not known in frame 0"),
        ("faces", np.zeros((3, 3)), "Expected integers"),
        ("faces", np.array([[0, 1, 9]]), "names 9 but there are 9"),
        ("faces", np.array([[0, 1, -1]]), "names -1"),
        ("fps", 0, "Give it in frames per second"),
        ("fps", np.nan, "Give it in frames per second"),
        ("fps", np.ones(2), "Expected []"),
        ("mass_kg", 300, "kilograms"),
        ("up", "x", "vertical axis"),
        ("boundary", np.array([0, 9]), "names 9"),
        ("boundary", np.array([0, 0]), "names a vertex twice"),
        ("observed", np.ones((4, 8), bool), "Expected [T=4, V=9]"),
        ("noise_m", np.ones(3), "Expected a scalar, [V] or [T, V]"),
        ("noise_m", -0.1, "standard deviation"),
        ("noise_m", 5.0, "standard deviation"),
        ("noise_cov", -np.ones((4, 9, 3, 3)), "covariance"),
        ("noise_cov", np.where(np.arange(9)[:, None, None] == 4, np.nan, np.full((4, 9, 3, 3), 1e-6) * np.eye(3)), "covariance"),
        ("uv", np.full((9, 2), np.nan), "known everywhere"),
        ("zone", np.zeros(9), "Expected text"),
        ("base", "[1]", "JSON object"),
        ("base", '{"a": NaN}', "JSON object"),
        ("base", "[" * 100_000, "JSON object"),
        ("clamp_force", np.ones(5), "Expected [T=4]"),
        ("marker_barycentric", np.ones((1, 3)), "sum to 1"),
        ("marker_faces", np.array([8]), "names 8 but there are 8"),
        ("collider_vertices", np.full((4, 9, 3), np.nan), "known everywhere"),
        ("collider_vertices", np.zeros((3, 9, 3)), "Expected [T=4"),
        ("rest_vertices", np.zeros((8, 3)), "Expected [V=9, 3]"),
        ("bondary", np.array([0]), "Did you mean 'boundary'"),
    ],
)
def test_faults(tmp_path, full, key, value, says):
    assert says in faults_of(tmp_path, full | {key: value})


def test_all_faults_at_once_and_unknown_keys_warned_about(tmp_path, full):
    text = faults_of(tmp_path, full | {"fps": -1, "mass_kg": 0, "boundary": np.array([99]), "noise_m": -1.0})
    assert text.count("\n") == 3
    assert "'studio'" in read(tmp_path, full | {"studio": np.ones(1)}).warnings[0]


def strip(rng: np.random.Generator, n: int = 12) -> dict:
    """Cloth of 0.6 m in edges of about 5 cm that sways for T frames, its rest shape, and a body."""
    x, faces = square(n)
    x = 0.6 * x + rng.normal(scale=2e-3, size=x.shape)
    moving = x + 0.02 * np.arange(T)[:, None, None] * [0, 1, 2]
    body = {"collider_vertices": moving - [0, 0, 0.1], "collider_faces": faces}
    return {"vertices": moving, "faces": faces, "fps": 25, "rest_vertices": x} | body


def tube(count: int) -> np.ndarray:
    """A skirt of rings of 24 vertices, 5 cm from one another."""
    ring, turn = np.arange(count) // 24, 2 * np.pi * np.arange(count) / 24
    return np.stack([0.19 * np.cos(turn), 0.05 * ring, 0.19 * np.sin(turn)], 1)


NOT_ITS_REST = {
    "cloth in cm": ("vertices", lambda x, rng: 100 * x, "vertices: its bounding box has a diagonal of"),
    "rest in cm": ("rest_vertices", lambda x, rng: 100 * x, "rest_vertices: its bounding box has a diagonal of"),
    "rest ten times": ("rest_vertices", lambda x, rng: 10 * x, "rest_vertices: its edges are 10 times as long as those of frame 0"),
    "rest a tenth": ("rest_vertices", lambda x, rng: x / 10, "rest_vertices: its edges are 0.1 times as long"),
    "rest in feet": (
        "rest_vertices",
        lambda x, rng: x / 0.3048,
        "rest_vertices: its edges are 3.28 times as long as those of frame 0, half of them 3.2",
    ),
    "another order": ("rest_vertices", lambda x, rng: rng.permutation(x), "half of them 3"),
    "a half in another order": ("rest_vertices", lambda x, rng: np.concatenate([x[:72], rng.permutation(x[72:])]), "half of them 1 to 4"),
    "another garment": ("rest_vertices", lambda x, rng: tube(len(x)), "half of them"),
    "a frame with a face of no area": (
        "vertices",
        lambda x, rng: np.where(np.arange(144)[:, None] == 1, x[:, :1], x),
        "vertices: 1 faces have no area",
    ),
}


@pytest.mark.parametrize("what", NOT_ITS_REST)
def test_a_rest_shape_that_is_not_the_garments_is_refused(tmp_path, what):
    """Cloth in cm with its rest shape in metres had been fitted."""
    (key, change, says), rng = NOT_ITS_REST[what], np.random.default_rng(0)
    arrays = strip(rng)
    read(tmp_path, arrays)
    assert says in faults_of(tmp_path, arrays | {key: change(arrays[key], rng)})


def test_a_rest_shape_is_compared_with_what_is_known_where_no_frame_is_whole(tmp_path):
    rng = np.random.default_rng(0)
    arrays = strip(rng)
    arrays |= {"observed": rng.random(arrays["vertices"].shape[:2]) < np.array([0.5, 0.9, 0.8, 0.7])[:, None]}
    arrays["vertices"] = np.where(arrays["observed"][..., None], arrays["vertices"], 0)  # as trackers write what they did not see
    read(tmp_path, arrays)
    assert "as long as those of frame 1" in faults_of(tmp_path, arrays | {"rest_vertices": 3 * arrays["rest_vertices"]})


def test_a_garment_of_another_size_or_stretched_is_the_same_garment(tmp_path):
    arrays = strip(np.random.default_rng(0))
    for factor in (0.6, 1.8, [1.9, 0.6, 1]):
        read(tmp_path, arrays | {"rest_vertices": arrays["rest_vertices"] * factor})


def test_what_is_wrong_with_the_faces_is_told_once(tmp_path):
    arrays = strip(np.random.default_rng(0))
    arrays["faces"] = np.where(np.arange(len(arrays["faces"]))[:, None] == 3, arrays["faces"][:, ::-1], arrays["faces"])
    assert faults_of(tmp_path, arrays).count("Orient all faces") == 1


@pytest.mark.parametrize(
    ("key", "value"),
    [("noise_m", 0.5), ("noise_m", np.full(144, 0.5)), ("noise_cov", np.broadcast_to(0.25 * np.eye(3), (T, 144, 3, 3)))],
)
@pytest.mark.parametrize("rest", [True, False])
def test_noise_in_millimetres_is_refused(tmp_path, key, value, rest):
    arrays = strip(np.random.default_rng(0))
    arrays = arrays if rest else {k: v for k, v in arrays.items() if k != "rest_vertices"}
    read(tmp_path, arrays | {"noise_m": np.where(np.arange(144) < 50, 0.5, 0.01)})  # a third is as good as unknown
    assert f"{key}: is 0.5 m in the median, and the edges of the garment are 0.0" in faults_of(tmp_path, arrays | {key: value})


def test_a_body_without_vertices_is_refused(tmp_path):
    arrays = strip(np.random.default_rng(0))
    empty = {"collider_vertices": np.zeros((T, 0, 3)), "collider_faces": np.zeros((0, 3), int)}
    said = faults_of(tmp_path, arrays | empty)
    assert said.count("is empty. Leave the key out.") == 2 and "collider_vertices: is empty" in said


@pytest.mark.parametrize("key", ["vertices", "collider_vertices"])
@pytest.mark.parametrize(
    ("frames", "says"),
    [
        ([2], "0 m across in 1 of 4 frames, the first is frame 2; the median is 0.8"),
        ([0], "0 m across in 1 of 4 frames, the first is frame 0"),
        ([1, 3], "0 m across in 2 of 4 frames, the first is frame 1"),
    ],
)
def test_a_frame_gone_to_a_point_is_refused_by_its_number(tmp_path, key, frames, says):
    arrays = strip(np.random.default_rng(0))
    arrays[key] = np.where(np.isin(np.arange(T), frames)[:, None, None], 0.0, arrays[key])
    assert f"{key}: {says}" in faults_of(tmp_path, arrays)
    seen = np.broadcast_to(~np.isin(np.arange(T), frames)[:, None], (T, 144))
    if key == "vertices":  # zeros that count as not seen are what trackers write
        assert read(tmp_path, arrays | {"observed": seen}).observed.any()
        del arrays["rest_vertices"]
        assert read(tmp_path, arrays | {"observed": seen, "boundary": np.array([])}).observed.any()


def test_few_vertices_close_together_are_no_frame_gone_to_a_point(tmp_path):
    arrays = strip(np.random.default_rng(0)) | {"boundary": np.array([0])}
    arrays["vertices"][1:, 1:] = np.nan
    assert read(tmp_path, arrays).observed.sum() == 144 + T - 1


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_units_that_no_garment_has(tmp_path, full, factor):
    keep = {k: full[k] for k in ("faces", "fps")}
    assert "metres" in faults_of(tmp_path, keep | {"vertices": full["vertices"] * factor})


def test_nothing_seen_at_all(tmp_path, full):
    keep = {k: full[k] for k in ("faces", "fps", "rest_vertices")}
    assert "no vertex is seen" in faults_of(tmp_path, keep | {"vertices": np.full((4, 9, 3), np.nan)})


def test_frames_out_of_order_are_noticed(tmp_path, full):
    keep = {k: full[k] for k in ("faces", "fps", "vertices")}
    keep["vertices"][2] += 5
    assert "point 0 moves at" in faults_of(tmp_path, keep)


# folders


@pytest.mark.parametrize("ending", ["obj", "ply"])
def test_a_folder_of_meshes(tmp_path, full, ending):
    import trimesh

    for t in (0, 1, 2, 3):  # numbers are compared as numbers: frame 9 comes before frame 10
        trimesh.Trimesh(full["vertices"][t], full["faces"], process=False).export(tmp_path / f"frame_{t + 8}.{ending}")
    track = read_tracked_geometry(tmp_path, fps=30)
    np.testing.assert_allclose(track.vertices, full["vertices"], atol=1e-6)
    assert track.fps == 30
    with pytest.raises(BadInput, match="Give fps"):
        read_tracked_geometry(tmp_path)
    (tmp_path / f"frame_9.{ending}").rename(tmp_path / f"frame_19.{ending}")
    with pytest.raises(BadInput, match="without gaps"):
        read_tracked_geometry(tmp_path, fps=30)


def test_a_folder_whose_mesh_changes(tmp_path, full):
    import trimesh

    for t, faces in enumerate((full["faces"], full["faces"][:-1])):
        trimesh.Trimesh(full["vertices"][t], faces, process=False).export(tmp_path / f"{t}.obj")
    with pytest.raises(BadInput, match=r"1\.obj: has other faces"):
        read_tracked_geometry(tmp_path, fps=30)


# files that lie


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was executed",))


def npz_of(tmp_path, members: dict[str, bytes]):
    with zipfile.ZipFile(tmp_path / "evil.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return tmp_path / "evil.npz"


def npy_of(header: str, body: bytes = b"") -> bytes:
    text = header.encode() + b" " * ((-len(header) - 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body


@pytest.mark.parametrize(
    "content",
    [
        npy_of("{'descr': '|O', 'fortran_order': False, 'shape': (1,)}", pickle.dumps([Bomb()])),
        npy_of("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000,)}"),
        npy_of("{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296)}"),
        npy_of("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}", b"\0" * 8),
        npy_of("{'descr': '<f8', 'fortran_order': False, 'shape': (2,)}", b"\0" * 8),
        npy_of("__import__('os').system('false')"),
        npy_of("{" * 3000),
        npy_of("{'descr': 'V99', 'fortran_order': False, 'shape': ()}", b"\0" * 99),
        b"\x93NUMPY\x09\x00",
        pickle.dumps(Bomb()),
        b"",
    ],
)
def test_members_that_lie(tmp_path, content):
    with pytest.raises(BadInput, match="cannot be read"):
        read_tracked_geometry(npz_of(tmp_path, {"vertices.npy": content}))


@pytest.mark.parametrize("shape", ["(1000000000000000,)", "(4294967296, 4294967296)", "(3,)", "(-1,)"])
def test_a_promise_is_compared_before_it_is_kept(tmp_path, shape):
    content = npy_of(f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}", b"\0" * 8)
    with pytest.raises(BadInput, match="promises"):
        read_tracked_geometry(npz_of(tmp_path, {"vertices.npy": content}))


def test_archives_that_lie(tmp_path):
    (tmp_path / "evil.npz").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(BadInput, match="no readable NPZ"):
        read_tracked_geometry(tmp_path / "evil.npz")
    with pytest.raises(BadInput, match="65 members"):
        read_tracked_geometry(npz_of(tmp_path, {f"{k}.npy": b"" for k in range(65)}))
    with pytest.raises(BadInput, match="no readable NPZ"):
        read_tracked_geometry(tmp_path / "absent.npz")


@pytest.mark.parametrize("seed", range(60))
def test_damaged_files_give_bad_input_or_a_track(tmp_path, full, seed, damage):
    path, rng = tmp_path / "t.npz", np.random.default_rng(seed)
    (np.savez if seed % 3 else np.savez_compressed)(path, **full)
    damage(path, rng)
    with suppress(BadInput):
        read_tracked_geometry(path)


@pytest.mark.parametrize("seed", range(40))
def test_strange_values_give_bad_input_or_a_track(full, seed):
    """Damage behind intact checksums: NaN, infinities and huge numbers anywhere."""
    rng = np.random.default_rng(seed)
    for key in rng.choice(sorted(full), 2, replace=False):
        array = np.array(full[key])
        if array.dtype.kind in "fiu":
            value = (
                rng.choice([np.nan, np.inf, -np.inf, 1e308, -1e308, 0]) if array.dtype.kind == "f" else rng.choice([-1, 2**62, -(2**62)])
            )
            flat = array.reshape(-1)
            flat[rng.integers(0, flat.size, 3)] = value
        full[key] = array
    with suppress(BadInput):
        tracked_geometry({k: np.asarray(v) for k, v in full.items()}, name="strange")


def test_float32_and_fortran_order_are_read(tmp_path, full):
    keep = {
        "vertices": np.asfortranarray(full["vertices"].astype(np.float32)),
        "faces": np.asfortranarray(full["faces"]),
        "fps": np.float32(25),
    }
    t = read(tmp_path, keep)
    np.testing.assert_allclose(t.vertices, full["vertices"], atol=1e-6)
    np.testing.assert_array_equal(t.faces, full["faces"])
    assert t.vertices.dtype == np.float64
    buffer = io.BytesIO()
    np.savez(buffer, **keep)
    with zipfile.ZipFile(buffer) as archive:
        assert b"'fortran_order': True" in archive.read("vertices.npy")[:200]  # the control: the order was in fact stored


def test_obj_without_uv_goes_through_the_same_door(tmp_path, full):
    (tmp_path / "0.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    write_obj(tmp_path / "1.obj", read_mesh(tmp_path / "0.obj"))
    assert read_tracked_geometry(tmp_path, fps=5).vertices.shape == (2, 3, 3)
