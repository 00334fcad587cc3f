"""Calls side by side in threads, for what waits on computations elsewhere."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

A, B = TypeVar("A"), TypeVar("B")


def side_by_side(function: Callable[[A], B], items: Iterable[A], at_once: int) -> list[B]:
    """The function of each item, in order, each in the caller's context: what a stage may not open its threads may not either.

    Where one fails, or the caller is interrupted, what has not begun is dropped, and nobody waits for what is under way. One at a time is
    done in the caller's own thread.
    """
    if at_once == 1:
        return [function(item) for item in items]
    threads = ThreadPoolExecutor(at_once)
    try:
        return [future.result() for future in [threads.submit(copy_context().run, function, item) for item in items]]
    finally:
        threads.shutdown(wait=False, cancel_futures=True)
