"""A record as a zarr v3 group: one array per array field, everything else in the group's attributes.

* Arrays along `frame` are cut into chunks of 30 frames within shards of 300; others are one chunk.
* Every chunk carries a crc32c. In a sharded array it must stand among the *inner* codecs: zarr protects by itself only
  the shard's index, and a flipped bit in a shard would otherwise be read as data (measured with zarr 3.1.6 and 3.4.2).
* zarr 3.1 reads a missing chunk as zeros without a word. So empty chunks are written too, a folder is read as `Complete`,
  and the manifest names every file; whoever reads compares them before and after (`artifact.py`).

Group attributes: `schema`, `schema_version`, `fields` (names and JSON attributes; absent optional arrays are null).
Array attributes: `unit`. The axis names are zarr's `dimension_names`; an axis of fixed size has none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import zarr
from zarr.abc.store import ByteRequest
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore

from storage_schemas.faults import Corrupt, Fault, NewerFormat
from storage_schemas.fields import ArraySpec
from storage_schemas.record import Record

FRAMES_PER_CHUNK, CHUNKS_PER_SHARD = 30, 10


class Complete(LocalStore):
    """A folder in which everything that is asked for must be; raises FileNotFoundError."""

    async def get(self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None) -> Buffer:
        """The file, or that part of it."""
        found = await super().get(key, prototype, byte_range)
        if found is None:
            raise FileNotFoundError(f"{self.root / key} is gone")
        return found


def write_arrays(record: Record, path: Path) -> None:
    """Writes the group at `path`, which must not exist."""
    group = zarr.create_group(store=str(path), zarr_format=3, attributes=_attributes(record))
    for field, spec in record.arrays.items():
        if (values := getattr(record, field)) is not None:
            _write(group, field, spec, values)


def read_fields(schema: type[Record], path: Path, *, frames: slice | None = None) -> dict[str, Any]:
    """The stored fields, migrated to `schema`. `frames` reads that part of every array whose first axis is `frame`.

    Raises Corrupt, NewerFormat, and FileNotFoundError for what is gone.
    """
    folder = Complete(path, read_only=True)
    group = zarr.open_group(store=folder, mode="r", zarr_format=3)
    version = _stored_version(schema, group, path)
    names = sorted(metadata.parent.name for metadata in path.glob("*/zarr.json"))  # group.arrays() only warns of one that is gone
    stored = {name: zarr.open_array(store=folder, path=name, mode="r", zarr_format=3) for name in names}
    fields = cast("dict[str, Any]", group.attrs["fields"]) | {name: _read(array, path, frames) for name, array in stored.items()}
    if version < schema.schema_version:
        return schema.migrate(version, fields)
    if faults := [fault for name, array in stored.items() for fault in _metadata_faults(schema, name, array)]:
        raise Corrupt(*faults)
    return fields


def layout(spec: ArraySpec, shape: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...] | None]:
    """Chunk and shard (None: not sharded) of an array of this `shape`."""
    whole = tuple(max(size, 1) for size in shape)
    if spec.axes[0] != "frame":
        return whole, None
    chunk = min(FRAMES_PER_CHUNK, whole[0])
    return (chunk, *whole[1:]), (chunk * CHUNKS_PER_SHARD, *whole[1:])


def _attributes(record: Record) -> dict[str, Any]:
    not_attributes = {*record.arrays, record.files_field}
    fields = record.model_dump(mode="json", exclude=not_attributes - {None})
    absent = {field: None for field in record.arrays if getattr(record, field) is None}
    return {"schema": record.schema_name, "schema_version": record.schema_version, "fields": fields | absent}


def _write(group: zarr.Group, field: str, spec: ArraySpec, values: np.ndarray) -> None:
    chunks, shards = layout(spec, values.shape)
    array = group.create_array(
        name=field,
        shape=values.shape,
        dtype=values.dtype,
        chunks=chunks,
        shards=shards,
        compressors=[BloscCodec(typesize=spec.dtype.itemsize, cname="zstd", clevel=3, shuffle="shuffle"), Crc32cCodec()],
        dimension_names=[axis if isinstance(axis, str) else None for axis in spec.axes],
        attributes={"unit": spec.unit},
        chunk_key_encoding={"name": "default", "separator": "."},  # one folder per array to fsync, not one per axis
        config={"write_empty_chunks": True},
    )
    array[...] = values


def _read(array: zarr.Array, path: Path, frames: slice | None) -> np.ndarray:
    selection = frames if frames is not None and _axes(array)[0] == "frame" else ...
    try:
        return np.asarray(array[selection])
    except (ValueError, RuntimeError, OSError) as broken:  # crc32c, blosc, a short shard index
        where = f"{path}/{array.basename}"
        raise Corrupt(
            Fault(where, f"does not decode ({broken})", "run `physavatar artifacts verify`, remove the artifact, submit again")
        ) from broken


def _stored_version(schema: type[Record], group: zarr.Group, path: Path) -> int:
    name, version = group.attrs.get("schema"), group.attrs.get("schema_version")
    if name != schema.schema_name or not isinstance(version, int):
        raise Corrupt(
            Fault(str(path), f"holds schema {name!r} version {version!r}, not {schema.schema_name!r}", "open it with its own schema")
        )
    if version > schema.schema_version:
        what = f"{name} version {version} was written by a newer physavatar; this one reads up to {schema.schema_version}"
        raise NewerFormat(Fault(str(path), what, "upgrade physavatar on this machine"))
    return version


def _metadata_faults(schema: type[Record], name: str, array: zarr.Array) -> list[Fault]:
    spec = schema.arrays.get(name)
    if spec is None:
        return []  # the record itself refuses undeclared fields, by name
    stored = f"{' '.join(map(str, _axes(array)))}, {array.dtype.name}, {array.attrs.get('unit')}"
    if stored == str(spec):
        return []
    return [schema.fault(name, f"is stored as [{stored}]", f"the schema says [{spec}]: a changed schema needs a new version")]


def _axes(array: zarr.Array) -> tuple[int | str, ...]:
    names = getattr(array.metadata, "dimension_names", None) or (None,) * array.ndim
    return tuple(size if name is None else name for name, size in zip(names, array.shape, strict=True))
