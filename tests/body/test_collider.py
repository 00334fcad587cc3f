import ipctk
import numpy as np

from tasks.body.collider import decimate
from tasks.geometry.distances import closest_points
from tasks.geometry.meshes import boundary_edges, edges, submesh


def test_it_is_closed_light_and_near_the_skin(model):
    collider = decimate(model, 6000)
    assert len(collider.faces) == 6000
    assert len(boundary_edges(collider.faces)) == 0
    mesh = ipctk.CollisionMesh(np.asfortranarray(collider.rest), edges(collider.faces), collider.faces)
    assert not ipctk.has_intersections(mesh, np.asfortranarray(collider.rest))
    _, kept = submesh(model.faces, model.skin)
    away = closest_points(model.template[kept], collider.rest, collider.faces).distance
    assert away.mean() < 0.001
    assert away.max() < 0.006


def test_posed_it_stays_near_the_posed_skin(model):
    rng = np.random.default_rng(0)
    posed = model.pose(np.zeros(10), np.zeros(10), rng.normal(0, 0.15, (55, 3)), rng.normal(size=3))
    collider = decimate(model, 6000)
    skin, kept = submesh(model.faces, model.skin)
    away = closest_points(collider.posed(posed.transforms), posed.vertices[kept], skin).distance
    assert away.mean() < 0.001
    assert away.max() < 0.006
    assert closest_points(collider.rest, posed.vertices[kept], skin).distance.mean() > 0.05
