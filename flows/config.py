"""What a user can set: physavatar.toml < environment (PHYSAVATAR_…, `__` between levels) < flags. Unknown names are refused with the
nearest one.

store = "artifacts"                      # where results go
data = "data"                            # where recordings lie: <data>/<actor>/<sequence>
effects_folder = "my_effects"            # further effects, one Python file each (tasks/effects)
[body]
model = "/models/SMPLX_NEUTRAL.npz"      # instead of the demo body
[keypoints]
model = "/models/dw-ll_ucoco_384.onnx"   # instead of the bundled detector
[service]
database = "postgresql+asyncpg://…"      # instead of SQLite (flows/service/parameters.py)
[dataset]
gpu_hours = 100.0                        # quotas, this one of tracking and rendering (flows/dataset.py)
"""

import difflib
import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError, create_model, field_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict

from flows.dataset import DatasetParameters
from flows.demo import DemoParameters
from flows.pipeline import STAGES
from flows.service.parameters import ServiceParameters
from flows.service.settings import bundled
from tasks.geometry.faults import BadInput, Fault
from tasks.stage import Folder, Parameters

CONFIG_FILE, PREFIX = "physavatar.toml", "PHYSAVATAR_"
NO_SETTINGS = frozenset(f"{PREFIX}{name}" for name in ("AUTH", "CONFIG", "REAL_DATA", "CACHE", "HOME"))  # AUTH: deploy/compose.yaml
Place = Annotated[Path | str, BeforeValidator(lambda at: at if "://" in str(at) else Path(at))]


class _Places(BaseSettings):
    """Where things are; the stages add one table of parameters each."""

    model_config = SettingsConfigDict(env_prefix=PREFIX, env_nested_delimiter="__", extra="forbid", frozen=True)

    store: Place = Field(Path("artifacts"), description="folder of the artifact store, or s3://bucket/prefix")
    data: Path = Field(Path("data"), description="folder of recordings, <data>/<actor>/<sequence>")
    effects_folder: Folder = Field(None, description="folder of further effects, one Python file each")
    demo: DemoParameters = Field(default_factory=DemoParameters, description="size of the demo recording")
    dataset: DatasetParameters = Field(default_factory=DatasetParameters, description="quotas of the dataset flow")
    service: ServiceParameters = Field(default_factory=ServiceParameters, description="server, database, workers")

    @field_validator("dataset")
    @classmethod
    def _until_is_a_stage(cls, dataset: DatasetParameters) -> DatasetParameters:
        if dataset.until not in STAGES:
            raise ValueError(f"until is {dataset.until!r}, which is no stage; the stages are {', '.join(STAGES)}")
        return dataset

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Flags and TOML come merged as arguments to the constructor; the environment lies between them (see `load`)."""
        return (init_settings,)


_TABLES: dict[str, Any] = {name: (stage.parameters, Field(default_factory=stage.parameters)) for name, stage in STAGES.items()}
Settings = create_model("Settings", __base__=_Places, **_TABLES)


def load(overrides: Iterable[str] = (), *, file: Path | None = None, places: Mapping[str, Any] | None = None) -> Any:
    """The settings in force; `overrides` are flags of the form `stage.parameter=value`, `places` flags such as the store."""
    named = file or _named_file()
    file = named or Path(CONFIG_FILE)
    values: dict[str, Any] = _read_toml(file) if named or file.exists() else {}
    for source, text in (*_environment(), *((f"--set {flag}", flag) for flag in overrides)):
        _assign(values, source, text)
    values |= {name: value for name, value in (places or {}).items() if value is not None}
    _hand_on(values)
    try:
        return Settings(**values)
    except ValidationError as error:
        raise BadInput(_explain(str(file), problem) for problem in error.errors()) from None


def _hand_on(values: dict[str, Any]) -> None:
    """What is said once and counts for further stages: what was fitted is registered, and the user's effects are suspects of the gap. The
    cloth knows them only where it is asked to have some: else another effect in the folder would be another cloth.
    """
    match values:
        case {"body": {"model": model}}:
            _default(values, "registration", "model", model)
    match values:
        case {"effects_folder": folder}:
            _default(values, "gap", "effects_folder", folder)
    match values:
        case {"effects_folder": folder, "cloth": {"effects": effects}} if effects:
            _default(values, "cloth", "effects_folder", folder)


def _default(values: dict[str, Any], table: str, name: str, value: Any) -> None:
    if isinstance(values.setdefault(table, {}), dict):
        values[table].setdefault(name, value)


def places_of(settings: Any) -> dict[str, str]:
    """Environment variables by which `load` finds the same file and the same paths from any working directory."""
    file = _named_file() or Path(CONFIG_FILE)
    places = ({"config": file} if file.exists() else {}) | dict(_paths(settings))
    return {f"{PREFIX}{name.upper()}": str(place.resolve() if isinstance(place, Path) else place) for name, place in places.items()}


def _paths(settings: Any) -> Iterator[tuple[str, Path | str]]:
    yield "store", settings.store  # may be a URL
    for name, value in settings:
        if isinstance(value, Path):
            yield name, value
        if isinstance(value, Parameters):
            own = bundled(value)
            yield from ((f"{name}__{within}", path) for within, path in value if isinstance(path, Path) and within not in own)


def _named_file() -> Path | None:
    named = os.environ.get(f"{PREFIX}CONFIG")
    return Path(named) if named else None


def _read_toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput([Fault(str(file), f"it is not valid TOML ({error})", "Mend the line named.")]) from None
    except OSError as error:
        remedy = f"Name a file of settings with {PREFIX}CONFIG, or leave that unset."
        raise BadInput([Fault(str(file), f"it cannot be read ({error.strerror})", remedy)]) from None


def _environment() -> list[tuple[str, str]]:
    """Of what is set: a variable that a shell or a compose file leaves empty is not."""
    known = {n for n, text in os.environ.items() if n.startswith(PREFIX) and text} - NO_SETTINGS
    return [(n, n.removeprefix(PREFIX).lower().replace("__", ".") + "=" + os.environ[n]) for n in sorted(known)]


def _assign(values: dict[str, Any], source: str, text: str) -> None:
    path, separator, value = text.partition("=")
    if not separator:
        raise BadInput([Fault(source, "it has no '='", "Write stage.parameter=value.")])
    *tables, name = path.strip().split(".")
    for table in tables:
        values = values.setdefault(table, {})
        if not isinstance(values, dict):
            raise BadInput(
                [Fault(source, f"{table!r} is a setting by itself, {values!r}, and has none below it", "Write stage.parameter=value.")]
            )
    values[name] = _value(value.strip())


def _value(text: str) -> Any:
    """A TOML value where the text is one, else the text itself."""
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        return text


def _explain(file: str, problem: Any) -> Fault:
    path = ".".join(str(p) for p in problem["loc"])
    if problem["type"] != "extra_forbidden":
        return Fault(
            f"setting {path}", f"{problem['msg']} (got {problem['input']!r})", f"Correct it in {file}, the environment or the flag."
        )
    *tables, name = problem["loc"]
    table: Any = Settings.model_fields[str(tables[0])].annotation if tables else Settings
    known = list(table.model_fields)
    near = difflib.get_close_matches(str(name), known, 1)
    return Fault(
        f"setting {path}", "there is no such setting", f"Did you mean '{near[0]}'?" if near else f"Known here: {', '.join(known)}."
    )
