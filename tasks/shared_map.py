"""A map whose items several processes on several machines compute together, each once.

    run = SharedMap(folder, here=pool.map, at_once=2)
    scores = run(score, candidates)

Every process goes through the same computation from the same inputs and so comes to the same items; each takes items that nobody else has,
computes them, and leaves the results in `folder` under the digest of function and item. A result is therefore taken only for the very item
it was computed from: a process that went another way (it joined late, its machine rounds otherwise) finds nothing, and harms nothing.
One that dies lets go of what it held (`storage_schemas/lease.py`), and another computes it. Nobody waits for a helper that never comes.

The folder must be shared, with locks (NFS 4); results are plain data (`plain_data.py`), and nothing in the folder is ever executed.
"""

import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, get_type_hints

from storage_schemas.durable import replace_file
from storage_schemas.faults import Leased
from storage_schemas.lease import hold
from tasks.plain_data import as_bytes, digest, from_bytes
from tasks.side_by_side import side_by_side

Map = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
LEASE_S, POLL_S = 60.0, 0.2


class Superseded(Exception):
    """The folder is gone: whoever shared it has its result."""


class SharedMap:
    """See the module docstring. `here` computes items on this machine, and bears to be asked by `at_once` threads at a time."""

    def __init__(self, folder: Path, here: Map, at_once: int) -> None:
        self.folder, self.here, self.at_once = folder, here, at_once

    def __call__(self, function: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """The function of each item, in order; its return type must be annotated. Raises Superseded, and what `here` raises."""
        try:
            return self._mapped(function, list(items))
        except FileNotFoundError as gone:
            if self.folder.is_dir():
                raise
            raise Superseded(str(self.folder)) from gone

    def _mapped(self, function: Callable[[Any], Any], items: list[Any]) -> list[Any]:
        kind = get_type_hints(_plain(function))["return"]
        files = [self.folder / f"{digest((function, item))}.npz" for item in items]
        found: dict[int, Any] = {}
        while True:
            if not self.folder.is_dir():
                raise FileNotFoundError(self.folder)
            missing = [i for i in range(len(items)) if i not in found]
            for i in missing:
                with suppress(FileNotFoundError):
                    found[i] = self._read(kind, files[i])
            missing = [i for i in missing if i not in found]
            if not missing:
                return [found[i] for i in range(len(items))]
            if not self._compute(function, [(items[i], files[i]) for i in missing]):
                time.sleep(POLL_S)

    def _compute(self, function: Callable[[Any], Any], missing: list[tuple[Any, Path]]) -> bool:
        """Compute what nobody else is computing, `at_once` side by side; whether there was any."""
        return any(side_by_side(partial(self._taken, function), missing, self.at_once))

    def _taken(self, function: Callable[[Any], Any], one: tuple[Any, Path]) -> bool:
        """Compute one item, unless somebody else does; whether it is there now."""
        item, file = one
        try:
            with hold(file.with_suffix(".lease"), seconds=LEASE_S):
                if not file.exists():  # somebody finished it while we looked
                    (result,) = self.here(function, [item])
                    replace_file(file, as_bytes(result), forced=False)
                return True
        except Leased:
            return False

    def _read(self, kind: Any, file: Path) -> Any:
        try:
            return from_bytes(kind, file.read_bytes())
        except ValueError:  # a power failure can leave it empty
            file.unlink(missing_ok=True)
            raise FileNotFoundError(file) from None


def _plain(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    while isinstance(function, partial):
        function = function.func
    return function
