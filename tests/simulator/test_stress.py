"""The stress runs' figures and garments are what they claim, and one run of each difficulty goes through."""

import ipctk
import numpy as np
import pytest

from tasks.geometry.meshes import edges, mesh_faults, vertex_normals
from tasks.simulator.yielding import give_way
from tests.simulator.stress import DRESS, EASE, build, examine, figure, names, penetration, surface_net, union


def test_sixty_runs():
    assert len(set(names())) == 60


@pytest.mark.parametrize("stout", [0.9, 1.0, 1.1])
def test_skin_lies_on_the_surface_and_looks_out(stout):
    bones = figure(stout)
    x, faces = surface_net(lambda x: union(bones, x), 0.03)
    assert not mesh_faults(x, faces, "skin") and np.abs(union(bones, x)).max() < 1e-4
    centre, n = x[faces].mean(1), np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    assert np.mean(union(bones, centre + 0.01 * n) > union(bones, centre - 0.01 * n)) > 0.999


@pytest.mark.parametrize("garment", DRESS)
def test_garments_begin_off_the_skin(garment):
    bones = figure(1.0)
    x, faces, pins = DRESS[garment](bones)
    assert not mesh_faults(x, faces, garment) and len(pins) > 8 and 200 < len(x) < 800
    assert union(bones, x).min() > 0.8 * EASE


def test_pressed_arms_enter_the_body():
    case = build("cape", "press", 0)
    depth = [penetration(x, case.collider.faces) for x in case.collider_motion[[0, 9, 10]]]
    assert depth[0] == 0 and 0.005 < max(depth) < 0.042


@pytest.mark.parametrize(("garment", "act", "frame"), [("top", "crouch", 8), ("skirt", "cross", 6), ("cape", "press", 10)])
def test_a_figure_gives_way_by_half_of_what_it_enters_itself(garment, act, frame):
    """Creases at the hips, crossing thighs, arms pressed in: the skin is freed from itself within the bound."""
    case, clearance = build(garment, act, 0), 2e-3
    x, faces = case.collider_motion[frame], case.collider.faces
    drawn, yielded = give_way(x, faces, cloth=x, pins=np.empty((0, 3)), clearance=clearance)
    assert 0 < yielded.depth.max() <= penetration(x, faces) / 2 + clearance + 1e-12
    assert crossings(x, faces) > 20 and crossings(drawn, faces) == 0


def crossings(x, faces):
    """Number of edges that pass through faces of the surface, those that share a vertex left out."""
    e = edges(faces)
    a, b = x[e[:, 0]], x[e[:, 1]]
    broad = ipctk.LBVH()
    broad.build(np.asfortranarray(x), np.asfortranarray(e), np.asfortranarray(faces))
    found = ((c.edge_id, faces[c.face_id]) for c in broad.detect_edge_face_candidates())
    return sum(ipctk.is_edge_intersecting_triangle(a[i], b[i], *x[f]) for i, f in found if not np.isin(e[i], f).any())


@pytest.mark.parametrize(
    ("garment", "act", "seed", "frame"), [("trousers", "cross", 2, 7), ("trousers", "all", 2, 10), ("cape", "all", 0, 8)]
)
def test_skin_that_faces_skin_leaves_room_for_two_layers(garment, act, seed, frame):
    """Edges that face one another too, where crossing thighs were 2 mm apart: three barrier distances, between skin, cloth, cloth and skin."""
    case, clearance = build(garment, act, seed), 2e-3
    x, faces = case.collider_motion[frame], case.collider.faces
    drawn, yielded = give_way(x, faces, cloth=x, pins=np.empty((0, 3)), clearance=clearance)
    assert yielded.depth.max() <= penetration(x, faces) / 2 + clearance + 1e-12
    assert narrowest(drawn, faces) > 1.5 * clearance


def narrowest(x, faces):
    """Least distance [m], by ipctk, of edges whose ends look against one another."""
    e, n = edges(faces), vertex_normals(x, faces)
    X = np.asfortranarray(x)
    mesh, near = ipctk.CollisionMesh(X, np.asfortranarray(e), np.asfortranarray(faces)), ipctk.NormalCollisions()
    near.build(mesh, X, 0.006)
    pairs = [(e[pair.edge0_id], e[pair.edge1_id], pair) for pair in near.ee_collisions]
    facing = [(a, b, pair) for a, b, pair in pairs if n[a].mean(0) @ n[b].mean(0) < -0.2]
    return min(np.sqrt(pair.compute_distance(x[[*a, *b]].ravel())) for a, b, pair in facing)


@pytest.mark.slow
@pytest.mark.parametrize("case", [*names()[::11], ("trousers", "cross", 0), ("trousers", "cross", 2), ("top", "turn", 1)])
def test_a_run_goes_through(case):
    outcome = examine(*case)
    assert outcome.ending == "converged" and not outcome.crossing and outcome.beyond < 1e-9
