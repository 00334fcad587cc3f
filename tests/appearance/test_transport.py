"""Visibility and form factors against closed forms of radiative transfer (Howell's catalogue), and rays against an obvious caster."""

import numpy as np
import pytest

from tasks.appearance.radiosity import irradiance
from tasks.appearance.ray_tracer import RayTracer
from tasks.appearance.transport import cosine_directions, form_factors, trace_transport, visibility
from tests.appearance.stage_figure import dressed, lathe


def traced(vertices, faces, **options):
    return trace_transport(RayTracer(faces, len(vertices)), vertices, faces, **options)


def sphere(subdivisions=3):
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.asarray(ball.vertices), np.asarray(ball.faces, np.int32)


def disk(radius, height, *, rings=12, around=48):
    r = radius * np.linspace(1e-4, 1, rings)
    vertices, faces, _, _ = lathe(np.linspace(1, 0, rings), r, around)
    vertices[:, 1] = height
    return vertices, faces


def joined(*meshes):
    offset = np.cumsum([0] + [len(x) for x, _ in meshes])
    return np.concatenate([x for x, _ in meshes]), np.concatenate([f + o for (_, f), o in zip(meshes, offset, strict=False)])


def test_directions_are_unit_and_cosine_distributed():
    """E[cos θ] = ⅔, E[cos²θ] = ½, no direction below the surface, no bias around it."""
    n = np.array([[0, 0, 1.0], [0, 0, -1], [0.6, -0.8, 0]])
    d = cosine_directions(n, rays=1024, seed=0)
    np.testing.assert_allclose(np.linalg.norm(d, axis=2), 1, atol=1e-12)
    c = np.einsum("nrc,nc->nr", d, n)
    assert c.min() > 0
    np.testing.assert_allclose(c.mean(1), 2 / 3, atol=2e-3)
    np.testing.assert_allclose((c**2).mean(1), 1 / 2, atol=2e-3)
    np.testing.assert_allclose(d.mean(1), 2 / 3 * n, atol=5e-3)


def test_white_furnace_outside_a_convex_body_nothing_is_shadowed():
    vertices, faces = sphere()
    hits = traced(vertices, faces)
    V = visibility(hits)
    assert (V[: len(vertices)] == 1).all()
    assert (V[len(vertices) :] == 0).all()  # and inside there is no sky
    A = irradiance(hits, faces, np.ones((len(faces), 3)))
    assert (A[: len(vertices)] == 1).all()
    assert (A[len(vertices) :] == 0).all()


@pytest.mark.parametrize(("radius", "height"), [(1.0, 0.5), (0.5, 1.0)])
def test_a_coaxial_disk_fills_r2_over_r2_plus_h2(radius, height):
    """Differential element facing a disk of radius r at distance h: F = r²/(r² + h²) (Howell B-13)."""
    vertices, faces = joined(disk(0.02, 0.0), disk(radius, height))
    V = visibility(traced(vertices, faces, rays=1024))
    centre = np.arange(48 * 6)  # nodes within a centimetre of the axis
    up = centre if traced_normal(vertices, faces)[0] > 0 else centre + len(vertices)
    polygon = np.sin(2 * np.pi / 48) / (2 * np.pi / 48)  # the disk is a 48-gon
    np.testing.assert_allclose(1 - V[up].mean(), polygon * radius**2 / (polygon * radius**2 + height**2), atol=2e-3)


def traced_normal(vertices, faces):
    from tasks.geometry.meshes import vertex_normals

    return vertex_normals(vertices, faces)[:, 1]


@pytest.mark.parametrize("degrees", [40, 90, 130])
def test_an_infinite_wedge_hides_one_plus_cosine_over_two(degrees):
    """Anywhere on one wall of an infinite wedge of angle α the other wall fills (1 + cos α)/2 (crossed strings)."""
    α = np.deg2rad(degrees)
    s, z = np.meshgrid([0.0, 0.4, 0.5, 0.6, 1000.0], [-1000.0, -0.1, 0.0, 0.1, 1000.0])
    floor = np.stack([s, 0 * s, z], -1).reshape(-1, 3)
    wall = np.stack([s * np.cos(α), s * np.sin(α), z], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(4), np.arange(4))
    a = (5 * i + j).ravel()
    faces = np.concatenate([np.stack([a, a + 5, a + 6], 1), np.stack([a, a + 6, a + 1], 1)]).astype(np.int32)
    hits = traced(*joined((floor, faces), (wall, faces)), rays=4096)
    inside = 12 if traced_normal(floor, faces)[12] > 0 else 12 + 50  # the vertex half a metre from the edge
    np.testing.assert_allclose(1 - visibility(hits)[inside], (1 + np.cos(α)) / 2, atol=2e-3)


def test_lambert_sphere_over_a_black_plane():
    """A facet tilted by θ from the vertical of an infinite plane sees (1 + cos θ)/2 of the sky."""
    ball, ball_faces = sphere(2)
    plane = np.array([[-1.0, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]]) * 3000
    vertices, faces = joined((ball + np.array([0, 1.5, 0]), ball_faces), (plane, np.array([[0, 1, 2], [0, 2, 3]], np.int32)))
    V = visibility(traced(vertices, faces, rays=1024))[: len(ball)]
    np.testing.assert_allclose(V, (1 + ball[:, 1]) / 2, atol=0.02)
    np.testing.assert_allclose(V.mean(), 0.5, atol=2e-3)


def test_each_nodes_hemisphere_is_filled():
    vertices, faces, _, _ = dressed()
    faces = faces[::-1].copy()  # so that face 0 is one of the skirt's, and is met
    hits = traced(vertices, faces, rays=64)
    filled = np.asarray(form_factors(hits, len(faces)).sum(1)).ravel()
    np.testing.assert_allclose(filled + visibility(hits), 1, atol=1e-12)
    assert 0.1 < visibility(hits).mean() < 0.9


def first_hit_obvious(vertices, faces, origin, direction):
    """Möller & Trumbore 1997, face by face; returns 2·face + side or −1."""
    best, code = np.inf, -1
    for f, (a, b, c) in enumerate(vertices[faces]):
        A = np.stack([-direction, b - a, c - a], 1)
        if abs(np.linalg.det(A)) > 1e-14:
            d, β, γ = np.linalg.solve(A, origin - a)
            if 0 < d < best and β >= 0 and γ >= 0 and β + γ <= 1:
                best, code = d, 2 * f + int(np.cross(b - a, c - a) @ direction > 0)
    return code


def test_first_hits_are_those_of_an_obvious_caster():
    vertices, faces, _, _ = dressed()
    rng = np.random.default_rng(1)
    origin = rng.uniform([-0.4, 0, -0.4], [0.4, 1.7, 0.4], size=(40, 3))
    direction = rng.normal(size=(40, 3))
    tracer = RayTracer(faces, len(vertices))
    tracer.move(vertices)
    expected = [first_hit_obvious(vertices, faces, o, d) for o, d in zip(origin, direction, strict=True)]
    assert 5 < np.sum(np.array(expected) < 0) < 35
    np.testing.assert_array_equal(tracer.first_hits(origin, direction), expected)


def test_the_tracer_follows_the_mesh():
    """Negative control: rays that meet the figure miss it once it has walked away."""
    vertices, faces, _, _ = dressed()
    tracer = RayTracer(faces, len(vertices))
    origin, direction = np.array([[0, 0.8, 3.0]]), np.array([[0, 0, -1.0]])
    tracer.move(vertices)
    assert tracer.first_hits(origin, direction)[0] >= 0
    tracer.move(vertices + np.array([5.0, 0, 0]))
    assert tracer.first_hits(origin, direction)[0] == -1
