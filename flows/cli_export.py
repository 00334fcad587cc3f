"""`physavatar export`: the avatar as files."""

import json
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from flows.cli_options import Json, Location, open_named
from flows.endings import OK, Refused
from storage_schemas.store import Store


def export(
    actor: str,
    folder: Path,
    *,
    sequence: str | None = None,
    format_: Annotated[tuple[str, ...], Parameter(name="--format", negative="")] = ("glb", "npz", "mp4"),
    store: Location = None,
    json_: Json = False,
) -> int:
    """Write the avatar of an actor: glb (skinned, textured), npz (tracked geometry), ply or obj per frame, mp4.

    Args:
        actor: Whose.
        folder: Where to; made if missing.
        sequence: Which; may be left out when the actor has one.
        format_: Which of these, any number of times.
    """
    from flows import avatar

    unknown = [f for f in format_ if f not in avatar.FORMATS]
    if unknown:
        raise Refused(f"there is no format {unknown[0]!r}; there are {', '.join(avatar.FORMATS)}")
    opened = open_named(store)
    written = avatar.export(avatar.Avatar(opened, actor, sequence or _only_sequence(opened, actor)), folder, format_)
    if json_:
        sys.stdout.write(json.dumps([str(path) for path in written]) + "\n")
    else:
        sys.stdout.write(
            "\n".join(str(path) for path in written[:20]) + (f"\n… {len(written)} files in all" if len(written) > 20 else "") + "\n"
        )
    return OK


def _only_sequence(store: Store, actor: str) -> str:
    known = sorted({entry.address.sequence for entry in store.list(actor)})
    if len(known) != 1:
        raise Refused(f"{actor} has {len(known)} sequences in the store ({', '.join(known) or 'none'}); name one with --sequence")
    return known[0]
