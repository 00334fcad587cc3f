"""How well an effect's tangents agree with differences of whole motions: the figure behind the test, for the benchmark's table."""

import numpy as np

from tasks.effects.effect import Effect
from tests.effects.scenes import seen, signature, struck
from tests.effects.test_every_effect import absent, base


def error(effect: Effect) -> float:
    """‖S − S_FD‖/‖S_FD‖ over ten frames at strength zero, the worst column; one-sided differences, second order."""
    scene, S = struck(), signature(*absent(effect), effect)
    x = np.stack([f.x for f in base()])
    worst = 0.0
    for i, column in enumerate(effect.columns):
        e = 2e-4 * effect.strengths[i].typical
        one, two = (seen(scene, effect, k * e * np.eye(len(effect.strengths))[i]) - x for k in (1, 2))
        difference = (4 * one - two) / (2 * e)
        worst = max(worst, float(np.linalg.norm(S[column] - difference) / np.linalg.norm(difference)))
    return worst
