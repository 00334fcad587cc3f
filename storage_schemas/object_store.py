"""The store in an object store: S3 and what speaks like it. The same interface and the same artifacts; another way to publish.

    <prefix>/<actor>/<sequence>/<stage>/<key>/manifest.json           decides; put last, if none is there
                                              <digest>/…              the files, below the digest of the manifest that names them
                                       .latest.json  .lease/<key>.json

There is no rename, so nothing is moved: files go under the digest of their manifest, where two writers of equal content write equal bytes
and writers of different content do not meet; then `manifest.json` is put with If-None-Match. Whoever comes second takes the first one's.
A reader fetches the files into a local store, where they are checked as ever. A killed writer leaves files that no manifest names.

`root` is that local store: a cache that may be removed at any time, the place of checkpoints (a computation killed on one machine begins
anew on another), and of run records. Not here: pins and gc; let the bucket's life cycle rules remove what is old.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from typing import Any, TypeVar

import obstore
from obstore.exceptions import AlreadyExistsError, BaseError, PreconditionError
from obstore.store import from_url
from pydantic import ValidationError

from storage_schemas import object_lease
from storage_schemas.artifact import write_artifact
from storage_schemas.durable import make_folders, remove_tree, write_file
from storage_schemas.faults import Corrupt, Fault, StoreFault
from storage_schemas.layout import checkpoint_folder, new_aside, stage_folder
from storage_schemas.manifest import MANIFEST, PROVENANCE, Manifest
from storage_schemas.pointers import Latest
from storage_schemas.provenance import Provenance
from storage_schemas.publication import present_digest, put_in_place
from storage_schemas.record import Record
from storage_schemas.reference import HEX, NAME, Address, ArtifactRef
from storage_schemas.store import Entry, Store
from storage_schemas.sweep import Swept

R = TypeVar("R", bound=Record)
REMEDY = "retire it with `physavatar rerun`, or restore it from the bucket's versions"


class ObjectStore(Store):
    """Artifacts below `url`, such as s3://bucket/prefix; credentials and endpoint come from the environment (AWS_…)."""

    def __init__(self, url: str, *, cache: Path | None = None, **options: Any):
        self.url = url
        self.objects = from_url(url, **options)  # first: a URL of which nothing can be had leaves no cache
        folder = cache or Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser()
        super().__init__(folder / "objects" / hashlib.sha256(url.encode()).hexdigest()[:16])

    @property
    def location(self) -> str:
        """The URL."""
        return self.url

    def publish(self, record: Record, *, actor: str, sequence: str, stage: str, key: str, provenance: Provenance) -> ArtifactRef:
        """Uploads the files, then the manifest; returns the artifact that was first."""
        address = Address(actor=actor, sequence=sequence, stage=stage, key=key)
        aside = new_aside(stage_folder(self.root, address), key[:16])
        make_folders(aside.parent)
        try:
            write_artifact(record, provenance, aside)
            digest = Manifest.read(aside)[1]
            for path in sorted(p for p in aside.rglob("*") if p.is_file() and p.name != MANIFEST):
                obstore.put(self.objects, f"{address}/{digest}/{path.relative_to(aside).as_posix()}", path)
            self._put_manifest(address, (aside / MANIFEST).read_bytes())
        finally:
            remove_tree(aside)
        remove_tree(checkpoint_folder(self.root, address))
        return self._object_ref(address, self._digest(address))

    def find(self, actor: str, sequence: str, stage: str, key: str) -> ArtifactRef | None:
        """The artifact of this key if every object is there at its size."""
        address = Address(actor=actor, sequence=sequence, stage=stage, key=key)
        try:
            manifest, digest = self._manifest(address)
        except Corrupt:
            return None
        return None if self._size_faults(address, manifest, digest) else self._object_ref(address, digest)

    def open(self, ref: ArtifactRef, schema: type[R], *, frames: slice | None = None) -> R:
        """As ever, from a local copy of the objects."""
        self.folder(ref)
        return super().open(ref, schema, frames=frames)

    def provenance(self, ref: Address) -> Provenance:
        """Where the artifact comes from. Raises Corrupt."""
        name = f"{_address(ref)}/{self._digest(ref)}/{PROVENANCE}"
        try:
            return Provenance.model_validate_json(self._read(name))
        except (FileNotFoundError, ValidationError) as broken:
            raise Corrupt(Fault(name, "is missing or no provenance", REMEDY)) from broken

    def folder(self, address: Address) -> Path:
        """A local copy, fetched if need be. A sound one stays where it is: others may be reading it. Raises Corrupt."""
        target, digest = super().folder(address), self._digest(address)
        if present_digest(target) != digest:
            with self._fetched(address) as fresh:
                put_in_place(fresh, target, digest=Manifest.read(fresh)[1])
        return target

    def lease(
        self, actor: str, sequence: str, stage: str, key: str, *, seconds: float = 60.0, wait: float = 0.0
    ) -> AbstractContextManager[Any]:
        """Held by one process on any machine at a time."""
        address = Address(actor=actor, sequence=sequence, stage=stage, key=key)
        return object_lease.hold(self.objects, f"{_stage(address)}/.lease/{key}.json", seconds=seconds, wait=wait)

    def latest(self, actor: str, sequence: str, stage: str) -> ArtifactRef | None:
        """What the stage last produced for this sequence; None if nothing."""
        somewhere = Address(actor=actor, sequence=sequence, stage=stage, key="0" * 64)
        try:
            found = Latest.model_validate_json(self._read(f"{_stage(somewhere)}/.latest.json"))
        except FileNotFoundError:
            return None
        return self._object_ref(somewhere.model_copy(update={"key": found.key}), found.digest)

    def set_latest(self, ref: ArtifactRef) -> None:
        """Points `latest` of the reference's stage at it."""
        obstore.put(self.objects, f"{_stage(ref)}/.latest.json", Latest(key=ref.key, digest=ref.digest).model_dump_json().encode())

    def list(self, actor: str | None = None, sequence: str | None = None, stage: str | None = None) -> Sequence[Entry]:
        """Every artifact that has a manifest, sorted by address."""
        wanted = (actor, sequence, stage)
        return [self._object_entry(at) for at in self._addresses() if all(w in (None, h) for w, h in zip(wanted, _parts(at)))]

    def verify(self, ref: Address | None = None) -> Sequence[Fault]:
        """Fetches and reads every byte of one artifact, or of all."""
        faults: list[Fault] = []
        for address in self._addresses() if ref is None else [ref]:
            try:
                with self._fetched(address) as fresh:
                    faults += Manifest.read(fresh)[0].content_faults(fresh)
            except Corrupt as broken:
                faults += broken.faults
        return faults

    def size(self) -> int:
        """Bytes of all objects together."""
        return sum(meta["size"] for meta in self._objects(""))

    def retire(self, ref: Address) -> None:
        """The manifest first, then what it named."""
        for meta in sorted(self._objects(f"{_address(ref)}/"), key=lambda meta: not meta["path"].endswith(f"/{MANIFEST}")):
            with suppress(FileNotFoundError):
                obstore.delete(self.objects, meta["path"])
        remove_tree(super().folder(ref))

    def pin(self, ref: Address, reason: str) -> None:
        """Not here."""
        raise _unsupported(self.url)

    def unpin(self, ref: Address) -> None:
        """Not here."""
        raise _unsupported(self.url)

    def gc(self, *, older_than: timedelta, dry_run: bool) -> Swept:
        """Not here."""
        raise _unsupported(self.url)

    @contextmanager
    def _fetched(self, address: Address) -> Iterator[Path]:
        """A new folder aside with everything the manifest names; removed in the end. Raises Corrupt."""
        aside = new_aside(super().folder(address).parent, "fetched")
        try:
            make_folders(aside)
            self._fetch(address, aside)
            yield aside
        finally:
            remove_tree(aside)

    def _fetch(self, address: Address, aside: Path) -> None:
        content = self._manifest_content(address)
        manifest, digest = _parsed(address, content)
        for name in [*manifest.files, PROVENANCE]:
            make_folders((aside / name).parent)
            try:
                write_file(aside / name, self._read(f"{_address(address)}/{digest}/{name}"))
            except FileNotFoundError as missing:
                raise Corrupt(Fault(f"{_address(address)}/{name}", "is missing", REMEDY)) from missing
        write_file(aside / MANIFEST, content)

    def _put_manifest(self, address: Address, content: bytes) -> None:
        name = f"{address}/{MANIFEST}"
        try:
            obstore.put(self.objects, name, content, mode="create")
        except AlreadyExistsError:
            manifest, digest = self._manifest(address)
            if self._size_faults(address, manifest, digest):  # damaged: ours replaces it, unless another healer was first
                with suppress(PreconditionError):
                    obstore.put(self.objects, name, content, mode={"e_tag": obstore.head(self.objects, name)["e_tag"]})

    def _manifest(self, address: Address) -> tuple[Manifest, str]:
        return _parsed(address, self._manifest_content(address))

    def _manifest_content(self, address: Address) -> bytes:
        name = f"{_address(address)}/{MANIFEST}"
        try:
            return self._read(name)
        except FileNotFoundError as missing:
            raise Corrupt(Fault(name, "is missing", REMEDY)) from missing

    def _digest(self, address: Address) -> str:
        return self._manifest(address)[1]

    def _size_faults(self, address: Address, manifest: Manifest, digest: str) -> list[Fault]:
        prefix = f"{_address(address)}/{digest}/"
        present = {meta["path"].removeprefix(prefix): meta["size"] for meta in self._objects(prefix)}
        wrong = [name for name, entry in manifest.files.items() if present.get(name) != entry.size]
        return [Fault(f"{prefix}{name}", "is missing or has another size than was published", REMEDY) for name in wrong]

    def _addresses(self) -> Iterator[Address]:
        for meta in sorted(self._objects(""), key=lambda meta: meta["path"]):
            parts = meta["path"].split("/")
            if len(parts) == 5 and parts[4] == MANIFEST and HEX.fullmatch(parts[3]) and all(NAME.fullmatch(part) for part in parts[:3]):
                yield Address(actor=parts[0], sequence=parts[1], stage=parts[2], key=parts[3])

    def _object_entry(self, address: Address) -> Entry:
        size = sum(meta["size"] for meta in self._objects(f"{address}/"))
        try:
            manifest, digest = self._manifest(address)
        except Corrupt:
            return Entry(address=address, digest=None, schema_name=None, schema_version=None, bytes=size)
        return Entry(address=address, digest=digest, schema_name=manifest.schema_name, schema_version=manifest.schema_version, bytes=size)

    def _objects(self, prefix: str) -> Iterator[Any]:
        return (meta for chunk in obstore.list(self.objects, prefix=prefix or None) for meta in chunk)

    def _read(self, name: str) -> bytes:
        return bytes(obstore.get(self.objects, name).bytes())

    def _object_ref(self, address: Address, digest: str) -> ArtifactRef:
        where = address.model_dump(include=set(Address.model_fields))
        return ArtifactRef(store=self.url, digest=digest, **where)


def open_store(location: Path | str, *, founds: bool = True) -> Store:
    """The store at a folder or at a URL, below which there is nothing to be founded. Raises StoreFault, whatever is wrong with the place."""
    try:
        return ObjectStore(str(location)) if "://" in str(location) else Store(location, founds=founds)
    except StoreFault:
        raise
    except (OSError, ValueError, BaseError) as failed:
        what = f"cannot be a store ({str(failed).splitlines()[0]})"
        raise StoreFault(Fault(str(location), what, "name a folder that can be written, or a URL such as s3://bucket/prefix")) from failed


def _parsed(address: Address, content: bytes) -> tuple[Manifest, str]:
    try:
        return Manifest.model_validate_json(content), hashlib.sha256(content).hexdigest()
    except ValidationError as broken:
        raise Corrupt(Fault(f"{_address(address)}/{MANIFEST}", "is no manifest", REMEDY)) from broken


def _address(at: Address) -> str:
    return "/".join((*_parts(at), at.key))


def _stage(at: Address) -> str:
    return "/".join(_parts(at))


def _parts(at: Address) -> tuple[str, str, str]:
    return at.actor, at.sequence, at.stage


def _unsupported(url: str) -> StoreFault:
    return StoreFault(Fault(url, "an object store is not swept from here", "use the bucket's life cycle rules"))
