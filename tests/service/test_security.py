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


def test_a_server_beyond_loopback_always_has_a_password(tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_HOME", str(tmp_path))
    assert server.credential(ServiceParameters()) is None
    made_up = server.credential(ServiceParameters(host="0.0.0.0"))
    assert len(made_up) > 30
    assert (tmp_path / "auth").stat().st_mode & 0o077 == 0
    assert server.credential(ServiceParameters(host="0.0.0.0")) == made_up
    assert server.server_environment(ServiceParameters(auth=SecretStr("a:b")))["PREFECT_SERVER_API_AUTH_STRING"] == "a:b"
