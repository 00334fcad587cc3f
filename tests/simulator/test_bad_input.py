"""What cannot be simulated is refused by name; what was hardly meant is doubted."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.geometry.faults import BadInput
from tasks.simulator import Cloth, Collider, Fabric, simulate
from tasks.simulator.doubts import doubts
from tasks.simulator.settings import BASE
from tests.simulator.scenes import plane, sheet, sphere, still


def begin(cloth, fabric):
    return next(simulate(cloth, fabric, fps=25, **still(2, cloth)))


def doubted(cloth, fabric=None, motions=None, gravity=(0, -9.81, 0)):
    at = motions or still(2, cloth)
    return doubts(cloth, fabric or Fabric(), at["collider"], cloth.x_rest, at["collider_motion"], at["boundary_motion"], np.array(gravity))


def pinned(n=4):
    return Cloth(*sheet(n, n, length=0.2, width=0.2), np.arange(n))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("density", -1.0),
        ("membrane", 0.0),
        ("bending", -0.1),
        ("friction", np.nan),
        ("friction", -0.1),
        ("self_friction", -0.1),
        ("poisson", 1.0),
        ("rest_scale", np.inf),
        ("rest_scale", 0.0),
    ],
)
def test_a_fabric_that_cannot_move_is_refused(name, value):
    with pytest.raises(BadInput) as error:
        begin(pinned(), replace(Fabric(), **{name: value}))
    assert [fault.where for fault in error.value.faults] == [f"fabric.{name}"]


@pytest.mark.parametrize(
    ("name", "value"),
    [("substeps", 0), ("halvings", -1), ("newton_iterations", 0), ("barrier_distance", 0.0), ("acceleration_tolerance", np.nan)],
)
def test_settings_with_which_nothing_can_be_computed_are_refused(name, value):
    """Without a substep cloth had not moved, and every frame was "converged"."""
    with pytest.raises(BadInput, match=f"{name}: {value}"):
        next(simulate(pinned(), Fabric(), fps=25, settings=replace(BASE, **{name: value}), **still(2, pinned())))


@pytest.mark.parametrize("fps", [0.0, np.inf, np.nan])
def test_frames_that_last_for_ever_or_no_time_are_refused(fps):
    with pytest.raises(BadInput, match="fps"):
        simulate(pinned(), Fabric(), fps=fps, **still(2, pinned()))


def test_an_implausible_fabric_is_doubted_with_its_range():
    found = doubted(pinned(), Fabric(density=0.1, bending=3000, friction=-0.1))
    assert [d.where for d in found] == ["fabric.density", "fabric.bending", "fabric.friction"]
    assert "0.1 is outside 50 to 3000" in str(found[0])
    assert not doubted(pinned())


def test_faces_without_area_are_refused():
    x, faces = sheet(3, 3)
    x[1] = x[0]
    with pytest.raises(BadInput, match="faces have no area"):
        Cloth(x, faces)


def test_vertices_of_no_face_are_refused():
    x, faces = sheet(3, 3)
    with pytest.raises(BadInput, match="2 vertices belong to no face, the first is 9"):
        Cloth(np.concatenate([x, x[:2] + 5]), faces)


def test_motions_of_no_frame_or_no_places_are_refused():
    cloth = pinned()
    with pytest.raises(BadInput, match="collider_motion: it has no frames"):
        simulate(cloth, Fabric(), fps=25, **still(0, cloth))
    with pytest.raises(BadInput, match=r"boundary_motion: shape \(2, 5\)"):
        simulate(cloth, Fabric(), fps=25, **still(2, cloth) | {"boundary_motion": np.zeros((2, 5))})


def test_faces_that_count_from_the_end_are_refused():
    cloth, (ground, _) = pinned(), plane(1.0)
    with pytest.raises(BadInput, match=r"collider\.faces: they name vertex -1 of 4"):
        simulate(cloth, Fabric(), fps=25, **still(2, cloth, (ground - [0, 0.3, 0], np.array([[0, 1, -1]]))))


def test_patterns_without_area_or_folded_are_refused():
    x, faces = sheet(3, 3)
    uv = x[faces][:, :, [0, 2]]
    Cloth(x, faces, uv=uv)
    Cloth(x, faces, uv=uv * [-1, 1])  # a mirrored piece is no fold
    flat = uv.copy()
    flat[2] = flat[2, :1]
    with pytest.raises(BadInput, match="1 faces have no area in the pattern, the first is face 2"):
        Cloth(x, faces, uv=flat)
    folded = uv.copy()
    folded[folded[..., 0] > 0.9] -= [0.9, 0]  # the last row is laid back over the one before
    with pytest.raises(BadInput, match="turned over"):
        Cloth(x, faces, uv=folded)
    with pytest.raises(BadInput, match="not finite"):
        Cloth(x, faces, uv=np.where(uv > 0.9, np.nan, uv))


def test_a_piece_that_nothing_holds_is_doubted():
    x, faces = sheet(3, 3, length=0.1, width=0.1)
    two = np.concatenate([x, x + np.array([0.5, 0, 0])])
    cloth = Cloth(two, np.concatenate([faces, faces + 9]), np.array([0, 1]))
    assert "piece of vertex 9" in str(doubted(cloth)[0])
    ground, ground_faces = plane(4.0)
    assert not doubted(cloth, motions=still(2, cloth, (ground - [0, 0.2, 0], ground_faces)))
    above = still(2, cloth, (ground + np.array([0, 0.2, 0]), ground_faces))
    assert "piece of vertex 9" in str(doubted(cloth, motions=above)[0])
    assert not doubted(cloth, gravity=(0, 0, 0))


def test_a_collider_that_leaps_is_doubted_with_the_frame():
    cloth, ball = pinned(), sphere(1, 0.05)
    motions = still(5, cloth, (ball[0] - [0, 0.3, 0], ball[1]))
    motions["collider_motion"][3:] += [0.5, 0, 0]
    assert [str(d) for d in doubted(cloth, motions=motions)] == [
        "collider_motion: it moves 0.5 m to frame 3 and is 0.173 m large. Check the order of its frames."
    ]


def test_prescribed_nodes_under_the_skin_are_doubted():
    cloth, ball = pinned(), sphere(2, 0.1)
    covering = still(2, cloth, (ball[0] - [0.0, 0.09, 0.0], ball[1]))
    (doubt,) = doubted(cloth, motions=covering)
    assert "1 prescribed nodes lie inside the collider at frame 0, vertex 0" in str(doubt)


def test_a_collider_that_is_no_collider_holds_nothing():
    cloth = Cloth(*sheet(3, 3, length=0.1, width=0.1))
    none = {"collider": Collider(np.empty((0, 3))), "collider_motion": np.zeros((2, 0, 3)), "boundary_motion": np.zeros((2, 0, 3))}
    assert "neither boundary nor collider" in str(doubted(cloth, motions=none)[0])
