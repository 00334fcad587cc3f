"""Files below a folder and their digests, without a `Path` per file: a plan asks for every file of every artifact and recording there is."""

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path


def files_below(folder: Path | str, above: str = "") -> Iterator[tuple[str, os.DirEntry]]:
    """(path within the folder, entry) of every file, in the order of the paths' parts; `above` stands before each.

    Links to folders are not followed; a folder that cannot be listed, or is gone meanwhile, has no files.
    """
    try:
        with os.scandir(folder) as found:
            entries = sorted(found, key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        if entry.is_dir(follow_symlinks=False):
            yield from files_below(entry.path, f"{above}{entry.name}/")
        elif entry.is_file():
            yield f"{above}{entry.name}", entry


def sha256_of(path: Path | str) -> str:
    """SHA-256 of a file's content, in hex."""
    with open(path, "rb") as file:  # noqa: PTH123
        return hashlib.file_digest(file, "sha256").hexdigest()
