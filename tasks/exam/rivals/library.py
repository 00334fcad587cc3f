"""All rivals: every file of this folder that has a `RIVAL`."""

import importlib
import pkgutil
from pathlib import Path

from tasks.exam.rivals.rival import Rival


def rivals() -> dict[str, Rival]:
    """name -> rival, those that sit all cases first."""
    modules = [importlib.import_module(f"tasks.exam.rivals.{m.name}") for m in pkgutil.iter_modules([str(Path(__file__).parent)])]
    found = [module.RIVAL for module in modules if hasattr(module, "RIVAL")]
    return {rival.name: rival for rival in sorted(found, key=lambda r: (r.slow, r.name))}
