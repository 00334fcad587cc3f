"""The broad phase against all pairs of boxes, and against ipctk's."""

import ipctk
import numpy as np
import pytest

from tasks.geometry.meshes import edges
from tasks.simulator.near_pairs import BoxTree, near_pairs
from tests.simulator.scenes import sheet, sphere

REACH = 8e-3


@pytest.fixture(params=[0, 1])
def moving(request):
    """Vertices before and after [V, 3], edges, faces and what is prescribed: a rumpled sheet whose first row is held, and a ball under it
    that moves as well.
    """
    rng = np.random.default_rng(request.param)
    x, cloth = sheet(9, 11, length=0.2, width=0.2)
    ball, skin = sphere(1, 0.08)
    X = np.concatenate([x + 0.01 * rng.normal(size=x.shape), ball - [-0.1, 0.07, -0.1]])
    Y = X + 0.02 * rng.normal(size=X.shape)
    faces = np.concatenate([cloth, skin + len(x)]).astype(np.int32)
    prescribed = np.arange(len(X)) >= len(x)
    prescribed[:9] = True
    return X, Y, edges(faces).astype(np.int32), faces, prescribed


def ours(X, Y, e, faces, prescribed):
    low, high = np.minimum(X, Y) - REACH, np.maximum(X, Y) + REACH
    trees = [BoxTree.of(elements, X, prescribed) for elements in (e, faces, np.arange(len(X), dtype=np.int32)[:, None])]
    return near_pairs(*trees, low, high)


def test_all_pairs_of_boxes_that_meet_are_found_once(moving):
    X, Y, e, faces, prescribed = moving
    low, high = np.minimum(X, Y) - REACH, np.maximum(X, Y) + REACH

    def meeting(A, B):
        boxes = [(low[E].min(1), high[E].max(1)) for E in (A, B)]
        met = ((boxes[0][0][:, None] <= boxes[1][1]) & (boxes[1][0] <= boxes[0][1][:, None])).all(2)
        shared = (A[:, None, :, None] == B[None, :, None, :]).any((2, 3))
        held = prescribed[A].all(1)[:, None] & prescribed[B].all(1)
        return {tuple(pair) for pair in np.argwhere(met & ~shared & ~held).tolist()}

    edge_edge, face_vertex = ours(*moving)
    found = [tuple(sorted(pair)) for pair in edge_edge.tolist()]
    assert len(found) == len(set(found)) and set(found) == {pair for pair in meeting(e, e) if pair[0] < pair[1]}
    found = [tuple(pair) for pair in face_vertex.tolist()]
    assert len(found) == len(set(found)) and set(found) == meeting(faces, np.arange(len(X))[:, None])


def test_they_are_those_of_ipctk(moving):
    X, Y, e, faces, prescribed = moving
    mesh = ipctk.CollisionMesh(*(np.asfortranarray(a) for a in (X, e, faces)))
    patch = np.where(prescribed, 0, np.arange(1, len(X) + 1)).astype(np.int32)
    mesh.can_collide = ipctk.make_vertex_patches_filter(patch)
    theirs = ipctk.Candidates()
    theirs.build(mesh, np.asfortranarray(X), np.asfortranarray(Y), REACH)
    edge_edge, face_vertex = ours(*moving)
    assert {tuple(sorted(p)) for p in edge_edge.tolist()} == {tuple(sorted((p.edge0_id, p.edge1_id))) for p in theirs.ee_candidates}
    assert {tuple(p) for p in face_vertex.tolist()} == {(p.face_id, p.vertex_id) for p in theirs.fv_candidates}


def test_a_surface_without_elements_meets_nothing():
    nothing = BoxTree.of(np.empty((0, 3), np.int32), np.empty((0, 3)), np.empty(0, bool))
    assert not len(nothing.number)
    assert not any(len(p) for p in near_pairs(nothing, nothing, nothing, np.empty((0, 3)), np.empty((0, 3))))
