"""SHA-256 of files and folders by content, remembered for as long as names, sizes and times of change stay the same.

A recording of hundreds of gigabytes is read once, not at every look whether its results are in the store. What changed within the last
two seconds is not remembered: it could change again within the clock's tick and look the same.

A folder behind a link belongs to the content, for whoever reads the recording reads it too; the digest is that of a copy with the links
resolved. A link back to a folder that holds it adds nothing.
"""

import hashlib
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

from storage_schemas.tree import entries_below, sha256_of
from tasks.geometry.faults import BadInput, Fault

SETTLED_S = 2.0


def content_digest(path: Path) -> str:
    """SHA-256 of a file, or of the names and contents of all files below a folder. Raises BadInput where there is neither."""
    if not path.exists():
        raise BadInput([Fault(str(path), "no such file or folder", "Correct the path, or leave the setting out.")])
    signature, newest = _signature(path)
    memory = _memory(path)
    if (known := _recall(memory, signature)) is not None:
        return known
    digest = _digest(path)
    if time.time() - newest > SETTLED_S and _signature(path)[0] == signature:
        _remember(memory, signature, digest)
    return digest


def _digest(path: Path) -> str:
    if not path.is_dir():
        return sha256_of(path)
    tree = hashlib.sha256()
    for within, entry in _files(path):
        tree.update(f"{within}\0{sha256_of(entry.path)}\n".encode())
    return tree.hexdigest()


def _signature(path: Path) -> tuple[str, float]:
    """Names, sizes and times of everything below, as one digest; and the newest time."""
    seen, newest = hashlib.sha256(), 0.0
    for name, stat in _stats(path):
        seen.update(f"{name}\0{stat.st_size}\0{stat.st_mtime_ns}\0{stat.st_ino}\n".encode())
        newest = max(newest, stat.st_mtime)
    return seen.hexdigest(), newest


def _stats(path: Path) -> Iterator[tuple[str, os.stat_result]]:
    if path.is_dir():
        yield from ((within, entry.stat()) for within, entry in _files(path))
    else:
        yield "", path.stat()


def _files(folder: Path | str, above: str = "", came_by: tuple[str, ...] = ()) -> Iterator[tuple[str, os.DirEntry]]:
    """As `files_below`, also behind links to folders; `came_by`: where the links that led here truly lie."""
    for within, entry in entries_below(folder):
        if entry.is_file():
            yield f"{above}{within}", entry
        elif entry.is_symlink() and entry.is_dir():
            lies = (*came_by, os.path.realpath(os.path.dirname(entry.path)))  # noqa: PTH120
            if not any(_holds(os.path.realpath(entry.path), at) for at in lies):
                yield from _files(entry.path, f"{above}{within}/", lies)


def _holds(folder: str, place: str) -> bool:
    return Path(place).is_relative_to(folder)


def _memory(path: Path) -> Path:
    cache = Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser()
    name = hashlib.sha256(str(path.resolve()).encode()).hexdigest()
    return cache / "digests" / name[:2] / f"{name}.json"


def _recall(memory: Path, signature: str) -> str | None:
    try:
        known = json.loads(memory.read_text())
    except (OSError, ValueError):
        return None
    return known.get("digest") if known.get("signature") == signature else None


def _remember(memory: Path, signature: str, digest: str) -> None:
    aside = memory.with_suffix(f".{os.getpid()}.tmp")
    try:
        memory.parent.mkdir(parents=True, exist_ok=True)
        aside.write_text(json.dumps({"signature": signature, "digest": digest}))
        aside.replace(memory)
    except OSError:  # a read-only home: the digest is computed again next time
        aside.unlink(missing_ok=True)
