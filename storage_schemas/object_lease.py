"""A lease in an object store: an object that only one can create, and only its reader can replace.

`lease.py` says what a lease is. Here there is no flock: taking one is a put that fails if the object exists, or if it is no longer the
one that was read (If-None-Match, If-Match). An owner that is dead is noticed only by the expiry: machines do not share process numbers.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

import obstore
from obstore.exceptions import AlreadyExistsError, PreconditionError
from pydantic import ValidationError

from storage_schemas.faults import Fault, Leased
from storage_schemas.lease import HEARTBEATS_PER_LEASE, Held, Owner

POLL_SECONDS = 1.0
TAKEN = (AlreadyExistsError, PreconditionError)


class ObjectLease:
    """A lease in the hands of this process. Once it has expired and somebody else took it, it is left to them."""

    def __init__(self, objects: Any, name: str, seconds: float):
        self.objects, self.name, self.seconds = objects, name, seconds
        self.owner = Owner.this_process()
        self._tag: str | None = None
        self._stop = threading.Event()
        self._heart = threading.Thread(target=self._beat, name=f"lease {name}", daemon=True)

    def take(self) -> Held | None:
        """Tries once; None on success, else what the present owner wrote."""
        held, tag = read_lease(self.objects, self.name)
        if held is not None and held.expires > time.time():
            return held
        try:
            self._write("create" if tag is None else {"e_tag": tag})
        except TAKEN:
            return read_lease(self.objects, self.name)[0] or Held(owner=self.owner, expires=time.time())
        self._heart.start()
        return None

    def release(self) -> None:
        """Stops the heartbeat and removes the object if it is still ours."""
        self._stop.set()
        self._heart.join()
        held, _ = read_lease(self.objects, self.name)
        if held is not None and held.owner == self.owner:
            obstore.delete(self.objects, self.name)

    def _beat(self) -> None:
        while not self._stop.wait(self.seconds / HEARTBEATS_PER_LEASE):
            try:
                self._write({"e_tag": self._tag})
            except TAKEN:
                return
            except Exception:  # noqa: BLE001  the network is away: try again at the next beat
                continue

    def _write(self, mode: Any) -> None:
        content = Held(owner=self.owner, expires=time.time() + self.seconds).model_dump_json().encode()
        self._tag = obstore.put(self.objects, self.name, content, mode=mode)["e_tag"]


@contextlib.contextmanager
def hold(objects: Any, name: str, *, seconds: float, wait: float = 0.0) -> Iterator[ObjectLease]:
    """Holds the lease of this name; tries for `wait` seconds, then raises Leased."""
    lease, until = ObjectLease(objects, name, seconds), time.monotonic() + wait
    while (held := lease.take()) is not None:
        if time.monotonic() >= until:
            left = max(held.expires - time.time(), 0.0)
            what = f"process {held.owner.pid} on {held.owner.host} is computing this (lease runs {left:.0f} s more)"
            raise Leased(Fault(name, what, "wait for it, or until the lease has expired"))
        time.sleep(POLL_SECONDS)
    try:
        yield lease
    finally:
        lease.release()


def read_lease(objects: Any, name: str) -> tuple[Held | None, str | None]:
    """What the lease says (None if damaged), and the tag of the object (None if there is none)."""
    try:
        found = obstore.get(objects, name)
        content = bytes(found.bytes())
    except FileNotFoundError:
        return None, None
    try:
        return Held.model_validate_json(content), found.meta["e_tag"]
    except ValidationError:
        return None, found.meta["e_tag"]
