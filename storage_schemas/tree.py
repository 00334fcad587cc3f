"""Files below a folder and their digests, without a `Path` per file: a plan asks for every file of every artifact and recording there is.

Others publish and remove while a folder is walked: what vanishes meanwhile is passed over.
"""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from stat import S_ISREG


def files_below(folder: Path | str) -> Iterator[tuple[str, os.DirEntry]]:
    """(path within the folder, entry) of every file, in the order of the paths' parts. Links to folders are not followed."""
    return ((within, entry) for within, entry in entries_below(folder) if entry.is_file())


def entries_below(folder: Path | str, above: str = "") -> Iterator[tuple[str, os.DirEntry]]:
    """(path within the folder, entry) of every file, folder and link, a folder before what it holds; `above` stands before each.

    Links to folders are not followed; a folder that cannot be listed, or is gone meanwhile, holds nothing.
    """
    try:
        with os.scandir(folder) as found:
            entries = sorted(found, key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        yield f"{above}{entry.name}", entry
        if entry.is_dir(follow_symlinks=False):
            yield from entries_below(entry.path, f"{above}{entry.name}/")


def stats(path: Path | str) -> Iterator[tuple[str, os.stat_result]]:
    """(path, status) of a file, or of a folder and all that is below it."""
    for name in (str(path), *(entry.path for _, entry in entries_below(path))):
        try:
            status = os.stat(name)  # noqa: PTH116
        except FileNotFoundError:
            continue
        yield name, status


def size_of(path: Path | str) -> int:
    """Bytes of a file, or of all files below a folder."""
    return sum(status.st_size for _, status in stats(path) if S_ISREG(status.st_mode))


def sha256_of(path: Path | str) -> str:
    """SHA-256 of a file's content, in hex."""
    with open(path, "rb") as file:  # noqa: PTH123
        return hashlib.file_digest(file, "sha256").hexdigest()
