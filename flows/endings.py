"""How a command can end, as exit codes and sentences a person can act on."""

import traceback
from typing import Any

from storage_schemas.durable import NO_SPACE
from storage_schemas.faults import DiskFull, StoreFault
from tasks.geometry.faults import BadInput

OK, STAGE_FAILED, BAD_INPUT, UNREACHABLE, CANCELLED, TIMED_OUT = range(6)
OF_WORK = {"Cancelled": CANCELLED, "TimedOut": TIMED_OUT}  # by the state in which a run of the service ended


class Refused(Exception):
    """A request that cannot be met as it stands; its text says why and what to do."""


def ending_of(error: BaseException) -> tuple[int, str]:
    """The exit code of an exception and the message for stderr."""
    match error:
        case SystemExit():
            return error.code if isinstance(error.code, int) else STAGE_FAILED, ""
        case KeyboardInterrupt():
            return CANCELLED, "cancelled; finished stages are in the store"
        case DiskFull():
            return BAD_INPUT, f"disk full: {error}"
        case OSError() if error.errno in NO_SPACE:
            return BAD_INPUT, f"disk full: {error}; free space or run `physavatar artifacts gc`, then submit again"
        case BadInput() | StoreFault():
            faults = error.faults
            return BAD_INPUT, "\n".join(
                [f"{len(faults)} fault{'s' * (len(faults) != 1)} in the input:", *(f"  {fault}" for fault in faults)]
            )
        case Refused():
            return BAD_INPUT, str(error)
    name = type(error).__name__
    if name == "WorkFailed":
        return OF_WORK.get(getattr(error, "ending", ""), STAGE_FAILED), str(error)
    if name in {"PrefectHTTPStatusError", "ConnectError", "ConnectTimeout", "ConnectionRefusedError"}:
        return UNREACHABLE, f"the Prefect server cannot be reached: {error}"
    if isinstance(error, TimeoutError) or "TimedOut" in name or "Timeout" in name:
        return TIMED_OUT, f"timed out: {error or name}; raise the stage's timeout or submit again: it goes on from its checkpoint"
    return STAGE_FAILED, "".join(traceback.format_exception(error, limit=-4)).rstrip()


def state_of(error: BaseException) -> str:
    """The word under which a run record keeps this ending."""
    words: dict[int, Any] = {BAD_INPUT: "refused", CANCELLED: "cancelled", TIMED_OUT: "timed out"}
    return words.get(ending_of(error)[0], "failed")
