"""Servers that a killed run left behind: Prefect's own ephemeral API is a child process that outlives a kill -9 of its parent.

What /proc tells of a process is bytes in whatever encoding: of one whose words are no UTF-8 nothing more is asked than of any other.
"""

import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

SERVER = "prefect.server.api.server:create_app"


def end_orphaned_servers(home: Path) -> int:
    """Stop ephemeral servers of this PREFECT_HOME whose parent is gone; how many there were. Linux only, elsewhere none are found."""
    ended = 0
    for pid in _servers():
        with suppress(OSError):  # another user's, whose environment is closed to us, or one that ended while we looked
            if _parent(pid) == 1 and _home(pid) == str(home):
                os.kill(pid, signal.SIGTERM)
                ended += 1
    return ended


def _servers() -> Iterator[int]:
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if SERVER in (entry / "cmdline").read_text(errors="replace").replace("\0", " "):
                yield int(entry.name)
        except OSError:
            continue  # it ended while we looked


def _parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(") ")[2].split()[1])


def _home(pid: int) -> str | None:
    for entry in os.fsdecode(Path(f"/proc/{pid}/environ").read_bytes()).split("\0"):
        name, _, value = entry.partition("=")
        if name == "PREFECT_HOME":
            return value
    return None
