"""Sweeping a store: removes what nobody counts on, and never anything that somebody does.

Kept: what `latest` or a pin names; what was published, or asked for with `find`, less than `older_than` ago; and all
inputs of these, through their provenance, however old. Folders `.tmp-…` go as soon as their writer's lease is dead, never
by age alone. Checkpoints go when nobody computes on them and they are older than `older_than`.
If the provenance of anything kept cannot be read, its inputs are unknown and nothing is swept.
"""

from __future__ import annotations

import time
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from stat import S_ISREG

from pydantic import BaseModel, ConfigDict

from storage_schemas.artifact import read_provenance
from storage_schemas.durable import ASIDE, remove_tree
from storage_schemas.layout import addresses, artifact_folder, aside_lease_file, lease_file, new_aside, stage_folders
from storage_schemas.lease import is_live
from storage_schemas.manifest import MANIFEST
from storage_schemas.pointers import pinned_keys, read_latest
from storage_schemas.reference import Address
from storage_schemas.tree import size_of, stats


class Swept(BaseModel):
    """What a sweep removed, or would remove: paths below the store's root, and their size together in bytes."""

    model_config = ConfigDict(frozen=True)

    artifacts: tuple[str, ...]
    left_overs: tuple[str, ...]
    bytes: int


def sweep(root: Path, *, older_than: timedelta, dry_run: bool) -> Swept:
    """Marks and sweeps. Raises Corrupt, with nothing removed, when the provenance of something kept is unreadable."""
    before = time.time() - older_than.total_seconds()
    kept = _marked(root, before)
    artifacts = [artifact_folder(root, address) for address in addresses(root) if address not in kept]
    left_overs = [path for stage in stage_folders(root) for path in _left_overs(stage, before)]
    size = sum(map(size_of, artifacts + left_overs))
    if not dry_run:
        for folder in artifacts:
            _remove_artifact(folder, before)
        for path in left_overs:
            _remove(path)
    return Swept(
        artifacts=tuple(path.relative_to(root).as_posix() for path in artifacts),
        left_overs=tuple(path.relative_to(root).as_posix() for path in left_overs),
        bytes=size,
    )


def touch(folder: Path) -> None:
    """Notes that somebody asked for the artifact in `folder`."""
    (folder / MANIFEST).touch()


def _marked(root: Path, before: float) -> set[Address]:
    marked: set[Address] = set()
    frontier = {address for address in addresses(root) if _last_asked(artifact_folder(root, address)) >= before} | _counted_on(root)
    while frontier:
        address = frontier.pop()
        marked.add(address)
        folder = artifact_folder(root, address)
        if folder.exists():
            frontier |= {ref.address for ref in read_provenance(folder).inputs.values()} - marked
    return marked


def _counted_on(root: Path) -> set[Address]:
    named: set[Address] = set()
    for stage in stage_folders(root):
        latest = read_latest(stage)
        keys = pinned_keys(stage) + ([latest.key] if latest else [])
        actor, sequence, name = stage.relative_to(root).parts
        named |= {Address(actor=actor, sequence=sequence, stage=name, key=key) for key in keys}
    return named


def _last_asked(folder: Path) -> float:
    try:
        return (folder / MANIFEST).stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _left_overs(stage: Path, before: float) -> list[Path]:
    asides = [path for path in stage.glob(f"{ASIDE}*") if path.is_dir() and not is_live(aside_lease_file(path))]
    torn = [Path(name) for name, status in stats(stage) if S_ISREG(status.st_mode) and _is_torn(name) and status.st_mtime < before]
    checkpoints = [path for path in stage.glob(".ckpt/*") if not is_live(lease_file(stage, path.name)) and _newest(path) < before]
    return sorted(asides + torn + checkpoints)


def _remove_artifact(folder: Path, before: float) -> None:
    """Out of sight in one step, so that nobody finds half an artifact; then removed at leisure."""
    if _last_asked(folder) < before:  # asked for since it was marked: somebody is about to use it
        aside = new_aside(folder.parent, "swept")
        with suppress(FileNotFoundError):  # retired meanwhile, or swept by another
            folder.rename(aside)
        remove_tree(aside)


def _remove(path: Path) -> None:
    if path.is_dir():
        remove_tree(path)
        aside_lease_file(path).unlink(missing_ok=True)  # its owner is dead, and no other folder ever has this name
    else:
        path.unlink(missing_ok=True)


def _is_torn(name: str) -> bool:
    return Path(name).name.startswith(ASIDE)


def _newest(folder: Path) -> float:
    return max((status.st_mtime for _, status in stats(folder)), default=0.0)
