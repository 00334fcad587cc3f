"""Writing so that a crash leaves the old or the new, never a half: write aside, fsync, rename, fsync the folder."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from storage_schemas.faults import DiskFull

ASIDE = ".tmp-"
NO_SPACE = frozenset({errno.ENOSPC, errno.EDQUOT})


def write_file(path: Path, content: bytes, *, forced: bool = True) -> None:
    """Writes a new file and, unless told not to, forces it to the disk; not atomic."""
    with path.open("xb") as file:
        file.write(content)
        file.flush()
        if forced:
            os.fsync(file.fileno())


def replace_file(path: Path, content: bytes, *, forced: bool = True) -> None:
    """Atomically makes `path` hold `content`, whether or not it existed.

    forced False is for what can be made again and is recognised when it is damaged: no process ever sees a half, but a power failure may
    leave the old, the new, or an empty file. It saves two forced writes, some 10 ms.
    """
    aside = path.with_name(f"{ASIDE}{secrets.token_hex(8)}-{path.name}")
    try:
        write_file(aside, content, forced=forced)
        aside.replace(path)
    except BaseException:
        aside.unlink(missing_ok=True)
        raise
    if forced:
        sync_folder(path.parent)


def make_folders(path: Path) -> None:
    """`mkdir -p`, each new entry forced to the disk."""
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    path.mkdir(parents=True, exist_ok=True)
    for folder in missing:
        sync_folder(folder.parent)


def sync_tree(path: Path) -> None:
    """Forces every file and folder below `path` to the disk, and `path` itself."""
    for folder, _, files in os.walk(path):
        for name in files:
            _sync(Path(folder, name), os.O_RDONLY)
        sync_folder(Path(folder))


def sync_folder(path: Path) -> None:
    """Forces the entries of a folder to the disk."""
    _sync(path, os.O_RDONLY | os.O_DIRECTORY)


def rename_folder(source: Path, target: Path) -> bool:
    """Moves a folder without replacing anything; False when `target` is taken.

    rename(2) refuses to put a folder over one that is not empty, on every POSIX system and file system, so the
    Linux-only renameat2(RENAME_NOREPLACE) is not needed: what it would forbid besides, an empty target, holds nothing.
    """
    try:
        source.rename(target)
    except OSError as taken:
        if taken.errno in (errno.ENOTEMPTY, errno.EEXIST):
            return False
        raise
    sync_folder(target.parent)
    return True


def remove_tree(path: Path) -> None:
    """Removes a folder, and does not mind when another process is doing the same."""
    shutil.rmtree(path, ignore_errors=True)


@contextlib.contextmanager
def full_disk_explained(root: Path) -> Iterator[None]:
    """Turns ENOSPC and an exceeded quota into DiskFull."""
    try:
        yield
    except OSError as failed:
        if failed.errno in NO_SPACE and not isinstance(failed, DiskFull):
            raise DiskFull.at(root, shutil.disk_usage(root).free) from failed
        raise


def require_room(root: Path, least: int) -> None:
    """Raises DiskFull where fewer than `least` bytes are free."""
    free = shutil.disk_usage(root).free
    if free < least:
        raise DiskFull.at(root, free, needed=least)


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
