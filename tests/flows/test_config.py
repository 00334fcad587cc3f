"""TOML < environment < flags; what is unknown is refused with the nearest name."""

from pathlib import Path

import pytest

from flows.config import load, places_of
from flows.pipeline import STAGES
from tasks.effects import air_lift
from tasks.geometry.faults import BadInput


@pytest.fixture
def file(tmp_path, monkeypatch):
    for name in ("PHYSAVATAR_STORE", "PHYSAVATAR_CLOTH__DENSITY", "PHYSAVATAR_CONFIG"):
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
        ("dataset.in_flight=0", r"dataset\.in_flight"),
        ("dataset.gpu_hours=-1", r"dataset\.gpu_hours"),
        ("dataset.store_gb=inf", r"dataset\.store_gb"),
        ("dataset.keep_free_gb=nan", r"dataset\.keep_free_gb"),
        ("demo.cameras=1", r"demo\.cameras"),
        ("demo.frames=1", r"demo\.frames"),
        ("demo.size=0", r"demo\.size"),
        ("demo.spp=0", r"demo\.spp"),
        ("demo.seed=-1", r"demo\.seed"),
        ("service.port=70000", r"service\.port"),
        ("service.poll_s=0", r"service\.poll_s"),
        ("service.workers={foo=1}", "there is no pool 'foo'; the pools are vision"),
        ("service.workers={vision=-1}", r"service\.workers\.vision"),
        ("body.body_weight=-5", r"body\.body_weight"),
        ("body.hand_weight=inf", r"body\.hand_weight"),
        ("body.face_weight=nan", r"body\.face_weight"),
        ("tracking.hull_vertices=-4", r"tracking\.hull_vertices"),
        ("skinning.distance=0", r"skinning\.distance"),
        ("skinning.angle_deg=181", r"skinning\.angle_deg"),
        ("cloth.frame_s=inf", r"cloth\.frame_s"),
        ("cloth.limit_s=inf", r"cloth\.limit_s"),
        ("gap.density=-1", r"gap\.density"),
        ("gap.limit_s=nan", r"gap\.limit_s"),
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


@pytest.mark.parametrize(("named", "said"), [("nowhere.toml", "No such file"), ("folder", "Is a directory")])
def test_a_file_that_is_named_is_read_or_refused(file, monkeypatch, named, said):
    (file.parent / "folder").mkdir()
    monkeypatch.setenv("PHYSAVATAR_CONFIG", str(file.parent / named))
    with pytest.raises(BadInput, match=f"{file.parent / named}: it cannot be read .{said}.*PHYSAVATAR_CONFIG"):
        load()


def test_without_a_file_there_are_the_defaults_and_none_is_named_to_workers(file, monkeypatch):
    monkeypatch.chdir(file.parent)
    monkeypatch.setenv("PHYSAVATAR_CONFIG", "")
    assert places_of(load())["PHYSAVATAR_CONFIG"] == str(file)
    file.unlink()
    assert "PHYSAVATAR_CONFIG" not in places_of(load())


def test_a_variable_left_empty_is_not_set(file, monkeypatch):
    for name in ("STORE", "DATA", "BODY__MODEL", "CLOTH__DENSITY", "EFFECTS_FOLDER"):
        monkeypatch.setenv(f"PHYSAVATAR_{name}", "")
    settings = load(file=file)
    assert (settings.store, settings.data, settings.cloth.density) == (Path("from_toml"), Path("data"), 300.0)


def test_the_password_that_the_containers_are_given_is_no_setting(file, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_AUTH", "lab:secret")  # deploy/compose.yaml
    assert load(file=file).service.auth is None


def test_what_was_fitted_is_what_is_registered(file):
    file.write_text("")
    assert load(["body.model=/models/a.npz"], file=file).registration.model == Path("/models/a.npz")
    chosen = load(["body.model=/models/a.npz", "registration.model=/models/b.npz"], file=file)
    assert chosen.registration.model == Path("/models/b.npz")
    assert load([], file=file).registration.model is None
    with pytest.raises(BadInput, match="registration"):
        load(["body.model=/models/a.npz", "registration=3"], file=file)
