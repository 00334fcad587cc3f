"""Exit codes and what a user is advised to do."""

import httpx
import pytest

from flows.endings import TIMED_OUT, UNREACHABLE, ending_of
from tasks.child_process import ChildTimedOut


@pytest.mark.parametrize(
    "error", [httpx.ConnectTimeout("all attempts failed"), httpx.ConnectError("no route"), ConnectionRefusedError("no")]
)
def test_a_server_that_cannot_be_reached_is_no_stage_that_took_too_long(error):
    code, said = ending_of(error)
    assert code == UNREACHABLE and "cannot be reached" in said and "timeout" not in said


@pytest.mark.parametrize("error", [TimeoutError(), ChildTimedOut("still running after 3 s")])
def test_a_stage_that_took_too_long(error):
    code, said = ending_of(error)
    assert code == TIMED_OUT and "raise the stage's timeout" in said
