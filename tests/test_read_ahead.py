"""One item ahead of the caller: order, context, failures in their turn, and no more than one ahead."""

import threading
from contextvars import ContextVar

import pytest

from tasks.read_ahead import read_ahead

SAID = ContextVar("said", default="nothing")


@pytest.mark.parametrize("count", [0, 1, 4])
def test_each_in_order_in_the_callers_context(count):
    token = SAID.set("here")
    assert list(read_ahead(lambda n: (n, SAID.get()), range(count))) == [(n, "here") for n in range(count)]
    SAID.reset(token)


def test_the_next_is_computed_while_the_caller_is_busy_and_none_beyond_it():
    begun = [threading.Event() for _ in range(4)]

    def computed(n):
        begun[n].set()
        return n

    for n in read_ahead(computed, range(4)):
        assert n == 3 or begun[n + 1].wait(20)
        assert not any(event.is_set() for event in begun[n + 2 :])


def test_what_fails_is_raised_in_its_turn():
    ahead = read_ahead(lambda n: 6 // n, [3, 0, 2])
    assert next(ahead) == 2
    with pytest.raises(ZeroDivisionError):
        next(ahead)


def test_a_caller_who_stops_waits_for_nobody():
    free, begun = threading.Event(), threading.Event()

    def computed(n):
        if n:
            begun.set()
            free.wait(20)
        return n

    ahead = read_ahead(computed, range(3))
    assert next(ahead) == 0 and begun.wait(20)
    closing = threading.Thread(target=ahead.close)
    closing.start()
    closing.join(10)
    assert not closing.is_alive()
    free.set()
