"""One cloth on several meshes of it sags alike, whatever its triangles."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.effects.effect import Subject
from tasks.effects.library import library
from tasks.effects.retriangulated import retriangulated
from tasks.geometry.meshes import boundary_edges
from tasks.simulator import NO_COLLIDER, Cloth, Fabric, Settings
from tests.simulator.scenes import run, sheet, sphere, still
from tests.simulator.test_statics import equilateral

FAINT = Settings(integrator="backward_euler", substeps=1, gravity=(0, -1e-5, 0), acceleration_tolerance=1e-10, velocity_tolerance=0.0)


def grid(n, edge):
    """Right-angled triangles, all diagonals one way."""
    x, _ = sheet(n, n, length=(n - 1) * edge, width=(n - 1) * edge)
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = (corner.ravel() for corner in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    return x, np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)]).astype(np.int32)


def rough(rows, columns, edge):
    """Triangles of many shapes."""
    x, faces = equilateral(rows, columns, edge)
    x[:, [0, 2]] += 0.12 * edge * np.random.default_rng(0).standard_normal((len(x), 2))
    return x, faces


MESHES = {"equilateral": equilateral(14, 12, 0.03), "grid": grid(12, 0.03), "rough": rough(14, 12, 0.03)}


def held(x, faces):
    """A subject whose whole edge is driven."""
    cloth = Cloth(x, faces, np.unique(boundary_edges(faces)).astype(np.int32))
    return Subject(cloth, Fabric(bending=200.0), NO_COLLIDER, np.full(len(x), "free"), 25.0)


def sag(subject):
    """Mean fall [m] of all vertices at rest, in so little gravity that stretch plays no part."""
    ends = run(subject.cloth, subject.fabric, still(12, subject.cloth), fps=0.01, settings=FAINT)
    return -ends[-1].x[:, 1] @ subject.cloth.vertex_areas / subject.cloth.vertex_areas.sum()


@pytest.mark.parametrize("way", ["numerics_mesh", "numerics_triangulation"])
@pytest.mark.parametrize("mesh", MESHES)
def test_in_other_triangles_cloth_sags_as_much(mesh, way):
    given = held(*MESHES[mesh])
    other = library()[way].subject(given, [1.0])
    assert sag(other) == pytest.approx(sag(given), rel=0.05)


def test_with_the_same_constant_it_would_not():
    off = {}
    for name, mesh in MESHES.items():
        given = held(*mesh)
        finer = library()["numerics_mesh"].subject(given, [1.0])
        off[name] = sag(replace(finer, fabric=given.fabric)) / sag(given)
    assert off["equilateral"] < 0.85 and off["grid"] > 1.5, off


def test_there_and_back_is_the_same_fabric():
    given = held(*MESHES["rough"])
    other = library()["numerics_triangulation"].subject(given, [1.0])
    back = retriangulated(other, given.cloth)
    assert other.fabric.bending != pytest.approx(given.fabric.bending, rel=0.1)
    assert back.fabric.bending == pytest.approx(given.fabric.bending, rel=1e-9)
    assert replace(back.fabric, bending=0.0) == replace(given.fabric, bending=0.0)


@pytest.mark.parametrize("way", ["numerics_mesh", "numerics_triangulation"])
def test_a_ribbon_without_inner_vertices_keeps_its_constant(way):
    cloth = Cloth(*sheet(9, 2, length=0.4, width=0.03), np.arange(2))
    given = Subject(cloth, Fabric(bending=3.0), NO_COLLIDER, np.full(len(cloth.x_rest), "free", "<U7"), 25.0)
    other = library()[way].subject(given, [1.0])
    assert other.fabric == given.fabric and not np.array_equal(other.cloth.faces, cloth.faces)


def test_closed_cloth_is_held_somewhere():
    subjects = [Subject(Cloth(*sphere(k, 0.2)), Fabric(), NO_COLLIDER, np.full(1, "free"), 25.0) for k in (2, 3)]
    there = retriangulated(subjects[0], subjects[1].cloth)
    assert there.fabric.bending == pytest.approx(subjects[0].fabric.bending, rel=0.1)
