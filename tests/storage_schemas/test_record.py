"""A record refuses what its schema does not say, and says which field, which axis, what was expected and what was found."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from storage_schemas.catalogue import SCHEMAS
from storage_schemas.faults import BadRecord
from storage_schemas.fields import JsonDict, array, names
from storage_schemas.record import Record
from tests.storage_schemas.examples import SHA, examples, keypoints


class Mesh(Record, name="mesh", version=1):
    vertices: np.ndarray = array("frame vertex 3", "float32", "m")
    faces: np.ndarray = array("face 3", "int32", "vertex index")
    camera_names: tuple[str, ...] = names("camera")
    colour: np.ndarray | None = array("vertex 3", "float32", "1", default=None)
    notes: JsonDict = {}  # noqa: RUF012  pydantic copies it


def mesh(**changed) -> Mesh:
    fields = {"vertices": np.zeros((2, 4, 3), "float32"), "faces": np.array([[0, 1, 3]], "int32"), "camera_names": ("left", "right")}
    return Mesh(**(fields | changed))


def refused(**changed) -> str:
    with pytest.raises(BadRecord) as caught:
        mesh(**changed)
    return str(caught.value)


def test_a_sound_record_is_accepted():
    assert mesh().sizes() == {"camera": 2, "frame": 2, "vertex": 4, "face": 1}
    assert mesh().colour is None


def test_one_axis_has_one_size():
    said = refused(colour=np.zeros((5, 3), "float32"))
    assert said.startswith("Mesh.colour: axis 'vertex' has size 5, expected 4 as in vertices")


def test_an_integer_axis_is_its_size():
    assert "Mesh.faces: axis '3' has size 4, expected 3 as in the schema" in refused(faces=np.zeros((1, 4), "int32"))


def test_the_number_of_axes_counts():
    assert "Mesh.vertices: has shape (4, 3), but the schema says [frame vertex 3, float32, m]" in refused(
        vertices=np.zeros((4, 3), "float32")
    )


@pytest.mark.parametrize("index", [-1, 4])
def test_an_index_lies_on_its_axis(index):
    said = refused(faces=np.array([[0, 1, index]], "int32"))
    assert f"Mesh.faces: holds index {index}, but axis 'vertex' has size 4 as in vertices" in said


def test_unknown_and_missing_fields_are_refused():
    assert "Mesh.color: is not a field of this schema; use vertices, faces, camera_names, colour, notes" in refused(color=None)
    with pytest.raises(BadRecord, match=r"Mesh\.faces: is missing"):
        Mesh(vertices=np.zeros((2, 4, 3)), camera_names=("left",))


def test_all_faults_are_told_at_once():
    with pytest.raises(BadRecord) as caught:
        mesh(colour=np.zeros((5, 3), "float32"), faces=np.array([[0, 1, 9]], "int32"), camera_names=("left", "left"))
    assert [fault.where for fault in caught.value.faults] == ["Mesh.colour", "Mesh.faces", "Mesh.camera_names"]


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (np.zeros((2, 4, 3), "int64"), "is int64, but the schema says float32"),
        (np.zeros((2, 4, 3), "complex64"), "is complex64"),
        (np.full((2, 4, 3), 1e39), "holds 1e[+]39, which does not fit in float32"),
        ("text", "is <U4"),
        (None, "but the schema says float32"),
    ],
)
def test_values_change_kind_or_overflow_never(values, says):
    with pytest.raises(BadRecord, match=rf"Mesh\.vertices: .*{says}"):
        mesh(vertices=values)


def test_values_narrow_within_their_kind():
    narrowed = mesh(vertices=np.full((2, 4, 3), np.nan), faces=np.array([[0, 1, 3]], "uint64"))
    assert narrowed.vertices.dtype == np.float32
    assert narrowed.faces.dtype == np.int32
    assert "does not fit in int32" in refused(faces=np.array([[0, 1, 2**40]]))


def test_arrays_and_fields_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        mesh().vertices[0] = 1
    with pytest.raises(ValueError, match="frozen"):
        mesh().faces = np.zeros((1, 3), "int32")


def test_attributes_are_json():
    assert mesh(notes={"count": np.int64(3), "range": (0.5, np.float32(1))}).notes == {"count": 3, "range": [0.5, 1.0]}
    assert "Mesh.notes.loss[1]: nan has no JSON" in refused(notes={"loss": [1.0, float("nan")]})


def test_an_unknown_unit_is_refused_where_it_is_declared():
    with pytest.raises(TypeError, match="unit 'cm' is none of"):
        array("vertex 3", "float32", "cm")


@given(st.integers(1, 4), st.integers(1, 4))
def test_two_arrays_agree_on_an_axis_or_are_refused(vertices, colours):
    fields = {
        "vertices": np.zeros((1, vertices, 3), "float32"),
        "faces": np.zeros((0, 3), "int32"),
        "colour": np.zeros((colours, 3), "float32"),
    }
    if vertices == colours:
        assert mesh(**fields).sizes()["vertex"] == vertices
    else:
        assert "Mesh.colour: axis 'vertex'" in refused(**fields)


def test_equality_counts_nan_as_itself_and_sees_one_changed_number():
    one = keypoints()
    other = one.keypoints.copy()
    other[0, 0, 0, 0] += 1
    fields = {field: getattr(one, field) for field in type(one).model_fields}
    assert one == type(one)(**fields)
    assert one != type(one)(**(fields | {"keypoints": other}))
    assert examples()["appearance"] == examples()["appearance"]  # its psnr holds NaN


def changed(schema: str, **fields) -> str:
    record = examples()[schema]
    with pytest.raises(BadRecord) as caught:
        type(record)(**({field: getattr(record, field) for field in type(record).model_fields} | fields))
    return str(caught.value)


def test_every_schema_has_an_example():
    assert examples().keys() == SCHEMAS.keys()


@pytest.mark.parametrize(
    ("schema", "fields", "says"),
    [
        ("capture", {"R": np.tile(-np.eye(3), (2, 1, 1))}, "R: of camera left is no rotation"),
        ("capture", {"frame_numbers": np.array([10, 10, 13])}, "frame_numbers: do not increase"),
        ("capture", {"fps": 0.0}, "fps: is 0"),
        ("capture", {"fps": float("nan")}, "fps: nan has no JSON"),
        ("capture", {"up": "north"}, "up: is 'north'"),
        ("capture", {"mass_kg": -1.0}, "mass_kg: is -1"),
        ("capture", {"rgb": ("right.mp4",)}, "rgb: has 1 paths for 2 cameras"),
        ("capture", {"rgb": ("../left.mp4", "right.mp4")}, "rgb: '../left.mp4' leaves the recording"),
        ("capture", {"rgb": ("/left.mp4", "right.mp4")}, "rgb: '/left.mp4' leaves the recording"),
        ("capture", {"rgb": ("{x}.png", "right.mp4")}, "rgb: '{x}.png' has a place for something other than the frame"),
        ("capture", {"sha256": {"right.mp4": SHA}}, "sha256: lacks 4 files, the first is left/0010.png"),
        ("keypoints", {"score": np.full((3, 2, 133), np.nan)}, "score: holds NaN"),
        ("keypoints", {"keypoints": np.full((3, 2, 133, 2), np.nan)}, "keypoints: is NaN where the score is above 0"),
        ("body", {"weights": np.full((4, 55), 0.5)}, "weights: of 4 vertices .first 0, sum 27.5. are negative or do not sum to 1"),
        ("body", {"transforms": np.zeros((3, 55, 4, 4))}, "transforms: have a last row"),
        ("body", {"vertices": np.full((3, 4, 3), np.nan)}, "vertices: holds NaN"),
        ("body", {"scale": 0.0}, "scale: is 0"),
        (
            "tracking",
            {"seen": np.ones((3, 4), bool), "vertices": np.full((3, 4, 3), np.nan)},
            "vertices: is not finite where `seen` is true",
        ),
        ("tracking", {"part_names": ("body",)}, "part_of_face: holds index 1, but axis 'part' has size 1"),
        ("skinning", {"weights": np.eye(55)[:4] * 2 - np.eye(55)[1]}, "weights: of 3 vertices .first 0, sum 1"),
        ("cloth", {"parameters": {"hat": {}}}, "parameters: name garment 'hat'"),
        ("cloth", {"parameters": {"skirt": {"kappa": {"value": 1.0}}}}, "parameters"),
        ("cloth", {"vertices_index": np.array([-1, 0, 1])}, "vertices_index: holds a negative number"),
        ("report", {"files": {}}, "files: has no report.html"),
        ("report", {"files": {"report.html": b"", "../x": b""}}, "files: '../x' is not a name"),
    ],
)
def test_the_must_sentences_of_each_schema_are_enforced(schema, fields, says):
    assert re.search(rf"{SCHEMAS[schema].__name__}\.{says}", changed(schema, **fields))
