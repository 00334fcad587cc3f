"""What somebody could plant, name or read who should not."""

import base64
import json
import pickle
from pathlib import Path

import pytest
from prefect.results import ResultRecord
from prefect.serializers import JSONSerializer
from pydantic import SecretStr

from flows.config import load
from flows.endings import Refused
from flows.service import server
from flows.service.parameters import ServiceParameters
from flows.service.results import ForeignRecord, refuse_foreign_records
from storage_schemas.faults import BadName
from tests.service import tiny


class Trap:
    def __init__(self, sprung: Path):
        self.sprung = sprung

    def __reduce__(self):
        return Path.touch, (self.sprung,)


def record(result: str, **serializer: str) -> bytes:
    return json.dumps({"metadata": {"storage_key": "x", "serializer": serializer}, "result": result}).encode()


@pytest.mark.parametrize("kind", ["pickle", "compressed/pickle", "json with a function of its own", "nameless"])
def test_a_planted_record_is_refused_before_it_runs(tmp_path, kind):
    refuse_foreign_records()
    sprung = tmp_path / "sprung"
    planted = base64.b64encode(pickle.dumps(Trap(sprung))).decode()
    match kind:
        case "pickle" | "compressed/pickle":
            data = record(planted, type=kind)
        case "nameless":
            data = json.dumps({"result": planted}).encode()
        case _:
            data = record('{"a": 1}', type="json", object_decoder="tests.service.test_security.spring")
    with pytest.raises(ForeignRecord):
        ResultRecord.deserialize(data)
    assert not sprung.exists()


def test_an_own_record_is_read(tmp_path):
    refuse_foreign_records()
    from prefect._internal.result_records import ResultRecordMetadata

    written = ResultRecord(metadata=ResultRecordMetadata(serializer=JSONSerializer(), storage_key="x"), result={"a": 1})
    assert ResultRecord.deserialize(written.serialize()).result == {"a": 1}


@pytest.mark.parametrize("name", ["..", "../../etc", "/etc", "a/b", "", ".hidden", "a\0b", "x" * 200])
def test_a_name_cannot_leave_its_folder(tmp_path, name):
    settings = {"store": str(tmp_path / "store"), "data": str(tmp_path)}
    with pytest.raises(BadName):
        tiny.SERVICE.open(name, "one", "cloth", settings)
    with pytest.raises(BadName):
        tiny.SERVICE.open("ann", name, "cloth", settings)


def test_secrets_are_shown_nowhere(monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_SERVICE__DATABASE", "postgresql+asyncpg://me:hidden1@db/x")
    monkeypatch.setenv("PHYSAVATAR_SERVICE__AUTH", "me:hidden2")
    settings = load()
    shown = settings.model_dump_json() + repr(settings) + str(settings.service)
    assert "hidden" not in shown
    assert settings.service.auth.get_secret_value() == "me:hidden2"


@pytest.fixture
def at_home(tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_HOME", str(tmp_path))
    return tmp_path


OPEN = "0.0.0.0"


def test_a_server_beyond_loopback_always_has_a_password(at_home):
    assert server.credential(ServiceParameters()) is None
    made_up = server.credential(ServiceParameters(host=OPEN))
    assert len(made_up) > 30
    assert (at_home / "auth").stat().st_mode & 0o077 == 0
    assert [file.name for file in at_home.iterdir()] == ["auth"]
    assert server.credential(ServiceParameters(host=OPEN)) == made_up
    assert server.server_environment(ServiceParameters(auth=SecretStr("a:b")))["PREFECT_SERVER_API_AUTH_STRING"] == "a:b"


def test_an_empty_password_is_none(at_home, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_SERVICE__AUTH", "")
    service = load([f"service.host={OPEN}"]).service
    assert service.auth is None
    assert len(server.server_environment(service)["PREFECT_SERVER_API_AUTH_STRING"]) > 30


def test_a_password_that_was_not_written_to_its_end_is_made_anew(at_home):
    (at_home / "auth").touch()
    made_up = server.credential(ServiceParameters(host=OPEN))
    assert len(made_up) > 30
    assert (at_home / "auth").read_text() == made_up
    assert (at_home / "auth").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("given", ["hidden", ":hidden", "hidden:", ":"])
def test_what_is_no_user_and_password_is_refused_where_others_can_reach(at_home, given):
    with pytest.raises(Refused, match="not user:password") as refused:
        server.credential(ServiceParameters(host=OPEN, auth=SecretStr(given)))
    assert "hidden" not in str(refused.value)
    assert server.credential(ServiceParameters(auth=SecretStr(given))) == given


def test_the_own_password_is_told_to_no_other_server(at_home):
    made_up = server.credential(ServiceParameters(host=OPEN))
    other = ServiceParameters(url="http://other:4200/api")
    assert server.credential(other) is None
    server.write_note(other)  # `physavatar up` with workers for it alone
    environment = server.running_environment(ServiceParameters())
    assert environment["PREFECT_API_URL"] == "http://other:4200/api"
    assert "PREFECT_API_AUTH_STRING" not in environment
    server.write_note(ServiceParameters(host=OPEN, port=4300))
    environment = server.running_environment(ServiceParameters())
    assert environment["PREFECT_API_URL"] == "http://127.0.0.1:4300/api"
    assert environment["PREFECT_API_AUTH_STRING"] == made_up
