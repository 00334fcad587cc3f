"""STORE_VERSION, the file that makes a folder a store.

A folder that is neither empty nor a store is refused: a mistyped root must not scatter artifacts over somebody's home.
"""

from __future__ import annotations

import json
from pathlib import Path

from storage_schemas.durable import make_folders, replace_file
from storage_schemas.faults import Corrupt, Fault, NewerFormat

FILE, FORMAT = "STORE_VERSION", 1


def check_format(root: Path, *, founds: bool) -> None:
    """Makes a new or empty `root` a store of this format, if it is to be founded. Raises NewerFormat, Corrupt."""
    marker = root / FILE
    if not marker.exists():
        if founds:
            make_folders(root)
        _refuse_foreign(root, marker)
        if founds:
            replace_file(marker, json.dumps({"format": FORMAT}).encode())
        return
    try:
        written = int(json.loads(marker.read_text())["format"])
    except (ValueError, KeyError, TypeError) as broken:
        raise Corrupt(
            Fault(str(marker), "does not say which format the store has", f'write {{"format": {FORMAT}}} if nothing newer wrote it')
        ) from broken
    if written > FORMAT:
        what = f"the store has format {written}; this physavatar reads and writes up to {FORMAT}"
        raise NewerFormat(Fault(str(marker), what, "upgrade physavatar on this machine, or use another store"))


def _refuse_foreign(root: Path, marker: Path) -> None:
    present = root.iterdir() if root.exists() else ()
    foreign = sorted(path.name for path in present if not path.name.startswith(".") and path.name != FILE)
    if foreign and not marker.exists():  # another process may have founded it meanwhile
        raise Corrupt(Fault(str(root), f"is not empty ({foreign[0]}, …) and no store", "name an empty folder, or a store's root"))
