"""Damage to files, the same for every reader."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def damage() -> Callable[[Path, np.random.Generator], None]:
    """Cuts, flips, repeats or replaces bytes, or turns numbers of a text into NaN or something huge."""

    def apply(path: Path, rng: np.random.Generator) -> None:
        content = bytearray(path.read_bytes())
        a, b = sorted(rng.integers(0, len(content) + 1, 2))
        kind = rng.integers(6)
        if kind == 0:
            content = content[:a]
        elif kind == 1:
            for i in rng.integers(0, len(content), 8):
                content[i] ^= 1 << rng.integers(8)
        elif kind == 2:
            content[a:b] = rng.bytes(b - a)
        elif kind == 3:
            content[a:a] = content[a:b]
        else:
            digits = [i for i, c in enumerate(content) if 48 <= c < 58]
            i = digits[rng.integers(len(digits))] if digits else a
            content[i : i + 1] = (b"nan", b"9" * 400, b"-1e308", b"\0", b"99999999999")[rng.integers(5)]
        path.write_bytes(content)

    return apply
