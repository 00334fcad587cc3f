"""The manifest: every file of an artifact with its size and SHA-256, and the schema it was written with.

It is written last and decides what the artifact is: its own SHA-256 is the artifact's digest, so no array is hashed
again downstream. Nothing in it depends on who computed the artifact, or when: equal content, equal digest.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict, ValidationError

from storage_schemas.faults import Corrupt, Fault
from storage_schemas.record import Record
from storage_schemas.tree import files_below, sha256_of

MANIFEST, PROVENANCE = "manifest.json", "provenance.json"
OUTSIDE = frozenset({MANIFEST, PROVENANCE})
REMEDY = "the artifact is not what was published: remove its folder and submit again"


class FileEntry(BaseModel):
    """Size in bytes and SHA-256 of one file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    size: int
    sha256: str


class Manifest(BaseModel):
    """What an artifact consists of. `files` maps a path within the artifact, with `/`, to its entry."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_name: str
    schema_version: int
    files: dict[str, FileEntry]

    @classmethod
    def of(cls, record: Record, folder: Path) -> Self:
        """The manifest of what lies in `folder`."""
        entries = {name: FileEntry(size=path.stat().st_size, sha256=sha256_of(path)) for name, path in files_in(folder).items()}
        return cls(schema_name=record.schema_name, schema_version=record.schema_version, files=entries)

    @classmethod
    def read(cls, folder: Path) -> tuple[Self, str]:
        """The manifest of the artifact in `folder` and its digest. Raises Corrupt."""
        path = folder / MANIFEST
        try:
            written = path.read_bytes()
            return cls.model_validate_json(written), hashlib.sha256(written).hexdigest()
        except OSError as missing:
            raise Corrupt(Fault(str(path), f"cannot be read ({missing.strerror})", REMEDY)) from missing
        except ValidationError as broken:
            raise Corrupt(Fault(str(path), f"is no manifest ({broken.error_count()} errors)", REMEDY)) from broken

    def size_faults(self, folder: Path) -> list[Fault]:
        """Files missing, added, or of another size. Costs one `stat` per file, and no `Path`: a plan asks this of every artifact there is."""
        try:
            found = {within: entry.stat().st_size for within, entry in files_below(folder) if within not in OUTSIDE}
        except FileNotFoundError as gone:
            return [Fault(str(folder), f"is being removed ({gone})", REMEDY)]
        faults = [Fault(str(folder / name), "is missing", REMEDY) for name in self.files.keys() - found.keys()]
        faults += [Fault(str(folder / name), "is not in the manifest", REMEDY) for name in found.keys() - self.files.keys()]
        for name in self.files.keys() & found.keys():
            if found[name] != self.files[name].size:
                faults.append(Fault(str(folder / name), f"has {found[name]} bytes, published with {self.files[name].size}", REMEDY))
        return sorted(faults, key=str)

    def content_faults(self, folder: Path, among: Callable[[str], bool] = lambda name: True) -> list[Fault]:
        """Files `among` the present ones whose SHA-256 is another than was published. Reads them whole."""
        present = files_in(folder)
        return [
            Fault(str(present[name]), "has another SHA-256 than was published", REMEDY)
            for name, entry in sorted(self.files.items())
            if name in present and among(name) and sha256_of(present[name]) != entry.sha256
        ]


def files_in(folder: Path) -> dict[str, Path]:
    """Every file of an artifact but manifest and provenance, by its path within the artifact, sorted."""
    found = {within: Path(entry.path) for within, entry in files_below(folder) if within not in OUTSIDE}
    return dict(sorted(found.items()))
