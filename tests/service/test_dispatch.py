"""Patience with a server that is away, and the end of patience."""

import asyncio

import httpx
import pytest
from prefect.exceptions import PrefectHTTPStatusError

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
