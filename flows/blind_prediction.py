"""What models predict of a blind recording, as a file: NPZ of `before` and `after`, [T, V, 3] m."""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage_schemas.durable import replace_file
from tasks.child_process import Pool
from tasks.cloth.windows import Recording
from tasks.effects.model import Model
from tasks.gap.blind import held, predicted


class BlindPrediction:
    """Of one blind recording; each model is simulated once, however often it is asked for."""

    def __init__(self, pool: Pool, blind: Recording) -> None:
        self._pool, self._blind = pool, blind
        self._known: dict[int, tuple[Model, NDArray[np.float32]]] = {}  # by identity; the model is kept so that its id stays its own

    def write(self, out: Path, before: Model, after: Model) -> tuple[str, ...]:
        """Each with its last state held where it ends early; `after` is `before` where it ends the earlier: a cause with which cloth cannot
        be simulated foretells nothing. Returns sentences on either, for the file does not say it.
        """
        new = [m for k, m in {id(before): before, id(after): after}.items() if k not in self._known]
        moved = self._pool.map(_predicted, [(model, self._blind) for model in new])
        self._known |= {id(model): (model, x.astype(np.float32)) for model, x in zip(new, moved, strict=True)}
        T = len(self._blind)
        one, other = (self._known[id(model)][1] for model in (before, after))
        told = one if len(other) < len(one) else other
        _write_npz(out, held(one, T), held(told, T))
        return _ended(len(one), len(other), T)


def _predicted(job):
    return predicted(*job)


def _write_npz(path: Path, before: NDArray, after: NDArray) -> None:
    """Whole or not at all, and at this very path: numpy would write in place, and add .npz to the name."""
    content = io.BytesIO()
    np.savez_compressed(content, before=before, after=after)
    replace_file(path, content.getvalue())


def _ended(before: int, after: int, frames: int) -> tuple[str, ...]:
    """What is to be known of predictions that end after so many of all frames."""
    said = []
    if before < frames:
        said.append(f"prediction: the base's ends after {before} of {frames} frames; its last state is held")
    if after < before:
        said.append(f"prediction: that with the named effect ends after {after} of {frames} frames; `after` is `before` instead")
    elif before != after < frames:
        said.append(f"prediction: that with the named effect ends after {after} of {frames} frames; its last state is held")
    return tuple(said)
