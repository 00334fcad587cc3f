"""Settings on their way to a worker, which shares folders with whoever asks, but neither a working directory nor an installation.

Every path is made absolute. A model that comes with the code is left out, and each worker takes its own: the artifacts' keys hold its
content.
"""

from pathlib import Path
from typing import Any

from storage_schemas.key import canonical_json
from storage_schemas.store import Store
from tasks.stage import Parameters

STAYS = ("service", "dataset", "demo")  # what only the server or the submitter needs


def placed(settings: Any, store: Store) -> Any:
    """The settings with paths that mean the same on every machine that shares them, and the store by the name it has everywhere."""
    return settings.model_copy(update={name: _absolute(value) for name, value in settings} | {"store": store.location})


def json_settings(settings: Any) -> dict[str, Any]:
    """The settings as parameters of a flow run: plain JSON."""
    return settings.model_dump(mode="json", exclude=_left_out(settings, STAYS))


def same_settings(settings: Any) -> str:
    """One spelling of everything in the settings that decides artifacts; places do not."""
    return canonical_json(settings.model_dump(mode="json", exclude=_left_out(settings, (*STAYS, "store", "data"))))


def bundled(table: Parameters) -> set[str]:
    """The paths of this table that lead into the installation: where nobody named another one."""
    defaults = {name: field.default for name, field in type(table).model_fields.items() if isinstance(field.default, Path)}
    return {name for name, path in defaults.items() if path.resolve() == _absolute(getattr(table, name))}


def _left_out(settings: Any, names: tuple[str, ...]) -> dict[str, Any]:
    tables = {name: bundled(table) for name, table in settings if isinstance(table, Parameters)}
    return {name: within for name, within in tables.items() if within} | dict.fromkeys(names, True)


def _absolute(value: Any) -> Any:
    match value:
        case Path():
            return value.resolve()
        case Parameters():
            return value.model_copy(update={name: _absolute(within) for name, within in value})
    return value
