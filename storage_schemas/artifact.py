"""One artifact in its folder: written aside, checked, opened.

    data.zarr/       the arrays and attributes        manifest.json    what the artifact consists of
    files/           the files, if the schema has any  provenance.json  where it comes from

Before any array is trusted the manifest is compared with the folder: every file present, none added, every size right,
and the metadata (`zarr.json`) byte for byte. The content of chunks is guarded by their crc32c as they are read. All this is
compared once more afterwards: another process may have removed or replaced the artifact meanwhile.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from storage_schemas.arrays import read_fields, write_arrays
from storage_schemas.durable import write_file
from storage_schemas.faults import Corrupt, Fault
from storage_schemas.manifest import MANIFEST, PROVENANCE, REMEDY, Manifest
from storage_schemas.provenance import Provenance
from storage_schemas.record import Record

DATA, FILES = "data.zarr", "files"
METADATA = "zarr.json"
AGAIN = "another process removed it: submit again"

R = TypeVar("R", bound=Record)


def write_artifact(record: Record, provenance: Provenance, folder: Path) -> None:
    """Fills the new folder; the manifest comes last."""
    folder.mkdir()
    write_arrays(record, folder / DATA)
    if record.files_field:
        (folder / FILES).mkdir()
        for name, content in getattr(record, record.files_field).items():
            write_file(folder / FILES / name, content)
    write_file(folder / PROVENANCE, provenance.model_dump_json(indent=1).encode())
    write_file(folder / MANIFEST, Manifest.of(record, folder).model_dump_json(indent=1).encode())


def open_artifact(schema: type[R], folder: Path, *, digest: str, frames: slice | None = None) -> R:
    """The record in `folder`, whose manifest must have this digest. Raises Corrupt, NewerFormat, BadRecord."""
    try:
        manifest = checked_manifest(folder, digest=digest)
        fields = _read(schema, folder, manifest, frames)
        checked_manifest(folder, digest=digest)  # again: what vanishes while it is read must not pass for what is in it
    except FileNotFoundError as gone:
        raise Corrupt(Fault(str(folder), f"vanished while it was read ({gone})", AGAIN)) from gone
    return schema(**fields)


def checked_manifest(folder: Path, *, digest: str) -> Manifest:
    """The manifest, once names, sizes, metadata and plain files have been compared with it. Raises Corrupt."""
    manifest, found = Manifest.read(folder)
    if found != digest:
        raise Corrupt(Fault(str(folder / MANIFEST), f"has SHA-256 {found}, the reference says {digest}", REMEDY))
    faults = manifest.size_faults(folder) + manifest.content_faults(folder, lambda name: name.endswith(METADATA) or name.startswith(FILES))
    if faults:
        raise Corrupt(*faults)
    return manifest


def read_provenance(folder: Path) -> Provenance:
    """Where the artifact in `folder` comes from. Raises Corrupt."""
    path = folder / PROVENANCE
    try:
        return Provenance.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as broken:
        raise Corrupt(Fault(str(path), "is missing or no provenance", REMEDY)) from broken


def _read(schema: type[Record], folder: Path, manifest: Manifest, frames: slice | None) -> dict[str, Any]:
    fields = read_fields(schema, folder / DATA, frames=frames)
    stored = {name.removeprefix(f"{FILES}/"): folder / name for name in manifest.files if name.startswith(f"{FILES}/")}
    contents = {name: path.read_bytes() for name, path in stored.items()}
    if schema.files_field:
        fields[schema.files_field] = contents
    elif contents:
        raise Corrupt(Fault(str(folder / FILES), f"holds {', '.join(contents)}, but {schema.__name__} has no files", REMEDY))
    return fields
