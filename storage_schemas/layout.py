"""Where everything lies in a store; path arithmetic and listing, no content.

<root>/<actor>/<sequence>/<stage>/<key>/             one artifact (`artifact.py`)
                                  .latest.json       the artifact to show (`pointers.py`)
                                  .pins/<key>.json   kept when the store is swept (`pointers.py`)
                                  .lease/<name>.json who is computing or writing what (`lease.py`)
                                  .ckpt/<key>/       where an interrupted computation goes on
                                  .tmp-<name>/       being written or removed (`publication.py`, `sweep.py`)
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from pathlib import Path

from storage_schemas.durable import ASIDE
from storage_schemas.reference import HEX, NAME, Address


def stage_folder(root: Path, address: Address) -> Path:
    """Holds all artifacts of one stage for one sequence."""
    return root.joinpath(address.actor, address.sequence, address.stage)


def artifact_folder(root: Path, address: Address) -> Path:
    """Where the artifact is or will be."""
    return stage_folder(root, address) / address.key


def checkpoint_folder(root: Path, address: Address) -> Path:
    """Where an interrupted computation of this artifact leaves what it has."""
    return stage_folder(root, address) / ".ckpt" / address.key


def lease_file(stage: Path, name: str) -> Path:
    """The lease on a key of this stage folder."""
    return stage / ".lease" / f"{name}.json"


def aside_lease_file(aside: Path) -> Path:
    """The lease that the writer of a folder `.tmp-…` holds."""
    return lease_file(aside.parent, aside.name.removeprefix("."))


def new_aside(stage: Path, purpose: str) -> Path:
    """A fresh name for a folder on its way in or out."""
    return stage / f"{ASIDE}{purpose}-{secrets.token_hex(8)}"


def stage_folders(root: Path, actor: str | None = None, sequence: str | None = None, stage: str | None = None) -> Iterator[Path]:
    """Every stage folder, or those of the given actor, sequence and stage; sorted."""
    wanted = [part or "*" for part in (actor, sequence, stage)]
    for folder in sorted(root.glob("/".join(wanted))):
        if folder.is_dir() and all(NAME.fullmatch(part) for part in folder.relative_to(root).parts):
            yield folder


def address_of(folder: Path) -> Address:
    """The address of the artifact in `folder`."""
    actor, sequence, stage, key = folder.parts[-4:]
    return Address(actor=actor, sequence=sequence, stage=stage, key=key)


def addresses(root: Path, actor: str | None = None, sequence: str | None = None, stage: str | None = None) -> Iterator[Address]:
    """Every artifact present, damaged ones included; sorted."""
    for folder in stage_folders(root, actor, sequence, stage):
        for path in sorted(folder.iterdir()):
            if HEX.fullmatch(path.name) and path.is_dir():
                yield address_of(path)
