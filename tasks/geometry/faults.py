"""What is wrong with an input: where, what, and the remedy. Checkers collect every fault before they raise."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One thing wrong: the file or array, the value found there, and what the user can do about it."""

    where: str
    what: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.where}: {self.what}. {self.remedy}"


class BadInput(ValueError):
    """Input that cannot be worked on. Carries all faults found, not only the first."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))

    def __reduce__(self) -> tuple:
        return (BadInput, (self.faults,))


def refuse(faults: Iterable[Fault]) -> None:
    """Raise `BadInput` if there is any fault."""
    faults = tuple(faults)
    if faults:
        raise BadInput(faults)
