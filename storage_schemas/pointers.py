"""`latest` and pins: the artifacts that somebody counts on. Small JSON files, replaced atomically.

`latest` of a stage is what `physavatar export` and the dataset's report begin with; a pin keeps an artifact, with a reason, for ever.
"""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from storage_schemas.durable import make_folders, replace_file
from storage_schemas.faults import Corrupt, Fault
from storage_schemas.layout import stage_folder
from storage_schemas.reference import Address, validate_key


class Latest(BaseModel):
    """The content of `.latest.json`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    digest: str


class Pin(BaseModel):
    """The content of `.pins/<key>.json`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    reason: str


def write_latest(root: Path, address: Address, digest: str) -> None:
    """Points `latest` of the address's stage at it."""
    replace_file(_latest_file(stage_folder(root, address)), Latest(key=address.key, digest=digest).model_dump_json().encode())


def read_latest(stage: Path) -> Latest | None:
    """What `latest` of a stage folder points at, if anything. Raises Corrupt."""
    path = _latest_file(stage)
    try:
        return Latest.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except ValidationError as broken:
        raise Corrupt(Fault(str(path), "is no pointer", "remove it and submit again")) from broken


def write_pin(root: Path, address: Address, reason: str) -> None:
    """Keeps an artifact and all its inputs from being swept."""
    path = _pins(stage_folder(root, address)) / f"{address.key}.json"
    make_folders(path.parent)
    replace_file(path, Pin(reason=reason).model_dump_json().encode())


def remove_pin(root: Path, address: Address) -> None:
    """Lets go of a pinned artifact; fine if it was not pinned."""
    (_pins(stage_folder(root, address)) / f"{address.key}.json").unlink(missing_ok=True)


def pinned_keys(stage: Path) -> list[str]:
    """The pinned keys of a stage folder. The file's name says it all: a damaged pin still pins."""
    return sorted(validate_key(path.stem) for path in _pins(stage).glob("[0-9a-f]*.json"))


def _latest_file(stage: Path) -> Path:
    return stage / ".latest.json"


def _pins(stage: Path) -> Path:
    return stage / ".pins"
