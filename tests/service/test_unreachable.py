"""A server that is away ends each command that needs it with the exit code for that, and with what to look at on this machine."""

from functools import partial

import pytest

from flows import cli_up
from flows.endings import UNREACHABLE, ending_of
from flows.service import up
from flows.service.server import wait_for

AWAY = ("service.url=http://127.0.0.1:9/api",)


@pytest.fixture(autouse=True)
def briefly(tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_HOME", str(tmp_path))
    monkeypatch.setattr(up, "adopt", lambda environment: None)
    monkeypatch.setattr(up, "wait_for", partial(wait_for, seconds=0.5))


@pytest.mark.parametrize(
    "command",
    [partial(cli_up.up, set_=AWAY), partial(cli_up.worker, "vision", set_=AWAY), partial(cli_up.deploy, set_=AWAY)],
    ids=["up", "worker", "deploy"],
)
def test_a_server_elsewhere_that_is_away(command):
    with pytest.raises(ConnectionRefusedError) as refused:
        command()
    code, said = ending_of(refused.value)
    assert code == UNREACHABLE
    assert "http://127.0.0.1:9/api" in said
    assert "server.log" not in said


def test_an_own_server_that_does_not_start_points_to_its_log(tmp_path, monkeypatch):
    monkeypatch.setattr(up, "server_command", lambda service: ["false"])
    with pytest.raises(ConnectionRefusedError, match=str(tmp_path / "logs" / "server.log")):
        cli_up.up(port=9)
