"""Patience with a server that is away, and the end of patience; which run answers a request."""

import asyncio
from contextlib import asynccontextmanager
from uuid import uuid4

import httpx
import pytest
from prefect.client.schemas.objects import FlowRun
from prefect.exceptions import PrefectHTTPStatusError
from prefect.states import Cancelled, Completed, Failed, Running, Scheduled

from flows.service import dispatch
from flows.service.dispatch import patiently


def refusal(status: int) -> Exception:
    request = httpx.Request("POST", "http://server/api")
    return PrefectHTTPStatusError("refused", request=request, response=httpx.Response(status, request=request))


def asked(answers: list, patience_s: float = 30.0) -> tuple[object, int]:
    times = 0

    async def ask():
        nonlocal times
        times += 1
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    return asyncio.run(patiently(ask, patience_s)), times


@pytest.mark.parametrize("trouble", [refusal(503), refusal(500), refusal(429), httpx.ConnectError("down"), httpx.ReadTimeout("slow")])
def test_a_server_that_is_away_is_asked_again(trouble):
    assert asked([trouble, "run"]) == ("run", 2)


@pytest.mark.parametrize("status", [400, 401, 404, 422])
def test_a_wrong_question_is_asked_once(status):
    with pytest.raises(PrefectHTTPStatusError):
        asked([refusal(status), "run"])


def test_patience_ends():
    with pytest.raises(PrefectHTTPStatusError):
        asked([refusal(503), refusal(503)], patience_s=0.0)


class Server:
    """Runs under their keys, as Prefect keeps them: a key that has a run returns that one."""

    def __init__(self, ended: int):
        self.runs = {f"k-{n}": run(f"k-{n}", Completed()) for n in range(ended)}

    async def read_flow_runs(self, flow_run_filter, limit):
        assert limit <= 200
        return [self.runs[key] for key in flow_run_filter.idempotency_key.any_ if key in self.runs]

    async def create(self, deployment, *, client, idempotency_key, **_):
        return self.runs.setdefault(idempotency_key, run(idempotency_key, Scheduled()))


def run(key: str, state) -> FlowRun:
    return FlowRun(flow_id=uuid4(), idempotency_key=key, state=state)


@pytest.fixture
def submitted(monkeypatch):
    def go(server: Server) -> FlowRun:
        monkeypatch.setattr(dispatch, "arun_deployment", server.create)
        return asyncio.run(dispatch.submit(server, dispatch.Work("vision/service", {}, "k", "ann one: vision")))

    return go


@pytest.mark.parametrize("ended", [0, 1, 90, 200, 401])
def test_what_has_ended_however_often_runs_again(submitted, ended):
    server = Server(ended)
    assert submitted(server).state.is_scheduled()
    assert len(server.runs) == ended + 1


@asynccontextmanager
async def no_server():
    yield None


@pytest.mark.parametrize("state", [Cancelled(message="why"), Failed(name="TimedOut", message="why"), Failed(message="why")])
def test_who_waits_is_told_how_it_ended_and_ends_so_too(monkeypatch, state):
    async def submit(client, work):
        return run("k-0", state)

    monkeypatch.setattr(dispatch, "get_client", no_server)
    monkeypatch.setattr(dispatch, "submit", submit)
    with pytest.raises(dispatch.WorkFailed, match=f"ann one: {state.name}: why") as failed:
        asyncio.run(dispatch.dispatch(dispatch.Work("actor/service", {}, "k", "ann one")))
    ends = failed.value.as_state()
    assert (failed.value.ending, ends.type, ends.name) == (state.name, state.type, state.name)


@pytest.mark.parametrize("removed", [0, 1, 89])
def test_a_run_that_the_vacuum_removed_does_not_bring_back_a_younger_one(submitted, removed):
    server = Server(90)
    del server.runs[f"k-{removed}"]
    assert submitted(server).state.is_scheduled()


@pytest.mark.parametrize("under_way", [0, 150, 399])
def test_what_is_under_way_is_not_submitted_twice(submitted, under_way):
    server = Server(400)
    server.runs[f"k-{under_way}"] = run(f"k-{under_way}", Running())
    del server.runs["k-3"]
    assert submitted(server).idempotency_key == f"k-{under_way}"
