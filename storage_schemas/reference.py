"""Names of artifacts: actor, sequence, stage and key, and the small reference that stages pass to one another.

Every name is one path component of letters, digits, `_`, `-` and `.`, and does not begin with a dot: no name can leave
its folder, and the store's own files (`.latest.json`, `.ckpt`, …) cannot be addressed as artifacts.
"""

from __future__ import annotations

import re

from pydantic import BaseModel, field_validator

from storage_schemas.faults import BadName, Fault

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
HEX = re.compile(r"[0-9a-f]{64}")


def name_faults(name: str, where: str) -> list[Fault]:
    """Why `name` cannot be one path component; empty when it can."""
    if NAME.fullmatch(name):
        return []
    return [Fault(where, f"{name!r} is not a name", "use up to 100 letters, digits, '_', '-', '.', not beginning with '.' or '-'")]


def validate_name(name: str, where: str) -> str:
    """`name` itself, or BadName."""
    if faults := name_faults(name, where):
        raise BadName(*faults)
    return name


def validate_key(key: str, where: str = "key") -> str:
    """`key` itself if it is a SHA-256 in hex, or BadName."""
    if not HEX.fullmatch(key):
        raise BadName(Fault(where, f"{key!r} is not a SHA-256 in hex", "take it from `artifact_key` or from `physavatar artifacts ls`"))
    return key


class Address(BaseModel, frozen=True, extra="forbid"):
    """Where an artifact lies within a store. Raises BadName."""

    actor: str
    sequence: str
    stage: str
    key: str

    @field_validator("actor", "sequence", "stage")
    @classmethod
    def _one_component(cls, name: str) -> str:
        return validate_name(name, "name")

    @field_validator("key")
    @classmethod
    def _hex(cls, key: str) -> str:
        return validate_key(key)

    def __str__(self) -> str:
        return f"{self.actor}/{self.sequence}/{self.stage}/{self.key}"


class ArtifactRef(Address, frozen=True):
    """What one stage hands to the next: an address, the store's folder, and the SHA-256 of the artifact's manifest.

    The digest is what is trusted. `store` says where the artifact was found and may be another path on another machine.
    """

    store: str
    digest: str

    @field_validator("digest")
    @classmethod
    def _digest(cls, digest: str) -> str:
        return validate_key(digest, "digest")

    @property
    def address(self) -> Address:
        """The reference without store and digest."""
        return Address(actor=self.actor, sequence=self.sequence, stage=self.stage, key=self.key)
