"""Where a simulation stands after a frame: all that decides how it goes on, to the last bit.

A step follows from the last two states and the length of the last step (the rule), from the memories of terms that have one, and from the
columns of the tangents. The pattern of the linear system decides the order of elimination and so the last bits: it is kept as well.
Everything else is made anew in every step. `simulate(..., resume=standing)` yields the frames that come after.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tasks.simulator.time_integration import State

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Standing:
    """After frame `index`: the last two states, the length of the last step [s] (None: there was none), the pattern of the linear system,
    what terms remember, by their number and the name of the attribute, and the columns of the tangents.
    """

    index: int
    now: State
    before: State
    h_previous: float | None
    pattern: NDArray[np.int64]
    memories: Mapping[tuple[int, str], Array | None]
    columns: Mapping[str, Array]

    def as_arrays(self) -> dict[str, Array]:
        """The same as named arrays, for whoever writes it down."""
        states = {f"{at}.{part}": getattr(getattr(self, at), part) for at in ("now", "before") for part in ("x", "v", "collider")}
        remembered = {f"memory.{i}.{name}": value for (i, name), value in self.memories.items() if value is not None}
        empty = [f"{i}.{name}" for (i, name), value in self.memories.items() if value is None]
        return {
            "index": np.array(self.index),
            "h_previous": np.array([] if self.h_previous is None else [self.h_previous]),
            "pattern": self.pattern,
            "empty": np.array(empty, dtype=np.str_),
            **states,
            **remembered,
            **{f"column.{name}": value for name, value in self.columns.items()},
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array]) -> Self:
        """What `as_arrays` gave."""
        memories: dict[tuple[int, str], Array | None] = {}
        kept = {key.removeprefix("memory."): value for key, value in arrays.items() if key.startswith("memory.")}
        for key, value in (kept | dict.fromkeys(map(str, arrays["empty"]))).items():
            term, name = key.split(".")
            memories[int(term), name] = value
        now, before = (State(*(arrays[f"{at}.{part}"] for part in ("x", "v", "collider"))) for at in ("now", "before"))
        h = arrays["h_previous"]
        columns = {key.removeprefix("column."): value for key, value in arrays.items() if key.startswith("column.")}
        return cls(int(arrays["index"]), now, before, float(h[0]) if len(h) else None, arrays["pattern"], memories, columns)
