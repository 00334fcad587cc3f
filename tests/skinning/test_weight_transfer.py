"""Weight transfer against weights known on a cylinder, against a dense minimiser, and against itself renumbered."""

import numpy as np
import pytest

from tasks.geometry.faults import BadInput
from tasks.skinning.weight_transfer import inpaint, transfer_weights


def cylinder(around: int, along: int, *, radius: float = 0.1, length: float = 1.0, turn: float = 0.0):
    """An open tube along y: vertices [around·(along+1), 3] m and outward faces."""
    φ, y = np.meshgrid(turn + 2 * np.pi * np.arange(around) / around, np.linspace(0, length, along + 1))
    vertices = np.stack([radius * np.sin(φ), y, radius * np.cos(φ)], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(along))
    a, b = (j * around + i).ravel(), (j * around + (i + 1) % around).ravel()
    c, d = a + around, b + around
    return vertices, np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)]).astype(np.int32)


def linear_in_height(vertices):
    s = np.clip(vertices[:, 1], 0, 1)
    return np.stack([s, 1 - s], 1)


def source():
    vertices, faces = cylinder(24, 20)
    return vertices, faces, linear_in_height(vertices)


def test_a_mesh_onto_itself_keeps_its_weights():
    vertices, faces, weights = source()
    skin = transfer_weights(vertices, faces, weights, vertices, faces)
    assert skin.matched.all()
    np.testing.assert_allclose(skin.weights, weights, atol=1e-10)


def test_a_linear_field_is_recovered_on_another_triangulation():
    """The sleeve is 5 mm above the tube: closest points keep the height, so the linear field comes over exactly."""
    vertices, faces = cylinder(37, 31, radius=0.105, turn=0.03)
    skin = transfer_weights(*source(), vertices, faces)
    assert skin.matched.all()
    np.testing.assert_allclose(skin.weights, linear_in_height(vertices), atol=1e-9)


def test_a_ring_that_bulges_away_is_inpainted_linearly():
    """A tube is developable: between matched ends the linear field is harmonic, hence the minimiser but for the bulge."""
    vertices, faces = cylinder(24, 40)
    middle = np.abs(vertices[:, 1] - 0.5) < 0.16
    vertices[middle, 0] *= 1.9
    vertices[middle, 2] *= 1.9  # 9 cm off: past 5 % of the 1.04 m diagonal
    skin = transfer_weights(*source(), vertices, faces)
    assert (~skin.matched).sum() >= middle.sum()
    # the jump in radius adds area between the rings and bends the profile a little; its ends must meet and it must stay monotone
    np.testing.assert_allclose(skin.weights, linear_in_height(vertices), atol=0.06)
    height = np.unique(vertices[:, 1].round(9))
    profile = [skin.weights[np.isclose(vertices[:, 1], y), 0].mean() for y in height]
    assert (np.diff(profile) > 0).all()


def cotangent_energy_obvious(vertices, faces):
    """Q = −L + L M⁻¹ L with one loop over corners; equals the tufted operator on a closed Delaunay mesh."""
    L, M = np.zeros((len(vertices),) * 2), np.zeros(len(vertices))
    for face in faces:
        for k in range(3):
            o, a, b = face[k], face[(k + 1) % 3], face[(k + 2) % 3]
            u, v = vertices[a] - vertices[o], vertices[b] - vertices[o]
            cross = np.linalg.norm(np.cross(u, v))
            L[a, b] += u @ v / cross / 2
            L[b, a] += u @ v / cross / 2
            M[o] += cross / 6
    L -= np.diag(L.sum(1))
    return -L + L @ np.diag(1 / M) @ L


def dirichlet_fill(vertices, faces, w, fixed):
    import robust_laplacian

    C = robust_laplacian.mesh_laplacian(vertices, faces.astype(np.int64))[0].toarray()
    return np.linalg.solve(C[np.ix_(~fixed, ~fixed)], -C[np.ix_(~fixed, fixed)] @ w[fixed])


def icosphere():
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=3)
    return np.asarray(sphere.vertices), np.asarray(sphere.faces, np.int32)


def test_a_hole_is_filled_as_a_dense_minimiser_fills_it():
    vertices, faces = icosphere()
    fixed = vertices[:, 0] < 0.4
    rng = np.random.default_rng(3)
    w = rng.random((len(vertices), 2))
    got = inpaint(vertices, faces, w, fixed)
    Q = cotangent_energy_obvious(vertices, faces)
    expected = np.linalg.solve(Q[np.ix_(~fixed, ~fixed)], -Q[np.ix_(~fixed, fixed)] @ w[fixed])
    np.testing.assert_allclose(got[~fixed], expected, atol=2e-4)  # mollification moves the cotangents by about 1e-5
    np.testing.assert_array_equal(got[fixed], w[fixed])
    assert np.abs(expected - dirichlet_fill(vertices, faces, w, fixed)).max() > 0.05  # the comparison can tell the two energies apart


def jittered_garment():
    vertices, faces = cylinder(22, 24, radius=0.104)
    rng = np.random.default_rng(5)
    off = (np.abs(vertices[:, 1] - 0.4) < 0.2) & (vertices[:, 0] > 0.03)
    vertices[off] *= [1.9, 1, 1.9]
    return vertices + 1e-4 * rng.normal(size=vertices.shape), faces


@pytest.mark.parametrize("smoothed", [False, True])
def test_renumbering_vertices_and_faces_changes_nothing(smoothed):
    vertices, faces = jittered_garment()
    rng = np.random.default_rng(6)
    order = rng.permutation(len(vertices))
    number = np.argsort(order)
    shuffled = number[faces][rng.permutation(len(faces))].astype(np.int32)
    plain = transfer_weights(*source(), vertices, faces, smoothed=smoothed)
    renumbered = transfer_weights(*source(), vertices[order], shuffled, smoothed=smoothed)
    assert 0 < (~plain.matched).sum() < len(vertices)
    np.testing.assert_array_equal(renumbered.matched, plain.matched[order])
    np.testing.assert_allclose(renumbered.weights, plain.weights[order], atol=1e-8)


def test_rows_stay_a_partition_of_unity_where_the_squared_laplacian_overshoots():
    vertices, faces, _ = source()
    steps = np.eye(2)[(vertices[:, 1] > 0.5).astype(int)]
    sleeve, sleeve_faces = cylinder(22, 44, radius=0.105)
    sleeve[np.abs(sleeve[:, 1] - 0.35) < 0.13] *= [1.9, 1, 1.9]
    skin = transfer_weights(vertices, faces, steps, sleeve, sleeve_faces)
    assert inpaint(sleeve, sleeve_faces, skin.weights, skin.matched).min() < -1e-3  # it does overshoot here
    assert skin.weights.min() >= 0
    np.testing.assert_allclose(skin.weights.sum(1), 1, atol=1e-12)


def test_a_detached_piece_is_reported_and_still_gets_weights():
    vertices, faces = cylinder(22, 24, radius=0.104)
    ball, ball_faces = icosphere()
    both = np.concatenate([vertices, 0.05 * ball + [0.6, 0.25, 0]])
    skin = transfer_weights(*source(), both, np.concatenate([faces, ball_faces + len(vertices)]))
    assert len(skin.unmatched_pieces) == 1
    np.testing.assert_array_equal(skin.unmatched_pieces[0], np.arange(len(vertices), len(both)))
    assert "match the body nowhere" in skin.ending
    np.testing.assert_allclose(skin.weights.sum(1), 1, atol=1e-12)
    np.testing.assert_allclose(skin.weights[len(vertices) :, 0].mean(), 0.25, atol=0.02)


def test_a_vertex_of_no_face_does_not_spoil_the_rest():
    vertices, faces = cylinder(22, 24, radius=0.104)
    skin = transfer_weights(*source(), np.concatenate([[[0.3, 0.9, 0]], vertices]), faces + 1)
    np.testing.assert_allclose(skin.weights[1:], linear_in_height(vertices), atol=1e-9)
    assert [piece.tolist() for piece in skin.unmatched_pieces] == [[0]]


def test_smoothing_leaves_matched_vertices_far_from_a_hole_alone():
    vertices, faces = jittered_garment()
    plain = transfer_weights(*source(), vertices, faces)
    smooth = transfer_weights(*source(), vertices, faces, smoothed=True)
    moved = np.abs(plain.weights - smooth.weights).max(1) > 1e-12
    assert moved[~plain.matched].mean() > 0.5
    assert not moved[vertices[:, 1] > 0.75].any()


def test_inside_out_garments_match_only_when_two_sided():
    """Negative control: with the faces turned, nothing may match, and the flag brings everything back."""
    vertices, faces = cylinder(22, 24, radius=0.104)
    turned = faces[:, ::-1].copy()
    one_sided = transfer_weights(*source(), vertices, turned)
    assert not one_sided.matched.any()
    assert len(one_sided.unmatched_pieces) == 1
    assert transfer_weights(*source(), vertices, turned, two_sided=True).matched.all()


def test_arrays_that_do_not_fit_are_all_named():
    vertices, faces, weights = source()
    bad = vertices.copy()
    bad[3] = np.nan
    with pytest.raises(BadInput, match="not finite") as caught:
        transfer_weights(bad, faces, weights[:-1], vertices, faces)
    assert len(caught.value.faults) == 2
