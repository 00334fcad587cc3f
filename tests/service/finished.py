"""Thousands of finished sequences of the avatar's own line, without computing any: artifacts of the archive under the keys they would have.

Every sequence has a recording of its own (twenty files, hard links) and its own folders in the store; the artifacts behind its keys are
links to one set of files.
"""

import hashlib
import os
import time
from pathlib import Path
from typing import Any

from flows.config import Settings
from flows.dataset import Sequence
from flows.pipeline import AVATAR
from flows.service.order import Service
from storage_schemas.provenance import Provenance
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from tasks.stage import Stage

ARCHIVES = Path(__file__).parents[1] / "archives"
FILES = 20


def finished_sequences(place: Path, n: int) -> tuple[Service, Any]:
    """Make them below `place`; the service and the settings under which they are finished."""
    settings = Settings(store=place / "store", data=place / "data")
    service = Service(AVATAR, Settings, lambda: settings)
    store = Store(settings.store)
    for k in range(n):
        _recording(settings.data / f"actor{k // 100:03d}" / f"take{k:05d}", settings.data / ".first")
    first = Sequence("actor000", "take00000", settings.data / "actor000" / "take00000")
    made = _stand_ins(place / "artifacts", service.request(first, settings, store), store)
    for k in range(n):
        for stage, folder in made.items():
            at = store.root / f"actor{k // 100:03d}" / f"take{k:05d}" / stage
            at.mkdir(parents=True, exist_ok=True)
            if not (at / folder.name).exists():
                (at / folder.name).symlink_to(folder)
    return service, settings


def _recording(folder: Path, first: Path) -> None:
    if not first.exists():
        first.mkdir(parents=True)
        past = time.time() - 3600
        for n in range(FILES):
            (first / f"{n:03d}.jpg").write_bytes(bytes([n]) * 64)
            os.utime(first / f"{n:03d}.jpg", (past, past))
    folder.mkdir(parents=True)
    for n in range(FILES):
        (folder / f"{n:03d}.jpg").hardlink_to(first / f"{n:03d}.jpg")


def _stand_ins(place: Path, request: Any, store: Store) -> dict[str, Path]:
    """Stage → the archive's artifact under the key that the stage would give it."""
    made: dict[str, Path] = {}

    def bring(stage: Stage, inputs: dict[str, ArtifactRef], done: dict[str, ArtifactRef]) -> ArtifactRef:
        key = stage.key(inputs, request.parameters(stage, done, store))
        folder = place / stage.name / key
        folder.parent.mkdir(parents=True)
        archived = _newest(stage.name)
        for file in [p for p in archived.rglob("*") if p.is_file()]:
            (folder / file.relative_to(archived)).parent.mkdir(parents=True, exist_ok=True)
            (folder / file.relative_to(archived)).write_bytes(file.read_bytes())
        provenance = Provenance(stage=stage.name, stage_version=stage.version)
        (folder / "provenance.json").write_text(provenance.model_dump_json())
        made[stage.name] = folder
        at = store.root / request.actor / request.sequence / stage.name
        at.mkdir(parents=True)
        (at / key).symlink_to(folder)
        digest = hashlib.sha256((folder / "manifest.json").read_bytes()).hexdigest()
        return ArtifactRef(actor=request.actor, sequence=request.sequence, stage=stage.name, key=key, store=str(store.root), digest=digest)

    request.line.walk("report", bring)
    return made


def _newest(stage: str) -> Path:
    """Its artifact in the last archive: a stage may be younger than the first ones."""
    found = ARCHIVES.glob(f"v*/archive/example/{stage}/*/manifest.json")
    return max(found, key=lambda manifest: int(manifest.relative_to(ARCHIVES).parts[0].removeprefix("v"))).parent
