"""A quick diagnosis works on some of the garment's vertices: mass, zones, pins and observations stay, and the answer speaks of all vertices again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from tasks.cloth.contact_sagitta import contact_sagitta, drawn_in
from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.effects.retriangulated import retriangulated
from tasks.gap.coarse_garment import VERTICES, coarse_garment
from tasks.gap.diagnosis import RATIOS
from tasks.gap.garment_recordings import Garment
from tasks.geometry.decimation import roundness
from tasks.geometry.meshes import edges
from tasks.simulator import NO_COLLIDER, Cloth, Collider, Fabric, Settings
from tests.cloth.test_boundary import tube
from tests.simulator.scenes import sheet

SIDE, T = 55, 9


def garment(side=SIDE, *, uv=True):
    """A hanging panel of 0.6 m, its first row driven, its last a hem, with a seam and a patch that lies on a body."""
    flat, faces = sheet(side, side, length=0.6, width=0.6)
    x = np.stack([flat[:, 2], -flat[:, 0], 0.01 * np.sin(20 * flat[:, 2])], 1)
    zone = np.full(side**2, "free", "<U7")
    zone[side // 2 :: side], zone[-side:], zone[:side] = "seam", "hem", "pinned"
    zone[(np.hypot(x[:, 0] - 0.15, x[:, 1] + 0.3) < 0.08)] = "contact"
    cloth = Cloth(x, faces, np.arange(side), np.ascontiguousarray(flat[faces][:, :, [2, 0]]) if uv else None)
    rng = np.random.default_rng(0)
    observed = x + rng.normal(scale=1e-3, size=(T, *x.shape))
    observed[3, 100] = np.nan
    motion = Motion(np.zeros((T, 0, 3)), observed[:, :side])
    recording = Recording(NO_COLLIDER, motion, observed, rng.uniform(1e-3, 2e-3, (T, len(x))))
    model = Model(Subject(cloth, Fabric(), NO_COLLIDER, zone, 30.0), Settings())
    return Garment(model, (recording,), (), None, 0.0)


@pytest.fixture(scope="module", params=[True, False], ids=["pattern", "worn"])
def coarse(request):
    whole = garment(uv=request.param)
    return whole, coarse_garment(whole)


def test_as_many_vertices_as_are_asked_for_carry_the_same_mass(coarse):
    whole, found = coarse
    before, after = whole.model.subject.cloth, found.garment.model.subject.cloth
    assert len(before.x_rest) == 3025 and len(after.x_rest) == len(found.kept) == VERTICES
    assert after.rest_areas.sum() == pytest.approx(before.rest_areas.sum(), rel=0.02)
    assert after.vertex_areas.sum() == pytest.approx(before.vertex_areas.sum(), rel=0.02)
    np.testing.assert_array_equal(after.x_rest, before.x_rest[found.kept])
    assert roundness(after.x_rest, after.faces).min() > 0.25


def test_a_pattern_stays_the_same_pattern(coarse):
    whole, found = coarse
    before, after = whole.model.subject.cloth, found.garment.model.subject.cloth
    if before.uv is None:
        assert after.uv is None
        return
    place = np.zeros((len(before.x_rest), 2))
    place[before.faces] = before.uv
    np.testing.assert_array_equal(after.uv, place[found.kept][after.faces])
    u, v = after.uv[:, 1] - after.uv[:, 0], after.uv[:, 2] - after.uv[:, 0]
    signs = np.sign(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    assert abs(signs.sum()) == len(signs)  # no face is flipped


def test_every_zone_is_still_there_and_named_as_it_was(coarse):
    whole, found = coarse
    before, after = whole.model.subject.zone, found.garment.model.subject.zone
    np.testing.assert_array_equal(after, before[found.kept])
    lines = np.sqrt(len(before) / len(after))  # of an n-th of the vertices, a line keeps the root of that
    for zone in np.unique(before):
        assert 0.1 < (after == zone).mean() / (before == zone).mean() < 2.1 * lines


def pieces(cloth, on):
    """How many pieces the edges between the vertices `on` [V] make of them."""
    e = edges(cloth.faces)
    e = e[on[e].all(1)]
    graph = coo_matrix((np.ones(len(e)), (e[:, 0], e[:, 1])), shape=(len(on), len(on)))
    return len(np.unique(connected_components(graph, directed=False)[1][on]))


def test_lines_are_still_lines(coarse):
    for garment_ in (coarse[0], coarse[1].garment):
        subject = garment_.model.subject
        assert [pieces(subject.cloth, subject.zone == line) for line in ("pinned", "seam", "hem")] == [1, 1, 1]


def test_driven_nodes_and_observations_carry_over_as_they_are(coarse):
    whole, found = coarse
    before, after = whole.recordings[0], found.garment.recordings[0]
    driven = found.kept[found.garment.model.subject.cloth.boundary]
    assert 10 < len(driven) < SIDE and np.isin([0, SIDE - 1], driven).all()
    np.testing.assert_array_equal(after.motion.boundary, before.observed[:, driven])
    np.testing.assert_array_equal(after.observed, before.observed[:, found.kept])
    np.testing.assert_array_equal(after.noise, before.noise[:, found.kept])


def test_the_answer_speaks_of_every_vertex(coarse):
    _, found = coarse
    mm = [None, *np.arange(1.0, VERTICES)]
    found_there = {name: {"value": 2.0, "low": 1.0, "high": 4.0} for name in RATIOS}
    told = found.told({"where": {"vertex_mm": mm, "vertex_accel": mm, "frame_mm": [1.0]}, "parameters": found_there, "seconds": 3})
    assert len(told["where"]["vertex_mm"]) == len(told["where"]["vertex_accel"]) == 3025
    assert told["where"]["vertex_mm"][found.kept[7]] == 7.0
    assert told["where"]["vertex_mm"][found.kept[0]] is None
    assert told["where"]["frame_mm"] == [1.0] and told["seconds"] == 3
    times = found.on_whole(found.garment.model).subject.fabric.bending / found.garment.model.subject.fabric.bending
    assert told["parameters"]["kappa_s_over_rho"] == found_there["kappa_s_over_rho"] and times != pytest.approx(1.0, abs=0.01)
    assert told["parameters"]["kappa_b_over_rho"] == pytest.approx({"value": 2 * times, "low": times, "high": 4 * times})
    unknown = {name: {"value": None, "low": None, "high": None, "unit": "m3/kg"} for name in RATIOS}
    assert found.told({"where": {"vertex_mm": mm, "vertex_accel": mm}, "parameters": unknown})["parameters"] == unknown


def test_what_was_found_is_put_on_the_whole_garment(coarse):
    whole, found = coarse
    drag = library()["air_normal_drag"]
    fabric = Fabric(bending=7.0)
    thin = found.garment.model
    named = replace(thin, subject=replace(thin.subject, fabric=fabric), effects=(drag,), strengths={drag.name: np.array([5.0])})
    model = found.on_whole(named)
    assert model.subject.cloth is whole.model.subject.cloth
    assert (model.effects, model.strengths) == ((drag,), named.strengths)
    as_thinned = retriangulated(model.subject, thin.subject.cloth).fabric
    assert as_thinned.bending == pytest.approx(7.0) and model.subject.fabric == replace(fabric, bending=model.subject.fabric.bending)


def test_a_small_garment_is_left_as_it_is():
    whole = garment(16)
    found = coarse_garment(whole)
    assert found.garment is whole
    np.testing.assert_array_equal(found.recording(whole.recordings[0]).observed, whole.recordings[0].observed)
    ratios = {name: {"value": 2.0, "low": 1.0, "high": 4.0} for name in RATIOS}
    told = {"where": {"vertex_mm": [1.0] * 256, "vertex_accel": [2.0] * 256}, "parameters": ratios}
    assert found.told(told) == told


def test_longer_edges_stand_higher_on_a_body_which_is_drawn_in_for_that():
    x, faces = tube(0.104, 0.0, -0.4, 30, around=40)
    body, body_faces = tube(0.100, 0.05, -0.45, 60, around=80)
    cloth, settings = Cloth(x, faces, np.arange(40)), Settings()
    rec = Recording(
        Collider(body_faces), Motion(np.tile(body, (6, 1, 1)), np.tile(x[:40], (6, 1, 1))), np.tile(x, (6, 1, 1)), np.ones((6, 1200))
    )
    doubt = contact_sagitta(cloth, (rec,), settings.barrier_distance)
    model = Model(Subject(cloth, Fabric(), rec.collider, np.full(1200, "free"), 30.0), settings)
    whole = Garment(model, (drawn_in(rec, doubt),), (), None, doubt)
    found = coarse_garment(whole, count=300)
    assert found.garment.contact_doubt > 1.5 * doubt > 0
    for at in (found.garment.recordings[0], found.recording(whole.recordings[0])):  # learnt from, and held out
        radius = np.linalg.norm(at.motion.collider[0, 80:-80, ::2], axis=1)
        np.testing.assert_allclose(np.abs(0.100 - radius), found.garment.contact_doubt, rtol=0.02)
