"""Whoever asks a command for help is told what every option does."""

from collections.abc import Iterator

import pytest
from cyclopts import App

from flows.cli import app


def commands(of: App, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], App]]:
    for word in (w for w in of if not w.startswith("-")):
        yield from commands(of[word], (*words, word))
    if of.default_command is not None:
        yield words, of


COMMANDS = dict(commands(app))


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_option_is_explained(words):
    options = COMMANDS[words].assemble_argument_collection(parse_docstring=True)
    assert [o.name for o in options if o.show and not o.parameter.help] == []
