"""Chance: every effect, none and outside the library are equally likely; one is drawn, and acts at its typical strength.

What it is: the figure that guessing reaches. What it is not: fitted to anything; its base is the one to start from.
Source: drawn by the recordings' own bytes, so that the same case is guessed the same way and every case differently.
"""

from dataclasses import replace
from zlib import crc32

import numpy as np

from tasks.exam.rivals.rival import NONE, OUTSIDE, Case, Reply, Rival


def chance(case: Case) -> Reply:
    """Anything."""
    rng = np.random.default_rng(crc32(np.ascontiguousarray(case.recordings[0].observed)))
    sets = [NONE, OUTSIDE, *((e.name,) for e in case.effects)]
    drawn = [sets[k] for k in rng.permutation(len(sets))]
    named = tuple(e for e in case.effects if drawn[0] == (e.name,))
    after = replace(case.model, effects=named, strengths={e.name: e.typical for e in named})
    accelerations = rng.uniform(size=len(case.model.subject.cloth.x_rest))
    return Reply(dict.fromkeys(drawn, 0.0), before=case.model, after=after, vertex_accel=accelerations)


RIVAL = Rival("chance", "guesses", "uniform over all answers", chance)
