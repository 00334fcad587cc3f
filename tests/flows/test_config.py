"""TOML < environment < flags; what is unknown is refused with the nearest name."""

from pathlib import Path

import pytest

from flows.config import load
from flows.pipeline import STAGES
from tasks.effects import air_lift
from tasks.geometry.faults import BadInput


@pytest.fixture
def file(tmp_path, monkeypatch):
    for name in ("PHYSAVATAR_STORE", "PHYSAVATAR_CLOTH__DENSITY"):
        monkeypatch.delenv(name, raising=False)
    file = tmp_path / "physavatar.toml"
    file.write_text('store = "from_toml"\n[cloth]\ndensity = 300.0\nbending = 7.0\nmembrane = 2.0\n')
    return file


def test_flags_beat_environment_beats_toml(file, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_CLOTH__DENSITY", "400")
    monkeypatch.setenv("PHYSAVATAR_CLOTH__BENDING", "8")
    settings = load(["cloth.density=500"], file=file)
    assert (settings.cloth.density, settings.cloth.bending, settings.cloth.membrane) == (500.0, 8.0, 2.0)
    assert settings.cloth.attempts == 3
    assert str(settings.store) == "from_toml"


@pytest.mark.parametrize(
    ("flag", "said"),
    [
        ("cloth.densty=3", "Did you mean 'density'"),
        ("clth.density=3", "Did you mean 'cloth'"),
        ("cloth.density=heavy", "cloth.density"),
        ("cloth.density", "has no '='"),
        ("store.x=1", "is a setting by itself"),
        ("dataset.until=dessert", "no stage; the stages are capture"),
    ],
)
def test_what_cannot_be_is_refused_with_a_remedy(file, flag, said):
    with pytest.raises(BadInput, match=said):
        load([flag], file=file)


def test_an_empty_folder_of_effects_is_none_and_not_the_working_directory(file):
    assert load(["effects_folder="], file=file).effects_folder is None


@pytest.fixture
def mine(file):
    """A folder with one effect, named at the top of the file."""
    folder = file.with_name("my_effects")
    folder.mkdir()
    source = Path(air_lift.__file__).read_text().replace('"air_lift', '"air_mine')
    (folder / "air_mine.py").write_text(source)
    file.write_text(f'effects_folder = "{folder}"\n')
    return folder


def test_the_folder_of_effects_reaches_the_stages_that_look_for_them(file, mine):
    plain, asked = load(file=file), load(["cloth.effects=air_mine"], file=file)
    assert (plain.gap.effects_folder, plain.cloth.effects_folder) == (mine, None)
    assert (asked.gap.effects_folder, asked.cloth.effects_folder, asked.cloth.effects) == (mine, mine, ("air_mine",))
    chosen = load(["gap.effects_folder=elsewhere"], file=file)
    assert chosen.gap.effects_folder == Path("elsewhere")
    with pytest.raises(BadInput, match="gap"):
        load(["gap=3"], file=file)


def test_only_what_uses_the_folder_of_effects_has_it_in_its_key(file, mine):
    def decides(stage, overrides=()):
        return STAGES[stage].key_fields({}, getattr(load(overrides, file=file), stage))["weights"].keys()

    assert (set(decides("gap")), set(decides("cloth")), set(decides("cloth", ["cloth.effects=air_mine"]))) == (
        {"effects_folder"},
        set(),
        {"effects_folder"},
    )
    file.write_text("")
    assert not decides("gap") | decides("cloth", ["cloth.effects=air_lift"])


def test_broken_toml_names_the_file(file):
    file.write_text("store = [")
    with pytest.raises(BadInput, match=r"physavatar\.toml"):
        load(file=file)


def test_what_was_fitted_is_what_is_registered(file):
    file.write_text("")
    assert load(["body.model=/models/a.npz"], file=file).registration.model == Path("/models/a.npz")
    chosen = load(["body.model=/models/a.npz", "registration.model=/models/b.npz"], file=file)
    assert chosen.registration.model == Path("/models/b.npz")
    assert load([], file=file).registration.model is None
    with pytest.raises(BadInput, match="registration"):
        load(["body.model=/models/a.npz", "registration=3"], file=file)
