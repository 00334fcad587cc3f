"""Effects by their names, as a person gives them; a name that nobody knows is refused with the nearest one."""

import difflib
from collections.abc import Iterable, Mapping

from tasks.effects.effect import Effect
from tasks.geometry.faults import Fault, refuse


def named(names: Iterable[str], known: Mapping[str, Effect], place: str) -> tuple[Effect, ...]:
    """The effects of these names, each once, in their order; `place` stands in messages. Raises BadInput with every unknown name."""
    names = tuple(dict.fromkeys(names))
    refuse(Fault(place, f"there is no effect {name!r}", _remedy(name, known)) for name in names if name not in known)
    return tuple(known[name] for name in names)


def _remedy(name: str, known: Mapping[str, Effect]) -> str:
    near = difflib.get_close_matches(name, known, 1)
    return f"Did you mean {near[0]!r}?" if near else "See `physavatar effects`."
