"""Cloth never crosses anything; starts and colliders that would make it are repaired, or named."""

import numpy as np
import pytest

from tasks.geometry.faults import BadInput
from tasks.simulator import Cloth, Collider, Fabric, Potential, Settings, simulate
from tasks.simulator.potential import NO_STIFFNESS
from tests.simulator.scenes import crosses, plane, run, sheet, sphere, still


def test_drop_on_a_sphere_crosses_nothing():
    x, faces = sheet(9, 9, length=0.4, width=0.4)
    ball = sphere(2, 0.1)
    cloth = Cloth(x - np.array([0.2, -0.105, 0.2]), faces)
    frames = run(cloth, Fabric(), still(8, cloth, ball), settings=Settings(integrator="backward_euler", substeps=1))
    assert not any(crosses(f, cloth, ball[1]) for f in frames)
    assert frames[-1].x[:, 1].min() < 0 and np.linalg.norm(frames[-1].x, axis=1).min() > 0.099  # it hangs around the ball
    frames[-1].x[40] = 0  # the middle vertex, pushed into the ball
    assert crosses(frames[-1], cloth, ball[1])


def test_offset_is_kept():
    x, faces = sheet(5, 5, length=0.1, width=0.1)
    ball = sphere(2, 0.1)
    cloth = Cloth(x - np.array([0.05, -0.11, 0.05]), faces)
    frames = run(cloth, Fabric(), still(6, cloth, ball), settings=Settings(contact_offset=4e-3))
    inner = 0.1 * np.cos(0.17)  # a face's middle lies inside the sphere
    assert np.linalg.norm(frames[-1].x, axis=1).min() > inner + 4e-3


def test_start_is_separated_by_about_the_overlap():
    x, faces = sheet(16, 16, length=0.6, width=0.6)
    ball = sphere(3, 0.1)
    cloth = Cloth(x - np.array([0.3, -0.085, 0.3]), faces)
    frames = run(cloth, Fabric(), still(2, cloth, ball))
    assert 0.0145 < frames[0].moved < 0.018 and not crosses(frames[0], cloth, ball[1])


class Pull(Potential):
    """The same force [N] on every node, as an effect brings it."""

    def __init__(self, force):
        self.force = np.asarray(force)

    def energy(self, x, step):
        return -float(np.sum(x @ self.force))

    def gradient(self, x, step):
        return np.tile(-self.force, (len(x), 1))

    def hessian(self, x, step, *, convex):
        return NO_STIFFNESS


def test_a_start_is_freed_by_stiffness_alone():
    """Weight of a hem, or wind, is none of what holds cloth in its place: it had moved cloth for as long as freeing takes."""
    x, faces = sheet(8, 8, length=0.3, width=0.3)
    ball = sphere(2, 0.1)
    cloth = Cloth(x - np.array([0.15, -0.095, 0.15]), faces)
    plain, pulled = (run(cloth, Fabric(), still(2, cloth, ball), potentials=p)[0] for p in ((), (Pull([0.0, -1e-3, 0.0]),)))
    assert plain.moved > 1e-3 and np.array_equal(plain.x, pulled.x)


@pytest.mark.parametrize(("height", "moved"), [(3e-5, False), (3e-6, True)])
def test_cloth_pressed_onto_a_body_goes_on_from_where_it_lies(height, moved):
    """In motion cloth comes within 0.03 of the barrier distance; a window may start there."""
    x, faces = sheet(4, 4, length=0.1, width=0.1)
    ground, ground_faces = plane(1.0)
    cloth = Cloth(x + np.array([0, height, 0]), faces)
    frames = run(cloth, Fabric(), still(3, cloth, (ground, ground_faces)))
    assert (frames[0].moved > 0) == moved
    assert not any(crosses(f, cloth, ground_faces) for f in frames)


@pytest.mark.parametrize("height", [3e-6, -1e-3])
def test_an_edge_that_lies_across_a_ridge_is_freed_though_every_vertex_is_clear(height):
    """No vertex of either is near the other; at 3 µm nothing crosses either."""
    ridge = np.array([[0, 0, -0.5], [0, 0, 0.5], [-0.5, -0.5, -0.5], [-0.5, -0.5, 0.5], [0.5, -0.5, -0.5], [0.5, -0.5, 0.5]])
    sides = np.array([[0, 3, 1], [0, 2, 3], [0, 1, 5], [0, 5, 4], [2, 4, 5], [2, 5, 3], [0, 4, 2], [1, 3, 5]], np.int32)
    x = np.array([[-0.1, height, 0], [0.1, height, 0], [0, 0.1 + height, 0.1]])
    cloth = Cloth(x, np.array([[0, 1, 2]], np.int32))
    frames = run(cloth, Fabric(), still(2, cloth, (ridge, sides)))
    assert frames[0].moved > 0 and not crosses(frames[0], cloth, sides)


def test_start_that_crosses_is_described():
    x, faces = sheet(16, 16, length=0.6, width=0.6)
    ball = sphere(3, 0.1)
    cloth = Cloth(x - np.array([0.3, -0.085, 0.3]), faces)
    frames = list(simulate(cloth, Fabric(), fps=25, settings=Settings(separate_start=False), **still(3, cloth, ball)))
    assert len(frames) == 1 and not frames[0].converged
    assert "crosses cloth face" in frames[0].ending and "further crossings" in frames[0].ending


@pytest.mark.parametrize("ball", [None, [0.1, -0.049, 0.1]], ids=["alone", "on a ball"])
@pytest.mark.parametrize(("shift", "said"), [([0.003, 5e-6, 0.002], "0.005 mm"), ([0.2 + 1e-6, 0, 0], "0.001 mm")])
def test_cloth_that_nearly_touches_itself_is_told_where(shift, said, ball):
    """Two sheets 5 µm apart, one on the other, and borders side by side that were not welded. A ball in the way is not to blame."""
    x, faces = sheet(5, 5, length=0.2, width=0.2)
    cloth = Cloth(np.concatenate([x, x + np.array(shift)]), np.concatenate([faces, faces + len(x)]))
    skin = None if ball is None else (sphere(2, 0.05)[0] + ball, sphere(2, 0.05)[1])
    (frame,) = simulate(cloth, Fabric(), fps=25, **still(2, cloth, skin))
    assert f"and itself are {said} apart near (" in frame.ending and frame.ending.endswith("a start needs 0.01. Weld or move them apart.")


@pytest.mark.parametrize("place", [[0.1303, -0.02, 0.1407], [0.15, -0.07, 0.15]], ids=["in the way of cloth", "inside the ball"])
def test_collider_vertices_of_no_face_are_not_there(place):
    """Cloth that sags over a ball neither stops at them, nor does the collider give way around them."""
    cloth = Cloth(*sheet(7, 7, length=0.3, width=0.3), np.r_[0:7, 42:49])
    ball, skin = sphere(2, 0.05)
    ball = ball + np.array([0.15, -0.07, 0.15])
    without = run(cloth, Fabric(membrane=0.05), still(4, cloth, (ball, skin)))
    beside = run(cloth, Fabric(membrane=0.05), still(4, cloth, (np.concatenate([ball, [place]]), skin)))
    for one, other in zip(without, beside, strict=True):
        assert np.array_equal(one.x, other.x) and not other.yielded


def pressing(gap_end):
    """Two balls that close in on a curtain between them until their centres are 2·gap_end apart."""
    x, faces = sheet(12, 12, length=0.4, width=0.4)
    x = x[:, [1, 0, 2]] + np.array([0, -0.2, -0.2])
    cloth = Cloth(x, faces, np.flatnonzero(x[:, 1] > 0.199))
    ball, ball_faces = sphere(2, 0.1)
    gaps = np.interp(np.arange(7), [0, 5], [0.13, gap_end])
    motion = np.stack([np.concatenate([ball + np.array([g, 0, 0]), ball - [g, 0, 0]]) for g in gaps])
    motions = still(7, cloth) | {"collider": Collider(np.concatenate([ball_faces, ball_faces + len(ball)])), "collider_motion": motion}
    return cloth, motions


def test_pinching_collider_gives_way():
    cloth, motions = pressing(0.06)
    frames = run(cloth, Fabric(), motions, settings=Settings(substeps=2))
    assert not frames[0].yielded and frames[-1].yielded
    assert 0.04 < frames[-1].yielded.depth.max() < 0.042 + 1e-9  # half the overlap of 80 mm and the clearance
    assert not crosses(frames[-1], cloth, motions["collider"].faces)


def test_collider_that_pinches_between_frames_gives_way():
    """Two balls that pass one another 10 mm too close, a curtain between them; in both frames they are apart."""
    cloth, motions = pressing(0.095)
    C = motions["collider_motion"].shape[1] // 2
    apart = motions["collider_motion"][-1]
    way = np.repeat([[0.0, 0.0, -0.15], [0.0, 0.0, 0.15]], C, 0)
    motions |= {"collider_motion": np.stack([apart + way, apart - way]), "boundary_motion": motions["boundary_motion"][:2]}
    frames = run(cloth, Fabric(friction=0.0), motions, fps=2.0)
    assert not frames[0].yielded and not frames[-1].yielded
    assert not crosses(frames[-1], cloth, motions["collider"].faces)


def test_pinching_collider_that_may_not_give_way_ends_with_the_place():
    cloth, motions = pressing(0.06)
    *_, last = simulate(cloth, Fabric(), fps=25, settings=Settings(substeps=1, halvings=0, yield_collider=False), **motions)
    assert not last.converged and "blocked" in last.ending and "collider vertices" in last.ending


def test_pins_under_the_skin():
    """A curtain whose rail lies 3 mm inside the collider."""
    ball = sphere(3, 0.1)
    x, faces = sheet(5, 5, length=0.1, width=0.1)
    cloth = Cloth(x + np.array([0.0, 0.0, -0.05]), faces, np.arange(2, 3))
    lowered = cloth.x_rest + np.array([0.0, 0.097, 0.0])
    cloth = Cloth(lowered, faces, np.arange(2, 3))
    frames = run(cloth, Fabric(), still(4, cloth, ball))
    assert frames[-1].yielded and np.allclose(frames[-1].x[2], lowered[2]) and not crosses(frames[-1], cloth, ball[1])


def test_bad_arrays_are_all_named():
    cloth = Cloth(*sheet(3, 3))
    with pytest.raises(BadInput) as error:
        simulate(cloth, Fabric(), Collider([[0, 1, 9]]), collider_motion=np.zeros((3, 3, 3)), boundary_motion=np.zeros((2, 1, 3)), fps=0)
    assert {fault.where for fault in error.value.faults} == {"boundary_motion", "collider_motion", "collider.faces", "fps"}
