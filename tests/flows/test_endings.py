"""Exit codes and what a user is advised to do."""

import httpx
import pytest

from flows.endings import CANCELLED, STAGE_FAILED, TIMED_OUT, UNREACHABLE, ending_of
from flows.service.dispatch import WorkFailed
from tasks.child_process import ChildTimedOut


@pytest.mark.parametrize(
    "error", [httpx.ConnectTimeout("all attempts failed"), httpx.ConnectError("no route"), ConnectionRefusedError("no")]
)
def test_a_server_that_cannot_be_reached_is_no_stage_that_took_too_long(error):
    code, said = ending_of(error)
    assert code == UNREACHABLE and "cannot be reached" in said and "timeout" not in said


@pytest.mark.parametrize(
    ("ending", "code"), [("Cancelled", CANCELLED), ("TimedOut", TIMED_OUT), ("Failed", STAGE_FAILED), ("Suspended", STAGE_FAILED)]
)
def test_work_of_the_service_ends_the_command_as_it_ended(ending, code):
    assert ending_of(WorkFailed("ann one: why", ending)) == (code, "ann one: why")


@pytest.mark.parametrize("error", [TimeoutError(), ChildTimedOut("still running after 3 s")])
def test_a_stage_that_took_too_long(error):
    code, said = ending_of(error)
    assert code == TIMED_OUT and "raise the stage's timeout" in said
