"""Candidates of one segment serve near it, and nowhere else."""

import ipctk
import numpy as np
import pytest

from tasks.simulator import Cloth, Collider
from tasks.simulator.contact_surface import LEAST, SLACK, ContactSurface
from tests.simulator.scenes import sheet, sphere

REACH = 1e-3


@pytest.fixture
def scene():
    """A sheet 3 mm above a ball, the surface of both, and how often the broad phase was asked."""
    cloth = Cloth(*sheet(9, 9, length=0.2, width=0.2))
    vertices, faces = sphere(2, 0.1)
    ball = vertices + np.array([0.1, -0.103, 0.1])
    return ContactSurface(cloth, Collider(faces), ball, barrier_distance=REACH), cloth.x_rest, ball


def pairs_from_scratch(surface, X):
    near = ipctk.NormalCollisions()
    near.collision_set_type, near.use_area_weighting = ipctk.NormalCollisions.IPC, True
    near.build(surface.mesh, X, REACH, 0.0)
    return len(near)


def asked(surface, monkeypatch):
    """Segments that the broad phase is asked about."""
    found, build = [], surface.coming_near
    monkeypatch.setattr(surface, "coming_near", lambda *of: (found.append(of), build(*of))[1])
    return found


def test_within_the_slack_the_broad_phase_is_asked_once(scene, monkeypatch):
    surface, x, ball = scene
    segments = asked(surface, monkeypatch)
    down = np.array([0.0, -2.5e-3, 0.0])
    surface.prepare(surface.join(x, ball), surface.join(x + down, ball))
    for further in (0.0, 0.3e-3, 0.45e-3):
        X = surface.join(x + down - [0.0, further, 0.0], ball)
        surface.prepare(surface.join(x, ball), X)
        assert len(surface.pairs(X)) == pairs_from_scratch(surface, X) > 0
    assert len(segments) == 1
    surface.forget()
    surface.prepare(X, X)
    assert len(segments) == 2


def test_candidates_reach_as_far_as_the_slack(scene, monkeypatch):
    surface, x, ball = scene
    segments = asked(surface, monkeypatch)
    X = surface.join(x - [0.0, -1.4e-3, 0.0], ball)
    surface.prepare(X, X)
    Y = surface.join(x - [0.0, 0.95 * SLACK * REACH - 1.4e-3, 0.0], ball)
    assert len(surface.pairs(Y)) == pairs_from_scratch(surface, Y) > 0
    surface.prepare(X, Y)
    assert len(segments) == 1


def test_beyond_the_slack_nothing_is_missed(scene, monkeypatch):
    surface, x, ball = scene
    x = x - [0.0, -2e-3, 0.0]
    X = surface.join(x, ball)
    segments = asked(surface, monkeypatch)
    surface.prepare(X, X)
    lowered = x - [0.0, 1.01 * SLACK * REACH, 0.0]
    Y = surface.join(lowered - np.array([0.0, 0.4e-3, 0.0]), ball)
    assert len(surface.pairs(Y)) == pairs_from_scratch(surface, Y) > 0
    surface.prepare(X, Y)
    assert len(segments) == 3  # of the segment, of Y alone, of the way there
    assert surface.free_step(X, surface.join(x - [0.0, 8e-3, 0.0], ball)) < 1


def test_gaps_never_shrink_to_rounding(scene):
    """However often the sheet is pushed on, the ball stays further off than the rounding of places."""
    surface, x, ball = scene
    for _ in range(10):
        X, Y = surface.join(x, ball), surface.join(x - [0.0, 1e-2, 0.0], ball)
        x = x - [0.0, 1e-2 * surface.free_step(X, Y), 0.0]
    gap = surface.least_distance(surface.join(x, ball))
    assert 0.99 * LEAST < gap < 1.1 * LEAST


def test_a_long_segment_is_looked_at_no_further_than_it_is_free(scene, monkeypatch):
    """Blocked early, only its first stretch is asked about; free, all of it; and the share is that of the whole, to the tenth of a gap that is kept."""
    surface, x, ball = scene
    segments = asked(surface, monkeypatch)
    X, down, up = (surface.join(x - [0.0, far, 0.0], ball) for far in (0.0, 0.1, -0.1))
    share = surface.free_step(X, down)
    assert len(segments) == 1
    whole = surface.free_share_of(X, down, surface.coming_near(X, down, 0.0))
    assert share == pytest.approx(whole, rel=1e-9)
    assert surface.free_step(X, up) == 1
    surface.forget()
    segments.clear()
    assert surface.free_step(X, up) == 1 and len(segments) == 3


@pytest.mark.parametrize("wild", [np.nan, np.inf])
def test_a_step_that_is_not_finite_goes_nowhere(scene, wild):
    """Newton's direction may overflow; nobody waits for the end of it."""
    surface, x, ball = scene
    X, Y = surface.join(x, ball), surface.join(x, ball)
    Y[40, 1] = wild
    assert surface.free_step(X, Y) == 0


def test_fine_cloth_is_not_a_candidate_of_all_around_it(monkeypatch):
    """Edges of 3 mm are nearer to their neighbours than the slack of coarser cloth: a quarter of an edge is looked at around a segment."""
    cloth = Cloth(*sheet(21, 21, length=0.06, width=0.06))
    surface = ContactSurface(cloth, Collider(np.empty((0, 3), np.int32)), np.empty((0, 3)), barrier_distance=REACH)
    found, build = [], surface.coming_near
    monkeypatch.setattr(surface, "coming_near", lambda *of: (found.append(build(*of)), found[-1])[1])
    X = surface.join(cloth.x_rest, np.empty((0, 3)))
    surface.prepare(X, X)
    assert sum(map(len, found[0])) < 12 * len(X)
    surface.prepare(X, X + np.array([0.0, 0.7e-3, 0.0]))
    assert len(found) == 1
    surface.prepare(X, X + np.array([0.0, 0.8e-3, 0.0]))
    assert len(found) == 2
