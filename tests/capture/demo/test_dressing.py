"""Moving the garments: a simulation taken up again gives the same bits, points attached to the body go with it, fabrics are plausible."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from tasks.capture.demo import dressing
from tasks.capture.demo.actor import attach
from tasks.capture.demo.dressing import Fitting, wear
from tasks.capture.demo.fabrics import AREAL_DENSITY, BENDING_LENGTH, STRETCH, draw_fabrics
from tasks.capture.demo.garments import Panel, sew
from tasks.capture.demo.panels import sample, triangulate
from tasks.capture.demo.plan import make_plan
from tasks.cloth.estimates import bending_length
from tasks.simulator.fabric import Fabric


@pytest.fixture(scope="module")
def flag() -> Fitting:
    """A cloth of 20 cm held along its upper edge, which is moved sideways; nothing to collide with but a far triangle."""
    corners = np.array([[0, 0], [0.2, 0], [0.2, 0.2], [0, 0.2], [0, 0]])
    outline = np.concatenate([sample(corners[k : k + 2], 0.05)[:-1] for k in range(4)])
    points, faces = triangulate(outline, 0.05, np.random.default_rng(0))
    garment = sew("flag", [Panel(points, faces, np.c_[points, np.zeros(len(points))], points[:, 1] > 0.2 - 1e-9)])
    t = np.arange(13)[:, None, None]
    far = np.array([[5, 0, 0], [6, 0, 0], [5, 1, 0.0]]) + 0.0 * t
    held = garment.vertices[garment.boundary] + 0.01 * t * np.array([0, 0, 1.0])
    return Fitting(garment, Fabric(), np.array([[0, 1, 2]], np.int32), far, held, 25.0)


def test_taken_up_again_it_gives_the_same_bits(flag, monkeypatch) -> None:
    """Killed after frame 7, or after frame 11 in the second segment, or not at all."""
    monkeypatch.setattr(dressing, "SETTLING", 4)
    states = {}
    whole = wear(flag, keep=lambda k, x, v: states.update({k: (x, v)}))
    assert sorted(states) == list(range(13))
    for last in (7, 11):
        rest = {}
        again = wear(flag, have={k: s for k, s in states.items() if k <= last}, keep=lambda k, x, v, rest=rest: rest.update({k: x}))
        assert_array_equal(again, whole)
        assert max(rest) == 12 and min(rest) == (1 if last < 10 else 11)
    moved = wear(replace(flag, fabric=Fabric(bending=100.0)), have={0: states[0]})
    assert np.abs(moved - whole).max() > 1e-5


def test_what_the_base_model_lacks_moves_the_garment(flag, monkeypatch) -> None:
    """Gravity that leans by θ about x settles the flag leaning towards −z; about z, towards +x. Nothing planted is nothing."""
    monkeypatch.setattr(dressing, "SETTLING", 12)
    hanging = replace(flag, boundary_motion=np.repeat(flag.boundary_motion[:1], 2, 0), collider_motion=flag.collider_motion[:2])
    plain, still = wear(hanging)[-1], wear(replace(hanging, unmodelled={"gravity_tilt": (0.0, 0.0)}))[-1]
    assert_allclose(still, plain, atol=1e-12)
    lowest = np.argmin(hanging.garment.vertices[:, 1])
    for strengths, axis, sign in (((0.04, 0.0), 2, -1), ((0.0, 0.04), 0, 1)):
        once, twice = (wear(replace(hanging, unmodelled={"gravity_tilt": tuple(k * θ for θ in strengths)}))[-1][lowest] for k in (1, 2))
        moved, further = once - plain[lowest], twice - plain[lowest]
        assert sign * moved[axis] > 0 and abs(moved[axis]) == np.abs(moved).max()
        assert further[axis] == pytest.approx(2 * moved[axis], rel=0.1)


def test_the_demo_moves_in_air_unless_told_otherwise(plan, body_model) -> None:
    """C_d/ρ̄ of either garment; planted faults take its place."""
    for fitting in plan.fittings.values():
        assert fitting.unmodelled == {"air_normal_drag": (dressing.DRAG_COEFFICIENT / fitting.fabric.areal_density,)}
    other = make_plan(plan.request, body_model, {"body_offset": (0.01,)})
    assert all(f.unmodelled == {"body_offset": (0.01,)} for f in other.fittings.values())


def test_the_boundary_goes_where_it_is_held(flag, monkeypatch) -> None:
    monkeypatch.setattr(dressing, "SETTLING", 4)
    x = wear(flag)
    assert_allclose(x[:, flag.garment.boundary], flag.boundary_motion, atol=1e-9)


def test_attached_points_of_the_skin_move_as_the_skin(plan) -> None:
    """Vertices of the body itself, attached at the first frame, are found where the body model puts them later."""
    actor, chosen = plan.actor, np.arange(0, len(plan.actor.model.weights), 401)
    carried = attach(actor.posed.vertices[0][chosen], actor, frame=0).at(actor.posed.transforms)
    assert_allclose(carried, actor.posed.vertices[:, chosen], atol=1e-6)
    assert np.abs(carried - carried[:1]).max() > 0.01


@pytest.mark.parametrize("name", ["skirt", "top"])
def test_boundary_keeps_off_the_body_through_the_motion(plan, name) -> None:
    from tasks.geometry.distances import signed_distance

    fitting = plan.fittings[name]
    for t in (0, len(plan.actor.motion) // 2, -1):
        assert signed_distance(fitting.boundary_motion[t], plan.actor.posed.vertices[t], plan.actor.model.faces).min() > 2e-3


def test_the_collider_is_close_to_the_body(plan) -> None:
    from tasks.geometry.distances import closest_points

    for fitting in plan.fittings.values():
        for t in (0, -1):
            distance = closest_points(fitting.collider_motion[t], plan.actor.posed.vertices[t], plan.actor.model.faces).distance
            assert np.percentile(distance, 95) < dressing.GAP


def test_fabrics_lie_in_their_ranges_and_share_one_weight() -> None:
    for seed in range(20):
        fabrics = draw_fabrics(("a", "b"), np.random.default_rng(seed))
        assert fabrics["a"].areal_density == pytest.approx(fabrics["b"].areal_density)
        for fabric in fabrics.values():
            assert AREAL_DENSITY[0] <= fabric.areal_density <= AREAL_DENSITY[1]
            assert STRETCH[0] <= fabric.stretch_stiffness <= STRETCH[1]
            assert BENDING_LENGTH[0] <= bending_length(fabric) <= BENDING_LENGTH[1]


def test_the_template_can_show_how_the_cloth_bends(plan) -> None:
    from tasks.cloth.estimates import EDGES_PER_BENDING_LENGTH, mean_edge

    for garment in plan.scanned.values():
        assert BENDING_LENGTH[0] >= EDGES_PER_BENDING_LENGTH * mean_edge(garment.vertices, garment.faces)
