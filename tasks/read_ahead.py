"""What comes next is computed in a thread while the caller is busy with what came before, for what waits on files or lets other threads run."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

A, B = TypeVar("A"), TypeVar("B")


def read_ahead(function: Callable[[A], B], items: Iterable[A]) -> Iterator[B]:
    """The function of each item, in order, one item ahead of the caller and in the caller's context.

    Where one fails that is raised in its turn; of a caller who stops early the one that has begun is waited for by nobody.
    """
    thread, before = ThreadPoolExecutor(1), None
    try:
        for item in items:
            coming = thread.submit(copy_context().run, function, item)
            if before is not None:
                yield before.result()
            before = coming
        if before is not None:
            yield before.result()
    finally:
        thread.shutdown(wait=False, cancel_futures=True)
