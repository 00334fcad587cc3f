"""Publishing: an artifact appears whole, once, or not at all.

Written aside under a lease of its own, forced to the disk, then moved by a rename that never replaces. Whoever loses the
race throws its copy away. A kill -9 leaves at most a folder `.tmp-…` whose lease is dead, for the sweep to remove.
"""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

from storage_schemas.artifact import write_artifact
from storage_schemas.durable import make_folders, remove_tree, rename_folder, sync_tree
from storage_schemas.faults import Corrupt
from storage_schemas.layout import artifact_folder, aside_lease_file, checkpoint_folder, lease_file, new_aside, stage_folder
from storage_schemas.lease import hold
from storage_schemas.manifest import Manifest
from storage_schemas.provenance import Provenance
from storage_schemas.record import Record
from storage_schemas.reference import Address

WRITER_SECONDS = 60.0
STRAGGLER_TRIES, STRAGGLER_PAUSE = 40, 0.05  # 2 s at most


def publish(root: Path, record: Record, provenance: Provenance, address: Address) -> str:
    """The digest of the artifact now at `address`: ours, or a sound one that was there before us."""
    stage, target = stage_folder(root, address), artifact_folder(root, address)
    make_folders(stage)
    aside = new_aside(stage, address.key[:16])
    with hold(aside_lease_file(aside), seconds=WRITER_SECONDS):
        try:
            write_artifact(record, provenance, aside)
            sync_tree(aside)
            put_in_place(aside, target)
        except BaseException:
            _outlast_stragglers(aside)
            raise
        remove_tree(aside)
    remove_tree(checkpoint_folder(root, address))
    return Manifest.read(target)[1]


def put_in_place(aside: Path, target: Path, *, digest: str | None = None) -> None:
    """Moves `aside` to `target` unless a sound artifact, of this digest if one is given, lies there; any other is removed."""
    while not rename_folder(aside, target) and not _is_sound(target, digest):
        _set_aside(target, digest)


def _outlast_stragglers(aside: Path) -> None:
    """zarr writes chunks concurrently: when one fails, others are still under way and would bring a removed folder back."""
    absent = 0
    for _ in range(STRAGGLER_TRIES):
        absent = 0 if aside.exists() else absent + 1
        if absent == 3:
            return
        remove_tree(aside)
        time.sleep(STRAGGLER_PAUSE)


def present_digest(target: Path) -> str | None:
    """The digest of the artifact in `target` if it is there with every file at its size."""
    try:
        manifest, digest = Manifest.read(target)
    except Corrupt:
        return None
    return None if manifest.size_faults(target) else digest


def _is_sound(target: Path, digest: str | None) -> bool:
    found = present_digest(target)
    return found is not None and digest in (None, found)


def _set_aside(target: Path, digest: str | None) -> None:
    """Two may find the damage at once; under the lease the second sees that the first has mended it."""
    stage = target.parent
    with hold(lease_file(stage, f"mend-{target.name}"), seconds=WRITER_SECONDS, wait=WRITER_SECONDS):
        if not _is_sound(target, digest):
            damaged = new_aside(stage, "damaged")
            with contextlib.suppress(FileNotFoundError):
                target.rename(damaged)
            remove_tree(damaged)
