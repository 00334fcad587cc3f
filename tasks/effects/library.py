"""The library of effects: every file of this folder, and of a folder that the user names, that has an `EFFECT`."""

import importlib
import importlib.util
import pkgutil
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import ModuleType

from tasks.effects.effect import Effect
from tasks.geometry.faults import Fault, refuse

FAMILIES = ("air", "fabric", "contact", "body", "boundary", "observation", "gravity", "numerics")


def library(plugins: Path | None = None) -> dict[str, Effect]:
    """name -> effect, families in their order; `plugins`: a folder of further files. Raises BadInput for what is not an effect."""
    own = [_module(f"tasks.effects.{m.name}") for m in pkgutil.iter_modules([str(Path(__file__).parent)])]
    found = [(module.__name__, module.EFFECT) for module in own if hasattr(module, "EFFECT")]
    found += _plugins(plugins) if plugins is not None else []
    refuse(_faults(found))
    return {effect.name: effect for _, effect in sorted(found, key=lambda pair: _order(pair[1].name))}


def suspects(effects: Iterable[Effect]) -> list[Effect]:
    """Those that a verdict may name: all but the numerics."""
    return [e for e in effects if not e.name.startswith("numerics_")]


def _module(name: str):
    return importlib.import_module(name)


def _plugins(folder: Path) -> list[tuple[str, object]]:
    if not folder.is_dir():
        refuse([Fault(str(folder), "there is no such folder of effects", "Make it, or correct effects_folder.")])
    return [_plugin(path) for path in sorted(folder.glob("*.py"))]


def _plugin(path: Path) -> tuple[str, object]:
    try:
        effect = _effect_of(path.resolve(), path.read_bytes())
    except Exception as error:  # noqa: BLE001  a user's file may fail in any way
        refuse([Fault(str(path), f"it cannot be imported: {type(error).__name__}: {error}", "Repair it, or take it out of the folder.")])
    return str(path), effect


def _effect_of(path: Path, source: bytes) -> object:
    """The EFFECT of a file with this source, or None. Another process is sent both, for it cannot import the file's module, and the file may
    have been edited since.
    """
    module = _executed(f"effect_{path.stem}", path, source)
    effect = getattr(module, "EFFECT", None)
    if type(effect).__module__ == module.__name__:
        type(effect).__reduce__ = lambda self: (_received, (path, source))
    return effect


@cache
def _received(path: Path, source: bytes) -> object:
    """The same, once however often it is sent."""
    return _effect_of(path, source)


def _executed(name: str, path: Path, source: bytes) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their annotations up there
    try:
        exec(spec.loader.source_to_code(source, path), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _faults(found: list[tuple[str, Effect]]) -> list[Fault]:
    faults, seen = [], {}
    for place, effect in found:
        if not isinstance(effect, Effect):
            faults.append(Fault(place, "it has no EFFECT that is one", "Assign an instance of tasks.effects.effect.Effect to EFFECT."))
        elif missing := [name for name in ("name", "kind", "strengths") if not hasattr(effect, name)]:
            faults.append(Fault(place, f"its EFFECT has no {', '.join(missing)}", "Set them on the class; see tasks/effects/README.md."))
        elif effect.name in seen:
            faults.append(Fault(place, f"the name {effect.name} is taken by {seen[effect.name]}", "Choose another."))
        else:
            seen[effect.name] = place
    return faults


def _order(name: str) -> tuple[int, str]:
    family = name.split("_")[0]
    return (FAMILIES.index(family) if family in FAMILIES else len(FAMILIES), name)
