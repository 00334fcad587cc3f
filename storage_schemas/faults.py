"""What the store refuses, each with the thing at fault, what was found and what to do about it."""

from __future__ import annotations

import errno
from dataclasses import dataclass
from pathlib import Path
from typing import Self


@dataclass(frozen=True)
class Fault:
    """One thing wrong: where it was found, what it is, and the remedy."""

    where: str
    what: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}; {self.remedy}"


class StoreFault(Exception):
    """Anything the store refuses; `faults` holds every finding, not only the first."""

    def __init__(self, *faults: Fault):
        super().__init__("\n".join(map(str, faults)))
        self.faults = faults

    def __reduce__(self) -> tuple:
        return (type(self), self.faults)  # a process that fails hands its faults to the one that asked


class BadName(StoreFault):
    """An actor, sequence, stage, key or file name that cannot be a single path component."""


class BadRecord(StoreFault, ValueError):
    """Values that do not fit their schema: unknown or missing fields, axes that disagree, dtype, index out of range."""


class Corrupt(StoreFault):
    """An artifact whose bytes are not those that were published: missing, cut, flipped or added files."""


class NewerFormat(StoreFault):
    """Data written by a newer physavatar than this one."""


class Leased(StoreFault):
    """Somebody else, alive, is computing this artifact."""


class DiskFull(StoreFault, OSError):
    """No space left; nothing was published and what had been written aside was removed."""

    def __init__(self, *faults: Fault):
        super().__init__(*faults)
        self.errno = errno.ENOSPC

    @classmethod
    def at(cls, root: Path, free: int, needed: int = 0) -> Self:
        """The fault of a store at `root` with `free` bytes left."""
        left = f"{free / 1e6:.1f} MB free" + (f", {needed / 1e6:.0f} MB needed to begin" if needed else "")
        return cls(Fault(str(root), f"no space left ({left})", "free space or run `physavatar artifacts gc`, then submit again"))
