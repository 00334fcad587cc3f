"""Long native computations in child processes: each in a process group of its own, with a wall-clock limit, dead when its parent dies.

A thread's timeout cannot stop a solver that sits in compiled code; killing its process group can. Results and messages come back through a
pipe to the parent that started the child, never through files.
"""

import ctypes
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import Any

PR_SET_PDEATHSIG = 1
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of glibc's mallopt
KEPT_BYTES = 2**28


class ChildFailed(RuntimeError):
    """A child that ended without a result; the text says how."""


class ChildTimedOut(TimeoutError):
    """A child that was still running at its limit and was killed."""


def run_in_children(
    function: Callable[..., Any],
    arguments: Sequence[tuple],
    *,
    limit_s: float,
    at_once: int = 2,
    begin_by: float = math.inf,
    on_message: Callable[[int, Any], None] = lambda index, message: None,
) -> list[Any]:
    """function(*arguments[i], tell) for every i, `at_once` at a time; what the child passes to `tell` reaches `on_message(i, …)`.

    begin_by: on the clock of `time.monotonic`; no child is started later, and what was not started has None for its result.

    Raises ChildFailed or ChildTimedOut; no child outlives the call. Exceptions of the function are raised here with their own type.
    """
    results: list[Any] = [None] * len(arguments)
    waiting, running = list(range(len(arguments))), {}
    try:
        while waiting or running:
            if time.monotonic() >= begin_by:
                waiting.clear()
            while waiting and len(running) < at_once:
                index = waiting.pop(0)
                running[index] = _Child(function, arguments[index], limit_s)
            for index, child in list(running.items()):
                if child.poll(lambda message, index=index: on_message(index, message)):
                    results[index] = running.pop(index).result()
            wait([child.receive for child in running.values()], timeout=0.2)
    finally:
        for child in running.values():
            child.kill()
    return results


class _Child:
    def __init__(self, function: Callable[..., Any], arguments: tuple, limit_s: float) -> None:
        context = get_context("spawn")
        self.receive, send = context.Pipe(duplex=False)
        self.process = context.Process(target=_work, args=(send, os.getpid(), function, arguments), daemon=False)
        self.process.start()
        send.close()
        self.limit_s, self.deadline = limit_s, time.monotonic() + limit_s
        self.outcome: tuple[str, Any] | None = None

    def poll(self, tell: Callable[[Any], None]) -> bool:
        """Take what has come; True when the child has ended."""
        try:
            while self.receive.poll():
                kind, value = self.receive.recv()
                if kind == "message":
                    tell(value)
                else:
                    self.outcome = kind, value
        except EOFError:
            self.process.join()
            return True
        if time.monotonic() > self.deadline:
            self.kill()
            raise ChildTimedOut(f"still running after {self.limit_s:.0f} s")
        return False

    def result(self) -> Any:
        if self.outcome is None:
            code = self.process.exitcode
            how = f"signal {signal.Signals(-code).name}" if code and code < 0 else f"exit code {code}"
            raise ChildFailed(f"the computation ended by {how} before it had a result")
        kind, value = self.outcome
        if kind == "error":
            raise value
        return value

    def kill(self) -> None:
        try:
            os.killpg(self.process.pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            self.process.kill()  # it had not yet made its own group
        self.process.join()


def _work(send: Connection, parent: int, function: Callable[..., Any], arguments: tuple) -> None:
    os.setsid()
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # the parent died between fork and prctl
        os._exit(1)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        send.send(("result", function(*arguments, lambda message: send.send(("message", message)))))
    except Exception as error:  # noqa: BLE001  every failure is the parent's to judge
        send.send(("error", error))
    send.close()


class Pool:
    """Processes that stay, for many short computations: `map` applies a function to each item, in order. Threads may share it.

    A computation that is killed, or runs past the limit, is begun again in a new process, at most `attempts` times in all; `reasons` tells.
    """

    def __init__(self, *, limit_s: float, at_once: int = 2, attempts: int = 3) -> None:
        self.limit_s, self.attempts = limit_s, attempts
        self.reasons: list[str] = []
        self._processes, self._own = [_Staying() for _ in range(at_once)], threading.local()
        left = iter(self._processes)
        # each thread has a process of its own, and lasts as long as the pool: a process dies with the thread that began it
        self._threads = ThreadPoolExecutor(at_once, initializer=lambda: setattr(self._own, "process", next(left)))

    def __enter__(self) -> "Pool":
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.end(for_good=True)
        self._threads.shutdown(cancel_futures=True)

    def map(self, function: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
        """Raises ChildFailed or ChildTimedOut after the last attempt of one; what has not begun by then is dropped."""
        items = list(items)
        names = [f"computation {i} of {len(items)}" for i in range(1, len(items) + 1)]
        futures = [self._threads.submit(self._computed, function, *each) for each in zip(items, names, strict=True)]
        try:
            return [future.result() for future in futures]
        finally:
            for future in futures:
                future.cancel()

    def _computed(self, function: Callable[[Any], Any], item: Any, name: str) -> Any:
        for attempt in range(1, self.attempts + 1):
            try:
                return self._own.process.compute(function, item, self.limit_s)
            except (BrokenProcessPool, TimeoutError) as error:
                slow = isinstance(error, TimeoutError)
                reason = f"still running after {self.limit_s:.0f} s" if slow else "killed before it had a result"
                self.reasons.append(f"{name}: {reason} (attempt {attempt})")
                if attempt == self.attempts:
                    raise (ChildTimedOut if slow else ChildFailed)(self.reasons[-1]) from None
        raise AssertionError("unreachable")


class _Staying:
    """One process, begun when it is first needed, and again after it had to be killed."""

    def __init__(self) -> None:
        self._executor: ProcessPoolExecutor | None = None
        self._ended, self._changing = False, threading.Lock()

    def compute(self, function: Callable[[Any], Any], item: Any, limit_s: float) -> Any:
        """Raises BrokenProcessPool or TimeoutError; the next computation has another process then."""
        try:
            return self._submitted(function, item).result(timeout=limit_s)
        except (BrokenProcessPool, TimeoutError):
            self.end()
            raise

    def _submitted(self, function: Callable[[Any], Any], item: Any) -> Future:
        """Raises BrokenProcessPool already here where the process died since its last computation."""
        with self._changing:
            if self._ended:
                raise ChildFailed("the pool has ended")
            if self._executor is None:
                self._executor = ProcessPoolExecutor(1, get_context("spawn"), initializer=_begin, initargs=(os.getpid(),))
            return self._executor.submit(function, item)

    def end(self, *, for_good: bool = False) -> None:
        """Kill it."""
        with self._changing:
            self._ended |= for_good
            executor, self._executor = self._executor, None
        if executor is not None:
            for process in list((executor._processes or {}).values()):
                process.kill()
            executor.shutdown(wait=True, cancel_futures=True)


def _begin(parent: int) -> None:
    """Die with the parent; keep freed memory, for mapping the pages of every array anew took a seventh of a simulation's time."""
    libc = ctypes.CDLL(None)
    libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    libc.mallopt(M_MMAP_THRESHOLD, KEPT_BYTES)
    libc.mallopt(M_TRIM_THRESHOLD, 4 * KEPT_BYTES)
    if os.getppid() != parent:
        os._exit(1)
