"""What a schema's fields may be: arrays with axes, dtype and unit; names of an axis; JSON; files.

    keypoints: np.ndarray = array("frame camera 133 2", "float32", "px")
    camera_names: tuple[str, ...] = names("camera")

* An axis name means one size in the whole record; an integer is that size. `names` binds its axis to its length.
* The unit "vertex index" says that the array holds indices along the axis `vertex`.
* A value is converted within its kind (float64 to float32, int64 to int32), never across kinds, and not when it would
  overflow: a mask of floats is not a mask, and 3e39 m is not infinitely far.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field, JsonValue
from pydantic_core import core_schema

UNITS = frozenset({"1", "px", "m", "mm", "rad", "s", "kg", "dB"})
INDEX_UNIT = re.compile(r"(\w+) index")


@dataclass(frozen=True)
class ArraySpec:
    """Axes, dtype and unit of one array field."""

    axes: tuple[int | str, ...]
    dtype: np.dtype
    unit: str

    @property
    def indexed_axis(self) -> str | None:
        """The axis this array holds indices of, if it holds indices."""
        found = INDEX_UNIT.fullmatch(self.unit)
        return found[1] if found else None

    def accept(self, value: Any) -> np.ndarray:
        """`value` as a read-only array of this dtype; ValueError says why not. May share memory with `value`."""
        values = np.asarray(value)
        if values.dtype != self.dtype:
            values = _converted(values, self.dtype)
        if values.ndim != len(self.axes):
            raise ValueError(f"has shape {values.shape}, but the schema says [{self}]")
        values = np.ascontiguousarray(values).view()
        values.flags.writeable = False
        return values

    def __str__(self) -> str:
        return f"{' '.join(map(str, self.axes))}, {self.dtype.name}, {self.unit}"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        accepted = core_schema.no_info_plain_validator_function(self.accept)
        return accepted if source is np.ndarray else core_schema.nullable_schema(accepted)


@dataclass(frozen=True)
class NamesSpec:
    """The axis that a field of names labels."""

    axis: str


@dataclass(frozen=True)
class FilesSpec:
    """Marks the field whose entries are stored as files."""


if TYPE_CHECKING:  # whoever reads it knows what its writer wrote
    Json = Any
    JsonList = list[Any]
    JsonDict = dict[str, Any]
else:
    Json = JsonValue
    JsonList = list[JsonValue]
    JsonDict = dict[str, JsonValue]


def array(axes: str, dtype: str, unit: str, **field: Any) -> Any:
    """Declares an array: `array("frame vertex 3", "float32", "m")`. Optional: annotate `np.ndarray | None`, give `default=None`."""
    if unit not in UNITS and not INDEX_UNIT.fullmatch(unit):
        raise TypeError(f"unit {unit!r} is none of {sorted(UNITS)} and not '<axis> index'")
    sizes = tuple(int(axis) if axis.isdigit() else axis for axis in axes.split())
    return _declared(ArraySpec(sizes, np.dtype(dtype), unit), **field)


def names(axis: str) -> Any:
    """Declares distinct strings that label an axis, stored as a JSON attribute."""
    return _declared(NamesSpec(axis))


def stored_files() -> Any:
    """Declares the one field whose entries, name -> content, are stored as files beside the arrays."""
    return _declared(FilesSpec())


def _declared(spec: Any, **field: Any) -> Any:
    info = Field(**field)
    info.metadata.append(spec)
    return info


def _converted(values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    kinds = {"i": "iu", "u": "iu"}.get(dtype.kind, dtype.kind)
    if values.dtype.kind not in kinds:
        raise ValueError(f"is {values.dtype}, but the schema says {dtype}: convert it where its meaning is known")
    with np.errstate(over="ignore", invalid="ignore"):
        converted = values.astype(dtype)
    lost = np.isinf(converted) & np.isfinite(values) if dtype.kind == "f" else converted != values
    if lost.any():
        raise ValueError(f"holds {values[lost].flat[0]}, which does not fit in {dtype}")
    return converted
