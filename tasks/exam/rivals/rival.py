"""What a rival is: another way to name a cause, from the files that the diagnosis gets, through the same process, marked by the same
scorer.

A rival is one file whose `RIVAL` is an instance of `Rival`. It replies with a weight for every set of names it considers and with the two
models whose motion it predicts blind; what a reply becomes as an answer of version 1 is the same for all (`answer.py`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_refit import BaseFit, refit
from tasks.cloth.shooting import Map
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Recording
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, gather, jobs, lengths, restated, unwrinkled
from tasks.gap.screening import FINAL, MODES, roughly_refitted

Array = NDArray[np.float64]
Names = tuple[str, ...]
NONE: Names = ("none",)
OUTSIDE: Names = ("outside_library",)


@dataclass(frozen=True)
class Case:
    """What a rival may read: the model to start from, the open recordings, the effects that may be named. `run` maps over processes."""

    model: Model
    recordings: tuple[Recording, ...]
    effects: tuple[Effect, ...]
    run: Map = map

    @cached_property
    def refitted(self) -> tuple[Gathered, BaseFit]:
        """Windows of all recordings, and the base model fitted to them by the diagnosis' own steps up to its tangents: several rivals start
        there, and share it.

        Windows are the longest that the diagnosis tries, and none is kept out.
        """
        data, φ, fps = gather(self.model, self.recordings, self.run), smooth_modes(self.model.subject.cloth, MODES), self.model.subject.fps
        longest_first = lengths(self.recordings, fps)
        model, correlation = roughly_refitted(self.model, [data.cut(s, fps) for s in reversed(longest_first)], self.run)
        data = unwrinkled(model, restated(model, data.correlated(correlation), self.run).cut(longest_first[0], fps), φ, self.run)
        return data, refit(jobs(model, data, φ), noise=data.noise, iterations=FINAL, run=self.run)


@dataclass(frozen=True)
class Reply:
    """What a rival says. The first of the heaviest sets of names is its verdict.

    log_weight: names -> log of an unnormalised probability. before, after: models without and with what was found. deviation: effect ->
    standard deviations [K] of its strengths in `after`, where the rival has any. vertex_accel [V] m/s²: size of what is missing.
    residual_mm: root mean square on the recordings themselves, before and after.
    """

    log_weight: Mapping[Names, float]
    before: Model
    after: Model
    deviation: Mapping[str, Array] = field(default_factory=dict)
    vertex_accel: Array | None = None
    residual_mm: tuple[float, float] | None = None


@dataclass(frozen=True)
class Rival:
    """A rival: its name, what it does in one line, where that comes from, and whether it is slow (then it sits a third of the cases).

    refits: it starts from `Case.refitted`, whose seconds count as its own. needs: a package beyond the project's own dependencies.
    """

    name: str
    does: str
    source: str
    reply: Callable[[Case], Reply]
    slow: bool = False
    refits: bool = False
    needs: str | None = None
