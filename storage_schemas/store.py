"""The store: immutable artifacts, each under the key of everything that decided its content.

    store = Store(root)
    key = artifact_key(stage="body", stage_version=1, schema_version=Body.schema_version, parameters=…, inputs=…, weights=…)
    with store.lease("anna", "walk", "body", key):
        ref = store.find("anna", "walk", "body", key) or store.publish(body, actor="anna", …, provenance=Provenance(…))
    body = store.open(ref, Body)

The store is the source of truth: nobody else's record of what exists counts. `layout.py` says what lies where,
`publication.py` how an artifact comes to be, `sweep.py` how it goes.

This one lies on a POSIX file system; `object_store.py` keeps the same artifacts in an object store, which has no rename.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager, suppress
from datetime import timedelta
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict

from storage_schemas import pointers
from storage_schemas.artifact import open_artifact, read_provenance
from storage_schemas.durable import full_disk_explained, make_folders, remove_tree
from storage_schemas.faults import Corrupt, Fault, StoreFault
from storage_schemas.format import FILE, check_format
from storage_schemas.layout import addresses, artifact_folder, checkpoint_folder, lease_file, new_aside, stage_folder
from storage_schemas.lease import Lease, hold
from storage_schemas.manifest import Manifest
from storage_schemas.provenance import Provenance
from storage_schemas.publication import present_digest, publish
from storage_schemas.record import Record
from storage_schemas.reference import Address, ArtifactRef
from storage_schemas.sweep import Swept, sweep, touch
from storage_schemas.tree import size_of

R = TypeVar("R", bound=Record)
URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/")  # with one slash too: a `Path` of s3://bucket has no more


class Entry(BaseModel):
    """One line of a listing. `digest` and `schema_name` are None when the manifest cannot be read."""

    model_config = ConfigDict(frozen=True)

    address: Address
    digest: str | None
    schema_name: str | None
    schema_version: int | None
    bytes: int


class Store:
    """A folder of artifacts. A new or empty folder becomes a store; any other must be one. Raises NewerFormat, Corrupt, StoreFault.

    founds: False leaves the folder as it is, for those who only look: where it is no store (`is_founded`), nothing is found in it.
    """

    def __init__(self, root: Path | str, *, founds: bool = True):
        if URL.match(str(root)):
            raise StoreFault(Fault(str(root), "is a URL and no folder", "set PHYSAVATAR_STORE to it, or give it to `open_store` as text"))
        self.root = Path(root).resolve()
        with full_disk_explained(self.root):
            check_format(self.root, founds=founds)

    @property
    def location(self) -> str:
        """What names this store on every machine: a folder here, a URL for an object store."""
        return str(self.root)

    def is_founded(self) -> bool:
        """Whether there is a store at all."""
        return (self.root / FILE).exists()

    def publish(self, record: Record, *, actor: str, sequence: str, stage: str, key: str, provenance: Provenance) -> ArtifactRef:
        """Makes `record` the artifact of this key, or returns the sound one that is there already.

        Removes the key's checkpoint. Raises DiskFull with nothing left behind.
        """
        address = Address(actor=actor, sequence=sequence, stage=stage, key=key)
        with full_disk_explained(self.root):
            return self._ref(address, publish(self.root, record, provenance, address))

    def find(self, actor: str, sequence: str, stage: str, key: str) -> ArtifactRef | None:
        """The artifact of this key if every file is there at its size; None if it must be computed (again)."""
        address = Address(actor=actor, sequence=sequence, stage=stage, key=key)
        folder = self.folder(address)
        if (digest := present_digest(folder)) is None:
            return None
        with contextlib.suppress(OSError):  # a store mounted read-only is not swept either
            touch(folder)
        return self._ref(address, digest)

    def open(self, ref: ArtifactRef, schema: type[R], *, frames: slice | None = None) -> R:
        """The record behind `ref`, held to its manifest and schema. Raises Corrupt, NewerFormat, BadRecord.

        `frames` reads that part of every array whose first axis is `frame`. Older schema versions are migrated.
        """
        return open_artifact(schema, self.folder(ref), digest=ref.digest, frames=frames)

    def provenance(self, ref: Address) -> Provenance:
        """Where the artifact comes from. Raises Corrupt."""
        return read_provenance(self.folder(ref))

    def folder(self, address: Address) -> Path:
        """Where the artifact lies, for looking only."""
        return artifact_folder(self.root, address)

    def lease(
        self, actor: str, sequence: str, stage: str, key: str, *, seconds: float = 60.0, wait: float = 0.0
    ) -> AbstractContextManager[Lease]:
        """Held by one process at a time; tries for `wait` seconds, then raises Leased. Look with `find` once it is held."""
        address = Address(actor=actor, sequence=sequence, stage=stage, key=key)
        return hold(lease_file(stage_folder(self.root, address), key), seconds=seconds, wait=wait)

    def checkpoint_dir(self, actor: str, sequence: str, stage: str, key: str) -> Path:
        """A folder that outlives a killed computation of this key, until it publishes."""
        folder = checkpoint_folder(self.root, Address(actor=actor, sequence=sequence, stage=stage, key=key))
        make_folders(folder)
        return folder

    def latest(self, actor: str, sequence: str, stage: str) -> ArtifactRef | None:
        """What the stage last produced for this sequence; None if nothing."""
        somewhere = Address(actor=actor, sequence=sequence, stage=stage, key="0" * 64)
        found = pointers.read_latest(stage_folder(self.root, somewhere))
        return found and self._ref(somewhere.model_copy(update={"key": found.key}), found.digest)

    def set_latest(self, ref: ArtifactRef) -> None:
        """Points `latest` of the reference's stage at it; also after a hit in the store."""
        pointers.write_latest(self.root, ref, ref.digest)

    def pin(self, ref: Address, reason: str) -> None:
        """Keeps the artifact and all its inputs from being swept."""
        pointers.write_pin(self.root, ref, reason)

    def unpin(self, ref: Address) -> None:
        """Lets go of a pinned artifact."""
        pointers.remove_pin(self.root, ref)

    def list(self, actor: str | None = None, sequence: str | None = None, stage: str | None = None) -> Sequence[Entry]:
        """Every artifact, damaged ones included, sorted by address."""
        return [self._entry(address) for address in addresses(self.root, actor, sequence, stage)]

    def size(self) -> int:
        """Bytes of all artifacts together."""
        return sum(size_of(self.folder(at)) for at in addresses(self.root))

    def verify(self, ref: Address | None = None) -> Sequence[Fault]:
        """Reads every byte of one artifact, or of all; what is wrong, empty when all is as published."""
        wanted = addresses(self.root) if ref is None else [ref]
        return [fault for address in wanted for fault in self._faults(address)]

    def retire(self, ref: Address) -> None:
        """Removes one artifact, whole or not at all, so that its stage computes it anew. What refers to it stays and says so in `verify`."""
        aside = new_aside(stage_folder(self.root, ref), ref.key[:16])
        with suppress(FileNotFoundError):
            self.folder(ref).rename(aside)
        remove_tree(aside)

    def gc(self, *, older_than: timedelta, dry_run: bool) -> Swept:
        """Removes what nothing refers to; see `sweep.py`. Raises Corrupt with nothing removed."""
        return sweep(self.root, older_than=older_than, dry_run=dry_run)

    def _ref(self, address: Address, digest: str) -> ArtifactRef:
        where = address.model_dump(include=set(Address.model_fields))
        return ArtifactRef(store=str(self.root), digest=digest, **where)

    def _entry(self, address: Address) -> Entry:
        size = size_of(self.folder(address))
        try:
            manifest, digest = Manifest.read(self.folder(address))
        except Corrupt:
            return Entry(address=address, digest=None, schema_name=None, schema_version=None, bytes=size)
        return Entry(address=address, digest=digest, schema_name=manifest.schema_name, schema_version=manifest.schema_version, bytes=size)

    def _faults(self, address: Address) -> Sequence[Fault]:
        folder = self.folder(address)
        try:
            manifest, digest = Manifest.read(folder)
            inputs = read_provenance(folder).inputs
        except Corrupt as broken:
            return list(broken.faults)
        claimed = (
            [] if not isinstance(address, ArtifactRef) or address.digest == digest else [_other_digest(folder, digest, address.digest)]
        )
        missing = [_missing_input(folder, name, ref) for name, ref in inputs.items() if not self.folder(ref).exists()]
        return claimed + manifest.size_faults(folder) + manifest.content_faults(folder) + missing


def _other_digest(folder: Path, found: str, expected: str) -> Fault:
    return Fault(str(folder), f"has digest {found}, the reference says {expected}", "submit again what refers to it")


def _missing_input(folder: Path, name: str, ref: ArtifactRef) -> Fault:
    return Fault(str(folder), f"its input {name!r}, {ref.address}, is gone", "submit again, or restore it from a backup")
