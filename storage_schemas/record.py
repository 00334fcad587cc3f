"""An artifact's schema: a frozen record of arrays, names, JSON attributes and files.

    class Keypoints(Record, name="keypoints", version=1):
        keypoints: np.ndarray = array("frame camera 133 2", "float32", "px")
        score: np.ndarray = array("frame camera 133", "float32", "1")
        camera_names: tuple[str, ...] = names("camera")
        detector: str

Checked whenever a record is made, by hand or by reading: every axis has one size, indices lie on their axis, names are
distinct, nothing undeclared is present, attributes have a JSON (numpy scalars and tuples do, NaN does not), and whatever
`faults` adds. Findings are reported together.
Arrays come out read-only; they may share memory with what was passed in.

Limit: a record lives in memory. `Store.open(..., frames=slice(a, b))` reads a part of a long one.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from storage_schemas.faults import BadRecord, Fault
from storage_schemas.fields import ArraySpec, FilesSpec, NamesSpec
from storage_schemas.key import plain_json
from storage_schemas.reference import name_faults


class Record(BaseModel):
    """What every artifact's schema derives from."""

    model_config = ConfigDict(frozen=True, extra="forbid", protected_namespaces=())

    schema_name: ClassVar[str]
    schema_version: ClassVar[int]
    arrays: ClassVar[dict[str, ArraySpec]]
    labels: ClassVar[dict[str, str]]
    files_field: ClassVar[str | None]

    def __init_subclass__(cls, *, name: str, version: int) -> None:
        cls.schema_name, cls.schema_version = name, version

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:  # once pydantic knows the fields
        declared = {field: _declaration(info) for field, info in cls.model_fields.items()}
        cls.arrays = {field: spec for field, spec in declared.items() if isinstance(spec, ArraySpec)}
        cls.labels = {field: spec.axis for field, spec in declared.items() if isinstance(spec, NamesSpec)}
        cls.files_field = next((field for field, spec in declared.items() if isinstance(spec, FilesSpec)), None)

    def __init__(self, **fields: Any):
        try:
            super().__init__(**_plain(type(self), fields))
        except ValidationError as refused:
            raise BadRecord(*(_as_fault(type(self), error) for error in refused.errors())) from None
        found = [*_axis_faults(self), *_index_faults(self), *_name_faults(self)]
        if found := found or self.faults():
            raise BadRecord(*found)

    def faults(self) -> list[Fault]:
        """What else the MUST sentences of this schema demand; empty when all is well. Axes and indices are sound by now."""
        return []

    @classmethod
    def migrate(cls, version: int, fields: dict[str, Any]) -> dict[str, Any]:
        """The fields of an older `version` as fields of this one. A schema with a history overrides this."""
        raise BadRecord(Fault(cls.__name__, f"version {version} has no migration to {cls.schema_version}", "add it to `migrate`"))

    @classmethod
    def fault(cls, field: str, what: str, remedy: str) -> Fault:
        """A fault of one field of this schema."""
        return Fault(f"{cls.__name__}.{field}", what, remedy)

    def sizes(self) -> dict[str, int]:
        """The size of every named axis."""
        return {axis: size for axis, (size, _) in _bound_axes(self).items()}

    def __eq__(self, other: object) -> bool:
        """Same schema, same values; NaN equals NaN."""
        if not isinstance(other, type(self)):
            return NotImplemented
        return all(_same(getattr(self, field), getattr(other, field)) for field in type(self).model_fields)

    __hash__ = None


def _declaration(info: FieldInfo) -> Any:
    return next((note for note in info.metadata if isinstance(note, ArraySpec | NamesSpec | FilesSpec)), None)


def _plain(schema: type[Record], fields: dict[str, Any]) -> dict[str, Any]:
    """Attributes as plain JSON, so that numpy scalars and tuples are welcome and NaN is not."""
    attributes = schema.model_fields.keys() - schema.arrays.keys() - {schema.files_field}
    return {field: plain_json(value, f"{schema.__name__}.{field}") if field in attributes else value for field, value in fields.items()}


def _as_fault(schema: type[Record], error: Any) -> Fault:
    field = ".".join(str(part) for part in error["loc"])
    match error["type"]:
        case "extra_forbidden":
            return schema.fault(field, "is not a field of this schema", f"use {', '.join(schema.model_fields)}")
        case "missing":
            return schema.fault(field, "is missing", "give it a value")
    declared = schema.arrays.get(str(error["loc"][0]))
    return schema.fault(
        field, error["msg"].removeprefix("Value error, "), f"the schema says [{declared}]" if declared else "mend the value"
    )


def _present_arrays(record: Record) -> list[tuple[str, ArraySpec, np.ndarray]]:
    return [(field, spec, array) for field, spec in record.arrays.items() if (array := getattr(record, field)) is not None]


def _axis_claims(record: Record) -> list[tuple[int | str, int, str]]:
    """(axis, size, field) for every place where a field states a size; names first, as they are counted by hand."""
    named = [(axis, len(getattr(record, field)), field) for field, axis in record.labels.items()]
    return named + [
        (axis, size, field) for field, spec, array in _present_arrays(record) for axis, size in zip(spec.axes, array.shape, strict=True)
    ]


def _bound_axes(record: Record) -> dict[str, tuple[int, str]]:
    """Axis name -> (size, the field that said so first)."""
    bound: dict[str, tuple[int, str]] = {}
    for axis, size, field in _axis_claims(record):
        if isinstance(axis, str):
            bound.setdefault(axis, (size, field))
    return bound


def _axis_faults(record: Record) -> list[Fault]:
    bound, found = _bound_axes(record), []
    for axis, size, field in _axis_claims(record):
        expected, witness = (axis, "the schema") if isinstance(axis, int) else bound[axis]
        if size != expected:
            what = f"axis '{axis}' has size {size}, expected {expected} as in {witness}"
            found.append(record.fault(field, what, "give both the same size"))
    return found


def _index_faults(record: Record) -> list[Fault]:
    bound, found = _bound_axes(record), []
    for field, spec, array in _present_arrays(record):
        if spec.indexed_axis is None or array.size == 0:
            continue
        count, witness = bound[spec.indexed_axis]
        low, high = int(array.min()), int(array.max())
        if low < 0 or high >= count:
            what = f"holds index {low if low < 0 else high}, but axis '{spec.indexed_axis}' has size {count} as in {witness}"
            found.append(record.fault(field, what, "indices start at 0 and stay below the size"))
    return found


def _name_faults(record: Record) -> list[Fault]:
    twice = [
        record.fault(field, f"the name {name!r} stands twice", "make the names distinct")
        for field in record.labels
        for name in sorted({name for name in getattr(record, field) if getattr(record, field).count(name) > 1})
    ]
    files = getattr(record, record.files_field) if record.files_field else {}
    return twice + [fault for name in files for fault in name_faults(name, f"{type(record).__name__}.{record.files_field}")]


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return type(one) is type(other) and one == other
