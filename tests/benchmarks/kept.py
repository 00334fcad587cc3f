"""Cases of a benchmark that are kept below PHYSAVATAR_CACHE (default ~/.cache/physavatar): a run that is stopped goes on where it was."""

import hashlib
import inspect
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tests.test_science_lock import digest


def place(bench: str, name: str, compute: Callable[..., Any], *, science: str, scenes: Sequence[Path], ending: str = "json") -> Path:
    """The file of a case: it names the state of the module `science` and all that it imports, of the files `scenes`, and of what computes it."""
    folder = Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser() / f"bench-{bench}"
    folder.mkdir(parents=True, exist_ok=True)
    whole = digest(science) + "".join(file.read_text() for file in scenes) + inspect.getsource(compute)
    return folder / f"{name}-{hashlib.sha256(whole.encode()).hexdigest()[:12]}.{ending}"


def once(file: Path, compute: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any]:
    """compute(*arguments), if the file does not hold it yet."""
    if not file.exists():
        aside = file.with_suffix(".tmp")
        aside.write_text(json.dumps(compute(*arguments)))
        aside.replace(file)
    return json.loads(file.read_text())
