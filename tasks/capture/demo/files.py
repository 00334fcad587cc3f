"""Files that are either whole or absent, and the list that says a recording is complete."""

import hashlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path

COMPLETE = "complete.json"


def write_whole(path: Path, write: bytes | Callable[[Path], None]) -> None:
    """Write aside in the same folder, then rename: a killed process leaves the old file or none. `write` is the content or writes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{os.getpid()}.{path.name}")
    if callable(write):
        write(aside)
    else:
        aside.write_bytes(write)
    aside.replace(path)


def write_json(path: Path, value: object) -> None:
    """Write a value as indented JSON with sorted keys."""
    write_whole(path, (json.dumps(value, indent=1, sort_keys=True) + "\n").encode())


def seal(seal_file: Path, folders: Mapping[str, Path]) -> None:
    """Record the digests of all files below named folders: {name: {path within: sha256}}."""
    write_json(seal_file, {name: digests(folder) for name, folder in folders.items()})


def altered(seal_file: Path, folders: Mapping[str, Path]) -> list[Path] | None:
    """Files that are gone or differ from the seal; None where there is no seal."""
    if not seal_file.exists():
        return None
    listed = json.loads(seal_file.read_text())
    named = {folders[name] / path: digest for name, files in listed.items() for path, digest in files.items()}
    return [path for path, digest in named.items() if not path.is_file() or _digest(path) != digest]


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every finished file below a folder, by path within it; the seal itself and files being written are left out."""
    found = (p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != COMPLETE and not p.name.startswith("."))
    return {p.relative_to(folder).as_posix(): _digest(p) for p in found}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
