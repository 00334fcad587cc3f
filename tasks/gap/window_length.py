"""Training windows screened, as long as the cloth can be predicted.

Where windows leave more than `PREDICTED` times the noise with every effect of the library allowed, derivatives did not hold, and all is
done again in shorter ones. A quick diagnosis puts that to a few long windows first, for cloth that was thinned out may not be followed so far.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import Map
from tasks.cloth.windows import PREDICTED
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, enough, split, unwrinkled
from tasks.gap.screening import FINAL, Screened, screen

Array = NDArray[np.float64]

FORERUNNERS = 4  # long windows at most that a quick diagnosis asks first


@dataclass(frozen=True)
class Looked:
    """Windows of one length [s], those of them that teach, screened, and those kept out (None: other recordings are)."""

    length_s: float
    data: Gathered
    train: Gathered
    held: Gathered | None
    screened: Screened


@dataclass(frozen=True)
class Look:
    """How windows are looked at. contact_doubt [m]: `screening.screen`; φ [K, V]: modes of a start; apart: other recordings are kept out, so
    that every window teaches.
    """

    effects: Sequence[Effect]
    contact_doubt: float
    φ: Array
    apart: bool
    run: Map
    tell: Callable[[str], None]

    def taught(self, data: Gathered) -> tuple[Gathered, Gathered | None]:
        """Training windows, and those kept out, where no recording is held out apart."""
        return (data, None) if self.apart else split(data)

    def at(self, model: Model, data: Gathered, length_s: float) -> Looked:
        """Windows of that length, freed of wrinkles."""
        train, held = self.taught(unwrinkled(model, data, self.φ, self.run))
        return Looked(length_s, data, train, held, self._screened(model, train, FINAL))

    def longest_predicted(self, model: Model, data: Gathered, lengths: Sequence[float], *, quick: bool) -> Looked:
        """Windows of the first of `lengths` [s], longest first, over which cloth can be predicted; of the last where it cannot be over any."""
        for length_s in lengths[:-1]:
            cut = self._cut(data, length_s, model)
            if quick and not self._foreseen(model, cut):
                continue
            looked = self.at(model, cut, length_s)
            if enough(len(looked.screened.evidence), len(looked.train.windows)) and self._held(looked.screened):
                return looked
        return self.at(model, self._cut(data, lengths[-1], model), lengths[-1])

    def _cut(self, data: Gathered, length_s: float, model: Model) -> Gathered:
        cut = data.cut(length_s, model.subject.fps)
        self.tell(f"{len(cut.windows)} windows of {length_s:.2g} s")
        return cut

    def _foreseen(self, model: Model, data: Gathered) -> bool:
        """Whether a few windows, spread over the recordings, can all be followed and predicted in the fabric of the first rounds."""
        train, _ = self.taught(data)
        few = train.only(train.windows[:: -(-len(train.windows) // FORERUNNERS)])
        found = self._screened(model, unwrinkled(model, few, self.φ, self.run), 0)
        return len(found.evidence) == len(few.windows) and self._held(found)

    def _held(self, screened: Screened) -> bool:
        """Whether derivatives held in the windows that could be followed."""
        misfit = float(np.median(screened.windows.overdispersion))
        self.tell(f"misfit {misfit:.3g} with every effect allowed")
        return misfit <= PREDICTED

    def _screened(self, model: Model, train: Gathered, iterations: int) -> Screened:
        return screen(model, train, self.effects, contact_doubt=self.contact_doubt, iterations=iterations, run=self.run, tell=self.tell)
