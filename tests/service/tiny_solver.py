"""What the tiny line computes in child processes, which import this alone."""

import sys
import time
from collections.abc import Callable


def slowly(seconds: float, scale: float, tell: Callable[[float], None]) -> float:
    """`scale`, after so many seconds. Raises where a solver carries Prefect with it (`flows/service/__main__.py`)."""
    if "prefect" in sys.modules:
        raise RuntimeError("Prefect was imported into a solver's process")
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        tell(1 - left / seconds)
        time.sleep(min(left, 0.5))
    return scale
