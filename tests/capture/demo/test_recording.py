"""The recording as a whole: pictures made again are the same bytes, the project's reader takes the folder, a seal notices any change."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from tasks.capture.actorshq import read_actorshq
from tasks.capture.demo.charts import box_charts, pack
from tasks.capture.demo.fabrics import AREAL_DENSITY
from tasks.capture.demo.files import altered, digests, seal, write_whole
from tasks.capture.demo.labour import photograph, picture_paths
from tasks.capture.demo.plan import Request
from tasks.capture.demo.recording import _claim, _write_tables, make_demo_recording
from tasks.capture.demo.scan import NOISE, scan
from tasks.capture.demo.truth import template_motion
from tasks.capture.template import read_template, write_obj
from tasks.geometry.faults import BadInput
from tasks.geometry.meshes import components, face_normals


@pytest.fixture(scope="module")
def worn(plan) -> dict[str, np.ndarray]:
    """Garments that stay as sewn: enough for everything but dressing."""
    return {name: np.repeat(f.garment.vertices[None], plan.request.frames, 0) for name, f in plan.fittings.items()}


@pytest.fixture(scope="module")
def scanned(plan, worn):
    return scan(
        plan.actor,
        {n: f.garment for n, f in plan.fittings.items()},
        plan.scanned,
        {n: x[0] for n, x in worn.items()},
        np.random.default_rng(0),
    )


def shoot(plan, worn, folder, frames: list[int]) -> int:
    settings = {"surfaces": plan.surfaces, "cameras": plan.cameras, "gains": plan.gains, "spp": plan.request.spp, "seed": plan.request.seed}
    return photograph(frames, [plan.surface_vertices(worn, t) for t in frames], folder=folder, **settings)


def test_interrupted_photography_gives_the_same_bytes(plan, worn, tmp_path) -> None:
    """In one go; and in another order with a picture lost and a file half written on the way."""
    assert shoot(plan, worn, tmp_path / "a", [0, 1]) == 6
    assert shoot(plan, worn, tmp_path / "b", [1]) == 3
    lost = picture_paths(tmp_path / "b", "Cam002", 1)[1]
    lost.rename(lost.with_name(f".123.{lost.name}"))
    assert shoot(plan, worn, tmp_path / "b", [0, 1]) == 4
    assert digests(tmp_path / "a") == digests(tmp_path / "b") and len(digests(tmp_path / "a")) == 12
    assert shoot(plan, worn, tmp_path / "b", [0, 1]) == 0


def test_the_reader_takes_the_folder(plan, worn, scanned, tmp_path) -> None:
    frames = list(range(2))
    shoot(plan, worn, tmp_path / "1x", frames)
    write_whole(tmp_path / "template/template.obj", lambda aside: write_obj(aside, scanned.template))
    _write_tables(tmp_path, plan, worn)
    recording = read_actorshq(tmp_path, frames=frames, deep=True)
    assert recording.cameras.names == ("Cam001", "Cam002", "Cam003") and recording.fps == 25 and len(recording.frames) == 2
    np.testing.assert_allclose(recording.cameras.K, plan.cameras.K, rtol=1e-12)
    np.testing.assert_allclose(recording.cameras.R, plan.cameras.R, atol=1e-12)
    least, most = AREAL_DENSITY
    assert 0.8 * least < recording.mass_kg < 2.0 * most  # of 0.8 to 2 m² of cloth
    boxes = np.loadtxt(tmp_path / "aabbs.csv", delimiter=",", skiprows=1)
    assert (boxes[0, 1:4] < scanned.template.vertices.min(0)).all() and (boxes[0, 4:] > scanned.template.vertices.max(0)).all()
    assert read_template(recording.template).faces.shape == scanned.template.faces.shape
    picture_paths(tmp_path / "1x", "Cam001", 1)[0].unlink()
    with pytest.raises(BadInput, match="missing"):
        read_actorshq(tmp_path, frames=frames)


def test_the_template_is_a_noisy_scan_of_the_truth(plan, worn, scanned) -> None:
    away = scanned.template.vertices - template_motion(plan, worn, scanned)[0]
    assert away.std() == pytest.approx(NOISE, rel=0.02)
    for name, limit in (("skirt", 800), ("top", 900), ("body", 3200)):
        assert len(np.unique(scanned.template.faces[scanned.template.part == name])) < limit


def test_charts_do_not_overlap_and_keep_their_scale(scanned) -> None:
    t = scanned.template
    assert t.uv_vertices.min() >= 0 and t.uv_vertices.max() <= 1
    u = np.diff(t.uv_vertices[t.uv_faces], axis=1)
    flat = (u[:, 0, 0] * u[:, 1, 1] - u[:, 0, 1] * u[:, 1, 0]) / 2
    assert (flat > 0).mean() > 0.999
    label = components(t.uv_faces, len(t.uv_vertices))[t.uv_faces[:, 0]]
    boxes = [(t.uv_vertices[t.uv_faces[label == c]].reshape(-1, 2)) for c in range(label.max() + 1)]
    low, high = (np.array([f(b, axis=0) for b in boxes]) for f in (np.min, np.max))
    apart = (low[:, None] > high[None]).any(2) | (low[None] > high[:, None]).any(2)
    assert (apart | np.eye(len(boxes), dtype=bool)).all()


def test_box_charts_of_a_cube_are_its_sides() -> None:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1.0)])
    quads = np.array([[4, 6, 7, 5], [0, 1, 3, 2], [2, 3, 7, 6], [0, 4, 5, 1], [1, 5, 7, 3], [0, 2, 6, 4]])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    assert face_normals(corners, faces)[:6].argmax(1).tolist()[0] == 0
    uv, uv_faces = box_charts(corners, faces)
    assert components(uv_faces, len(uv)).max() == 5
    packed = pack(uv, uv_faces)
    assert packed.min() > 0 and packed.max() < 1
    side = np.linalg.norm(packed[uv_faces[:, 0]] - packed[uv_faces[:, 1]], axis=1)
    assert side[:6].std() < 1e-12  # one scale for all


def test_a_seal_notices_what_changed(tmp_path) -> None:
    write_whole(tmp_path / "data/a.txt", b"one")
    (tmp_path / "data/.7.b.txt").write_bytes(b"half")
    whole, path = {"recording": tmp_path / "data"}, tmp_path / "complete.json"
    assert altered(path, whole) is None
    seal(path, whole)
    assert altered(path, whole) == [] and list(json.loads(path.read_text())["recording"]) == ["a.txt"]
    (tmp_path / "data/a.txt").write_bytes(b"two")
    assert altered(path, whole) == [tmp_path / "data/a.txt"]


def test_another_request_is_refused(tmp_path) -> None:
    _claim(tmp_path / "request.json", asdict(Request(seed=1)))
    _claim(tmp_path / "request.json", asdict(Request(seed=1)))
    with pytest.raises(BadInput, match=r"'seed': \(1, 2\)"):
        _claim(tmp_path / "request.json", asdict(Request(seed=2)))


@pytest.mark.slow
def test_a_whole_recording_resumes_to_the_same_bytes(tmp_path, cache) -> None:
    """Simulated, photographed, killed by its own progress report, resumed; a finished recording is left untouched."""
    request = Request(cameras=2, frames=3, size=64, spp=2)

    def kill(what: str, done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_demo_recording(tmp_path / "r", tmp_path / "t", cache=cache, request=request, on_progress=kill)
    folder = make_demo_recording(tmp_path / "r", tmp_path / "t", cache=cache, request=request)
    other = make_demo_recording(tmp_path / "r2", tmp_path / "t2", cache=cache, request=request)
    assert digests(folder) == digests(other)
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    make_demo_recording(tmp_path / "r", tmp_path / "t", cache=cache, request=request)
    assert before == {p: p.stat().st_mtime_ns for p in folder.rglob("*")}
    lost, spoilt = (p for p in sorted((folder / "1x/masks/Cam002").iterdir()) if p.name.endswith(("0.png", "1.png")))
    lost.unlink()
    spoilt.write_bytes(b"")
    make_demo_recording(tmp_path / "r", tmp_path / "t", cache=cache, request=request)
    assert digests(folder) == digests(other)
