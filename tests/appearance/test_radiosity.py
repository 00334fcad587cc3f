"""Interreflection against the integrating sphere and against a dense linear solve."""

import numpy as np
import pytest

from tasks.appearance.radiosity import irradiance
from tasks.appearance.ray_tracer import RayTracer
from tasks.appearance.transport import form_factors, trace_transport, visibility
from tasks.geometry.meshes import face_areas
from tests.appearance.stage_figure import dressed
from tests.appearance.test_transport import sphere


@pytest.mark.parametrize("ρ", [0.3, 0.9])
def test_integrating_sphere(ρ):
    """Inside a sphere all points see each other alike, so with an opening of share q: A = q/(1 − ρ(1 − q))."""
    vertices, faces = sphere(3)
    kept = faces[~(vertices[faces][:, :, 2] > 0.7).all(1)]
    q = 1 - face_areas(vertices, kept).sum() / face_areas(vertices, faces).sum()
    hits = trace_transport(RayTracer(kept, len(vertices)), vertices, kept)
    A = irradiance(hits, kept, np.full((len(kept), 3), ρ))
    wall = len(vertices) + np.flatnonzero(vertices[:, 2] < 0.55)
    np.testing.assert_allclose(A[wall].mean(), q / (1 - ρ * (1 - q)), rtol=2e-3)
    assert A[wall].std() < 0.03 * A[wall].mean()


def test_the_fixed_point_solves_the_linear_system():
    """A = V + K diag(ρ) P A with P the mean over a face-side's three nodes, solved densely."""
    vertices, faces, _, _ = dressed()
    hits = trace_transport(RayTracer(faces, len(vertices)), vertices, faces, rays=64)
    ρ = np.random.default_rng(2).uniform(0.1, 0.9, size=(len(faces), 3))
    A = irradiance(hits, faces, ρ)
    P = np.zeros((2 * len(faces), len(hits)))
    for f, face in enumerate(faces):
        P[2 * f, face] = P[2 * f + 1, face + len(vertices)] = 1 / 3
    K = form_factors(hits, len(faces)).toarray()
    for c in range(3):
        expected = np.linalg.solve(np.eye(len(hits)) - K @ (np.repeat(ρ[:, c], 2)[:, None] * P), visibility(hits))
        np.testing.assert_allclose(A[:, c], expected, atol=1e-3)
    assert np.abs(A - visibility(hits)[:, None]).max() > 0.1  # interreflection matters here
