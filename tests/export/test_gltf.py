"""The file is read back by a reader that shares no code with the writer, and moved as a viewer would move it."""

import io

import numpy as np
import pygltflib
import pytest
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

from tasks.export.gltf import Garment, write_gltf
from tasks.geometry.faults import BadInput
from tests.export.avatars import FPS, avatar, skinned

TYPES = {5121: "u1", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


def array_of(gltf, number):
    accessor = gltf.accessors[number]
    view = gltf.bufferViews[accessor.bufferView]
    content = gltf.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    return np.frombuffer(content, TYPES[accessor.componentType]).reshape(accessor.count, WIDTH[accessor.type])


def channels(gltf):
    """(node, property) -> values at the frames."""
    (animation,) = gltf.animations
    return {(c.target.node, c.target.path): array_of(gltf, animation.samplers[c.sampler].output) for c in animation.channels}


def global_matrices(gltf, frame):
    moving, G = channels(gltf), {}

    def visit(number, parent):
        L = np.eye(4)
        L[:3, :3] = (
            Rotation.from_quat(moving[number, "rotation"][frame]).as_matrix() * moving.get((number, "scale"), np.ones((99, 3)))[frame]
        )
        L[:3, 3] = moving[number, "translation"][frame]
        G[number] = parent @ L
        for child in gltf.nodes[number].children or []:
            visit(child, G[number])

    visit(gltf.skins[0].skeleton, np.eye(4))
    return G


def node_named(gltf, name):
    return next(number for number, node in enumerate(gltf.nodes) if node.name == name)


def attributes_of(gltf, name):
    return gltf.meshes[gltf.nodes[node_named(gltf, name)].mesh].primitives[0]


def body_as_seen(gltf, frame):
    """Positions of the body's corners at a frame, from the file alone."""
    primitive = attributes_of(gltf, "body")
    G, B = global_matrices(gltf, frame), array_of(gltf, gltf.skins[0].inverseBindMatrices).reshape(-1, 4, 4).swapaxes(1, 2)
    x = array_of(gltf, primitive.attributes.POSITION)
    moved = np.zeros_like(x, dtype=float)
    for group in range(2):
        joints = getattr(primitive.attributes, f"JOINTS_{group}", None)
        if joints is None:
            continue
        for joint, weight in zip(
            array_of(gltf, joints).T, array_of(gltf, getattr(primitive.attributes, f"WEIGHTS_{group}")).T, strict=True
        ):
            M = np.stack([G[gltf.skins[0].joints[j]] @ B[j] for j in joint])
            moved += weight[:, None] * (np.einsum("vij,vj->vi", M[:, :3, :3], x) + M[:, :3, 3])
    return moved


def garment_as_seen(gltf, name, frame):
    primitive = attributes_of(gltf, name)
    weights = channels(gltf)[node_named(gltf, name), "weights"].reshape(-1, len(primitive.targets))[frame]
    x = array_of(gltf, primitive.attributes.POSITION).astype(float)
    return x + sum(w * array_of(gltf, target["POSITION"]) for w, target in zip(weights, primitive.targets, strict=True))


def corner_vertices(gltf, name, surface):
    """Which vertex of the welded surface each corner is, found by place at rest and texture coordinate."""
    primitive = attributes_of(gltf, name)
    faces = array_of(gltf, primitive.indices).reshape(-1, 3)
    uv = array_of(gltf, primitive.attributes.TEXCOORD_0) * [1, -1] + [0, 1]
    found = {}
    for vertex, texel in zip(surface.faces.ravel(), surface.uv_faces.ravel(), strict=True):
        found.setdefault(tuple(np.round(surface.uv_vertices[texel], 5)), vertex)
    return np.array([found[tuple(row)] for row in np.round(uv.astype(float), 5)]), faces


def written(path, a, **options):
    result = write_gltf(
        path / "avatar.glb", a.surface, skeleton=a.skeleton, weights=a.weights, transforms=a.transforms, fps=FPS,
        **({"texture": a.texture, "garments": [a.garment]} | options),
    )  # fmt: skip
    return result, pygltflib.GLTF2().load(str(result.path))


@pytest.mark.parametrize("scale", [1.0, 1.3])
def test_the_body_moves_as_linear_blend_skinning_says(tmp_path, scale):
    a = avatar(scale=scale)
    result, gltf = written(tmp_path, a)
    vertex, _ = corner_vertices(gltf, "body", a.surface)
    expected = skinned(a.weights, a.transforms, a.surface.vertices)
    assert result.dropped_weight == pytest.approx(0, abs=1e-12)  # six joints fit in eight
    for frame in range(len(a.transforms)):
        assert np.abs(body_as_seen(gltf, frame) - expected[frame, vertex]).max() < 1e-5
    assert np.abs(body_as_seen(gltf, 1) - expected[0, vertex]).max() > 0.1  # control: another frame is elsewhere


def test_the_joints_stand_where_the_transforms_take_them(tmp_path):
    """Skinning alone cannot tell: it is the same for any bind pose. Whoever hangs something on a joint can."""
    a = avatar(scale=1.3)
    _, gltf = written(tmp_path, a)
    for frame in range(len(a.transforms)):
        for joint, G in global_matrices(gltf, frame).items():
            assert np.abs(G[:3, 3] - (a.transforms[frame, joint] @ [*a.skeleton.joints[joint], 1])[:3]).max() < 1e-5
    at_rest = np.zeros((6, 3))
    for joint, parent in enumerate(a.skeleton.parents):
        at_rest[joint] = np.array(gltf.nodes[joint].translation) + (at_rest[parent] if joint else 0)
    assert np.abs(at_rest - a.skeleton.joints).max() < 1e-12


def test_four_influences_lose_what_they_say(tmp_path):
    a = avatar()
    result, gltf = written(tmp_path, a, influences=4)
    kept = np.where(a.weights >= np.sort(a.weights, axis=1)[:, [-4]], a.weights, 0)
    assert result.dropped_weight == pytest.approx((1 - kept.sum(axis=1)).max())
    vertex, _ = corner_vertices(gltf, "body", a.surface)
    expected = skinned(kept / kept.sum(axis=1, keepdims=True), a.transforms, a.surface.vertices)
    assert np.abs(body_as_seen(gltf, 2) - expected[2, vertex]).max() < 1e-5
    assert np.abs(body_as_seen(gltf, 2) - skinned(a.weights, a.transforms, a.surface.vertices)[2, vertex]).max() > 1e-3


def test_the_garment_stands_where_it_was_simulated(tmp_path):
    a = avatar()
    _, gltf = written(tmp_path, a)
    vertex, _ = corner_vertices(gltf, "skirt", a.surface)
    place = np.full(len(a.surface.vertices), -1)
    place[a.garment.index] = np.arange(len(a.garment.index))
    for frame in range(len(a.transforms)):
        assert np.abs(garment_as_seen(gltf, "skirt", frame) - a.garment.x[frame][place[vertex]]).max() < 1e-6


def test_every_face_is_in_the_file_once_and_keeps_its_texture(tmp_path):
    a = avatar()
    _, gltf = written(tmp_path, a)
    in_file = []
    for name in ("body", "skirt"):
        vertex, faces = corner_vertices(gltf, name, a.surface)
        in_file += [tuple(face) for face in vertex[faces]]
    assert sorted(in_file) == sorted(map(tuple, a.surface.faces))


def test_the_clock_runs_at_the_frame_rate(tmp_path):
    _, gltf = written(tmp_path, avatar(frames=7))
    times = array_of(gltf, gltf.animations[0].samplers[0].input)[:, 0]
    assert np.allclose(times, np.arange(7) / FPS)


def test_between_frames_a_joint_takes_the_short_way(tmp_path):
    _, gltf = written(tmp_path, avatar(frames=40))
    for (_, path), q in channels(gltf).items():
        if path == "rotation":
            assert ((q[1:] * q[:-1]).sum(axis=1) >= 0).all()


def test_the_texture_comes_back(tmp_path):
    a = avatar()
    _, gltf = written(tmp_path, a)
    view = gltf.bufferViews[gltf.images[0].bufferView]
    png = gltf.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(png))), a.texture)


def test_another_reader_finds_two_meshes_of_this_size(tmp_path):
    a = avatar()
    result, _ = written(tmp_path, a)
    scene = trimesh.load(result.path)
    assert sum(len(mesh.faces) for mesh in scene.geometry.values()) == len(a.surface.faces)
    assert len(scene.geometry) == 2


def test_a_surface_that_is_all_garment_has_no_body(tmp_path):
    a = avatar()
    everywhere = np.arange(len(a.surface.vertices))
    x = a.surface.vertices + np.random.default_rng(3).normal(scale=0.05, size=(len(a.transforms), len(everywhere), 3))
    result, gltf = written(tmp_path, a, garments=[Garment("skirt", everywhere, x)])
    assert [node.name for node in gltf.nodes if node.mesh is not None] == ["skirt"] and not gltf.skins
    (mesh,) = trimesh.load(result.path).geometry.values()
    assert len(mesh.faces) == len(a.surface.faces)
    vertex, _ = corner_vertices(gltf, "skirt", a.surface)
    assert np.abs(garment_as_seen(gltf, "skirt", 3) - x[3][vertex]).max() < 1e-6


def test_what_does_not_fit_is_refused_all_at_once(tmp_path):
    a = avatar()
    short = Garment("skirt", a.garment.index, a.garment.x[1:])
    with pytest.raises(BadInput) as caught:
        written(tmp_path, a._replace(weights=a.weights[1:]), garments=[short], influences=5)
    assert [fault.where for fault in caught.value.faults] == ["influences", "weights", "garment skirt"]
    sheared = a.transforms.copy()
    sheared[3, 2, 0, 1] += 0.2
    with pytest.raises(BadInput, match="frame 3, joint joint_2 is no similarity"):
        written(tmp_path, a._replace(transforms=sheared))
    assert not list(tmp_path.iterdir())
