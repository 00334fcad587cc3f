"""Where an artifact comes from: what went in, with which software, where, when, how long and what its stage noted.

Kept beside the manifest and outside it: two machines that compute the same bytes publish the same digest.
"""

from __future__ import annotations

import platform
import socket
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, JsonValue, model_validator

from storage_schemas.key import plain_json
from storage_schemas.reference import ArtifactRef

PACKAGES = ("physavatar", "numpy", "scipy", "torch", "numba", "ipctk", "mitsuba", "onnxruntime", "opencv-contrib-python-headless", "zarr")


RETIRED = frozenset({"image_digest", "attempts"})  # written until 2026-11-25, and never with anything but the default


def software_versions() -> dict[str, str]:
    """Python and the packages that decide numbers, as installed."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue  # an extra that this kind of worker does not carry
    return found


class Provenance(BaseModel):
    """`inputs` keep the inputs of an artifact alive when the store is swept."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    stage: str
    stage_version: int
    inputs: dict[str, ArtifactRef] = {}
    weights: dict[str, str] = {}
    parameters: Annotated[dict[str, JsonValue], BeforeValidator(plain_json)] = {}
    versions: dict[str, str] = Field(default_factory=software_versions)
    host: str = Field(default_factory=socket.gethostname)
    started: datetime = Field(default_factory=lambda: datetime.now(UTC))
    seconds: float = 0.0
    reasons: tuple[str, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _without_retired(cls, written: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in written.items() if name not in RETIRED}

    def finished(self) -> Self:
        """The same, with the seconds since `started`."""
        return self.model_copy(update={"seconds": (datetime.now(UTC) - self.started).total_seconds()})
