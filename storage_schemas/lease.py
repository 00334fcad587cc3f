"""An expiring lease: one process at a time computes a given artifact.

A lease is a small file that names its owner and its hour of expiry. The owner's heartbeat extends it; it is free again
when released, when it expires, or, on the owner's own machine, as soon as the owner is dead: the process is gone, or its
number now belongs to a process that started at another time. Reading and replacing the file happen under an flock, so
two that find a stale lease cannot both take it.

Limits: machines that share a store must agree on the time to within a few seconds, and the file system must honour
flock (local disks, NFS 4). A compiled call that holds Python's lock for longer than the lease stops its heartbeat.
A lease saves work; it does not guard the data. That is done by the rename that never replaces.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import secrets
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from storage_schemas.durable import make_folders, replace_file
from storage_schemas.faults import Fault, Leased

HEARTBEATS_PER_LEASE = 4
POLL_SECONDS = 0.2


class Owner(BaseModel):
    """A process, so that another on the same machine can tell whether it lives. `token` tells two leases apart."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str
    machine: str
    pid: int
    started: int | None
    token: str

    @classmethod
    def this_process(cls) -> Owner:
        """The calling process, with a new token."""
        pid = os.getpid()
        return cls(host=socket.gethostname(), machine=_machine(), pid=pid, started=_start_time(pid), token=secrets.token_hex(8))

    def is_dead(self) -> bool:
        """True only when this machine can tell."""
        if self.machine != _machine():
            return False
        return not Path(f"/proc/{self.pid}").exists() if self.started is None else _start_time(self.pid) != self.started


class Held(BaseModel):
    """What a lease file says."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    owner: Owner
    expires: float

    def is_live(self) -> bool:
        """True while nobody else may take it."""
        return time.time() < self.expires and not self.owner.is_dead()


class Lease:
    """A lease in the hands of this process. Once it has expired and somebody else took it, it is left to them."""

    def __init__(self, path: Path, seconds: float):
        self.path, self.seconds = path, seconds
        self.owner = Owner.this_process()
        self._stop = threading.Event()
        self._heart = threading.Thread(target=self._beat, name=f"lease {path.name}", daemon=True)

    def take(self) -> Held | None:
        """Tries once; None on success, else what the present owner wrote."""
        with _alone(self.path):
            held = read_lease(self.path)
            if held is not None and held.is_live():
                return held
            self._write()
        self._heart.start()
        return None

    def release(self) -> None:
        """Stops the heartbeat and removes the file if it is still ours."""
        self._stop.set()
        self._heart.join()
        with _alone(self.path):
            if self._is_ours():
                self.path.unlink()

    def _beat(self) -> None:
        while not self._stop.wait(self.seconds / HEARTBEATS_PER_LEASE):
            with contextlib.suppress(OSError), _alone(self.path):  # a full disk: try again at the next beat
                if not self._is_ours():
                    return
                self._write()

    def _is_ours(self) -> bool:
        held = read_lease(self.path)
        return held is not None and held.owner == self.owner

    def _write(self) -> None:
        held = Held(owner=self.owner, expires=time.time() + self.seconds)
        replace_file(self.path, held.model_dump_json(indent=1).encode())


@contextlib.contextmanager
def hold(path: Path, *, seconds: float, wait: float = 0.0) -> Iterator[Lease]:
    """Holds the lease in file `path`; tries for `wait` seconds, then raises Leased."""
    make_folders(path.parent)
    lease, until = Lease(path, seconds), time.monotonic() + wait
    while (held := lease.take()) is not None:
        if time.monotonic() >= until:
            raise Leased(_taken(path, held))
        time.sleep(POLL_SECONDS)
    try:
        yield lease
    finally:
        lease.release()


def read_lease(path: Path) -> Held | None:
    """What the lease file says; None when there is none or it is damaged, for then nobody can renew it."""
    try:
        return Held.model_validate_json(path.read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


def is_live(path: Path) -> bool:
    """Whether somebody holds the lease in file `path`."""
    held = read_lease(path)
    return held is not None and held.is_live()


def _taken(path: Path, held: Held) -> Fault:
    left = max(held.expires - time.time(), 0.0)
    what = f"process {held.owner.pid} on {held.owner.host} is computing this (lease runs {left:.0f} s more)"
    return Fault(str(path), what, "wait for it, or stop that process: its lease then falls free")


@contextlib.contextmanager
def _alone(path: Path) -> Iterator[None]:
    """One process at a time reads and replaces leases in this folder."""
    descriptor = os.open(path.parent / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _machine() -> str:
    """This boot of this machine and this process namespace: within it, a process number means one process."""
    boot = Path("/proc/sys/kernel/random/boot_id")
    if not boot.exists():
        return socket.gethostname()
    return f"{boot.read_text().strip()} {Path('/proc/self/ns/pid').readlink()}"


def _start_time(pid: int) -> int | None:
    """Clock ticks from boot to the start of a process; None when there is no such process, or no /proc."""
    try:
        after_name = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if after_name[0] == "Z" else int(after_name[19])
