"""Closed forms of what drives the cloth, what is seen of it, and how it is computed."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.effects.boundary_slip import turns
from tasks.effects.effect import MeshDoubt, Motion
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.simulator import Cloth, Collider, Settings
from tests.effects.scenes import FPS, TIGHT, hanging, seen, signature, struck, subject, walk
from tests.simulator.scenes import plane, sheet

LIBRARY = library()
T = 41
TIMES = np.arange(T) / FPS


def body(path: np.ndarray) -> Motion:
    return Motion(path[:, None] + np.zeros((1, 4, 1)), np.zeros((len(path), 2, 3)))


def test_a_late_body_is_put_where_it_is():
    """A body that swings, recorded τ late, comes back to where it was, the ends apart."""
    τ, ω = 0.021, 2 * np.pi

    def swing(t):
        return np.stack([0.1 * np.sin(ω * t), 0.05 * np.cos(ω * t), t], 1)

    s = struck()[0]
    found = LIBRARY["body_lag"].motion(s, body(swing(TIMES - τ)), [τ])
    np.testing.assert_allclose(found.collider[3:-3, 0], swing(TIMES)[3:-3], atol=2e-5)
    assert np.abs(body(swing(TIMES - τ)).collider - found.collider).max() > 0.01


def test_a_late_garment_is_an_early_body():
    s, motion, *_ = struck()
    early, late = LIBRARY["body_lag"].motion(s, motion, [-0.02]), LIBRARY["observation_delay"].motion(s, motion, [0.02])
    assert np.array_equal(early.collider, late.collider) and np.array_equal(late.boundary, motion.boundary)


def test_a_late_garment_by_one_frame_meets_the_body_of_the_frame_before():
    s, motion, *_ = struck()
    found = LIBRARY["observation_delay"].motion(s, motion, [1 / FPS])
    np.testing.assert_allclose(found.collider[1:], motion.collider[:-1], atol=1e-12)


def test_smoothing_lowers_a_sine_as_said():
    """Far from the ends; and a uniformly accelerated body is shifted by ½ τ² a everywhere, the ends included."""
    s, τ2 = struck()[0], 1.1e-3
    ω = 2 * np.pi * 5
    x = np.sin(ω * TIMES)[:, None, None] * np.ones((1, 2, 3))
    found = LIBRARY["observation_smoothing"].observe(s, x, [τ2])
    np.testing.assert_allclose(found[15:-15], np.exp(-τ2 * FPS**2 * (1 - np.cos(ω / FPS))) * x[15:-15], atol=1e-4)
    fall = 0.5 * 9.81 * TIMES[:, None, None] ** 2
    np.testing.assert_allclose(LIBRARY["observation_smoothing"].observe(s, fall, [τ2]) - fall, 0.5 * τ2 * 9.81, rtol=1e-6)


def test_other_tangents_are_seen_through_the_smoothing():
    """Drag under a tracker that smooths: what is seen changes by the smoothed tangent."""
    drag, smoothing = LIBRARY["air_normal_drag"], LIBRARY["observation_smoothing"]

    def sight(C, columns=False):
        frames, model = walk(struck(), (drag, smoothing), {drag.name: np.array([C]), smoothing.name: smoothing.typical}, columns=columns)
        return frames, model, model.observed(np.stack([f.x for f in frames]))

    frames, model, _ = sight(8.0, columns=True)
    tangents = {drag.name: np.stack([f.tangents[drag.name][0] for f in frames])}
    found = model.observed_tangents(np.stack([f.x for f in frames]), tangents)[drag.name]
    difference = (sight(8.001)[2] - sight(7.999)[2]) / 0.002
    assert np.linalg.norm(found - difference) < 1e-4 * np.linalg.norm(difference)
    assert np.linalg.norm(tangents[drag.name] - difference) > 1e-2 * np.linalg.norm(difference)


def test_a_smoothed_boundary_is_sharpened():
    """Smoothed and taken back, a driven node is where it was to second order in τ²."""
    s = struck()[0]
    effect, path = LIBRARY["observation_smoothing"], 0.1 * np.sin(2 * np.pi * TIMES)[:, None, None] * np.ones((1, 2, 3))
    error = []
    for τ2 in (2e-4, 4e-4):
        smooth = effect.observe(s, path, [τ2])
        back = effect.motion(s, Motion(np.zeros((T, 0, 3)), smooth), [τ2]).boundary
        error.append(np.abs(back - path)[5:-5].max())
        assert error[-1] < 0.1 * np.abs(smooth - path)[5:-5].max()
    assert error[1] / error[0] == pytest.approx(4, rel=0.1)


def test_a_tilt_is_the_turned_scene():
    """Gravity that leans by α about x does what upright gravity does to the scene turned by −α."""
    t = 0.05
    α = np.arctan(t)
    s, motion, x0, v0 = struck()
    c, n = np.cos(α), np.sin(α)
    R = np.array([[1, 0, 0], [0, c, -n], [0, n, c]])  # by +α about x
    leaning = seen(struck(), LIBRARY["gravity_tilt"], np.array([t, 0.0]))
    turned = replace(s, cloth=replace(s.cloth, x_rest=s.cloth.x_rest @ R))
    frames, _ = walk((turned, Motion(motion.collider @ R, motion.boundary @ R), x0 @ R, v0 @ R))
    np.testing.assert_allclose(np.stack([f.x for f in frames]) @ R.T, leaning, atol=1e-6)
    assert np.abs(leaning - seen(struck(), LIBRARY["gravity_tilt"], np.zeros(2))).max() > 1e-3


def test_a_scale_of_the_cameras_is_seen_through():
    """A hanging strip recorded e^s too large: with the effect the recording, divided by e^s, is the true strip. Stretch and bending were fitted."""
    s, motion, x0, v0 = hanging()
    k = np.exp(0.01)
    true = walk((s, motion, x0, v0 + 0.2 * (1 - np.exp(5 * x0[:, 1:2]))))[0]
    fitted = replace(s.fabric, membrane=s.fabric.membrane * k**0, bending=s.fabric.bending * k**2)
    # in recorded metres the membrane's rest areas grow with the scale, which is its k²; what is left of bending's k⁴ at the same mass is k²
    recorded = (replace(s, fabric=fitted), Motion(motion.collider * k, motion.boundary * k), x0 * k, k * true[0].v)
    found = seen(recorded, LIBRARY["observation_scale"], np.array([0.01]))
    assert np.abs(found / k - np.stack([f.x for f in true])).max() < 1e-6


@pytest.mark.parametrize("name", ["contact_thickness", "body_offset"])
def test_a_sheet_that_lies_on_a_plate_is_lifted_by_the_thickness(name):
    d = 0.004
    x, faces = sheet(4, 4, length=0.1, width=0.1)
    cloth = Cloth(x + np.array([-0.05, 0.0012, -0.05]), faces[:, ::-1])
    plate, plate_faces = plane(0.4)
    s = replace(subject(struck()[0].cloth, plate_faces), cloth=cloth, collider=Collider(plate_faces), fps=5.0)
    heights = []
    for θ in (0.0, d):
        model = Model(s, Settings(integrator="backward_euler", substeps=4), (LIBRARY[name],), {name: np.array([θ])})
        start = cloth.x_rest + np.array([0, θ, 0])
        frames = list(model.run(Motion(np.tile(plate, (8, 1, 1)), np.zeros((8, 0, 3))), start, 0 * start))
        assert frames[-1].converged
        heights.append(frames[-1].x[:, 1].mean())
    assert heights[1] - heights[0] == pytest.approx(d, abs=1e-6)


def test_slip_of_a_turning_band():
    """A band that turns by ψ(t) and rises: seen from it, the cloth stays behind by q ψ and u t."""
    s, q, u = struck()[0], 0.2, 0.01
    ψ = 3.0 * TIMES  # more than π in the end
    a = np.linspace(0, 2 * np.pi, 12, endpoint=False)

    def band(turn, drop):
        angle = a + turn[:, None]
        x = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 2) * 0.2
        return x + np.stack([0.5 * TIMES, 0.1 * TIMES - drop, 0 * TIMES], 1)[:, None]

    given = band(ψ, 0 * TIMES)
    np.testing.assert_allclose(turns(given), ψ, atol=1e-12)
    found = LIBRARY["boundary_slip"].motion(s, Motion(np.zeros((T, 0, 3)), given), [u, q])
    np.testing.assert_allclose(found.boundary, band((1 - q) * ψ, u * TIMES), atol=1e-12)


def test_no_more_friction_is_taken_away_than_there_is():
    """Where there is none left, the tangent is that towards more: a fit finds its way back."""
    effect, scene = LIBRARY["contact_friction"], struck()
    assert effect.fabric(scene[0].fabric, [-0.3]).friction == 0
    frames, model = walk(scene, (effect,), {effect.name: np.array([-0.3])}, columns=True)
    e = 2e-4
    none, one, two = (seen(scene, effect, np.array([θ])) for θ in (-0.2, -0.2 + e, -0.2 + 2 * e))
    assert np.array_equal(frames[-1].x, none[-1])
    forward = (4 * one - two - 3 * none) / (2 * e)
    difference = np.linalg.norm(signature(frames, model, effect)[effect.name] - forward)
    assert difference < 1e-3 * np.linalg.norm(forward), difference / np.linalg.norm(forward)


def test_friction_among_cloth_stays():
    fabric = LIBRARY["contact_friction"].fabric(struck()[0].fabric, [0.3])
    assert (fabric.friction, fabric.self_friction) == (pytest.approx(0.5), 0.2)


def test_reruns_change_how_and_not_what():
    assert LIBRARY["numerics_time_step"].settings(TIGHT, [1.0]).substeps == 2
    assert LIBRARY["numerics_integrator"].settings(TIGHT, [1.0]).integrator == "backward_euler"
    assert LIBRARY["numerics_integrator"].settings(TIGHT, [0.0]) is TIGHT
    assert LIBRARY["numerics_contact"].settings(TIGHT, [2.0]).contact_acceleration == 4 * TIGHT.contact_acceleration
    s = struck()[0]
    other = LIBRARY["numerics_triangulation"].subject(s, [1.0]).cloth
    assert np.array_equal(other.x_rest, s.cloth.x_rest) and (other.faces != s.cloth.faces).any(1).mean() > 0.5


def test_the_other_form_takes_the_place_of_the_base():
    """At share one the motion is the neo-Hookean cloth's."""
    s, motion, x0, v0 = struck()

    def ending(model):
        return list(model.run(motion, x0, v0))[-1].x

    effect = LIBRARY["numerics_material"]
    there = ending(Model(s, TIGHT, (effect,), {effect.name: effect.typical}))
    otherwise = ending(Model(s, replace(TIGHT, membrane="neo_hookean")))
    moved = np.abs(otherwise - ending(Model(s, TIGHT))).max()
    assert moved > 1e-5 and np.abs(there - otherwise).max() < 1e-3 * moved


@pytest.mark.parametrize("rounds", [1, 2])
def test_the_finer_mesh_carries_everything_along(rounds):
    """Twice the vertices a round; driven nodes on the driven edge; mass, pattern and start as before; cloth that hangs still nearly does so."""
    s, motion, x0, _ = struck()
    effect, θ = LIBRARY["numerics_mesh"], [float(rounds)]
    fine = effect.subject(s, θ)
    V = len(x0)
    assert 1.4**rounds < len(fine.cloth.x_rest) / V < 2.6**rounds and len(fine.zone) == len(fine.cloth.x_rest)
    assert np.array_equal(fine.cloth.x_rest[:V], s.cloth.x_rest) and np.array_equal(fine.zone[:V], s.zone)
    np.testing.assert_allclose(fine.cloth.rest_areas.sum(), s.cloth.rest_areas.sum())
    np.testing.assert_allclose(fine.cloth.x_rest[fine.cloth.boundary, 1], 0, atol=1e-12)
    driven = effect.motion(s, motion, θ).boundary
    np.testing.assert_allclose(driven[0], effect.start(s, x0, θ)[fine.cloth.boundary], atol=1e-12)
    frames, _ = walk(hanging(), (effect,), {effect.name: np.array(θ)})
    assert 1e-6 < np.abs(frames[-1].x[:V] - hanging()[2]).max() < 2e-3


def test_a_mesh_that_holds_cloth_off_feigns_size_and_time_one_with_folds_scale_and_calm_states_smoothing():
    doubt = MeshDoubt(contact=0.002, body_speed=0.4, scale=0.01, calmed=3e-4)
    found = {e.name: float(e.feigned(doubt).max()) for e in library().values() if e.feigned(doubt).any()}
    contact, time, scale = (
        ("body_offset", "contact_thickness"),
        ("body_lag", "observation_delay"),
        ("fabric_rest_scale", "observation_scale"),
    )
    assert found.pop("observation_smoothing") == 3e-4
    assert found == pytest.approx(dict.fromkeys(contact, 0.002) | dict.fromkeys(time, 0.005) | dict.fromkeys(scale, 0.01))
    still = MeshDoubt(contact=0.002, body_speed=0.0, scale=0.0)
    assert library()["body_lag"].feigned(still)[0] > 1  # a body at rest: no delay can be excluded
