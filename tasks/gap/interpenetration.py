"""Where the body was put is seen without any simulation: cloth that was observed inside it says how much too large, or how late, it is.

    depth(θ) = root mean square over observed vertices of max(0, −signed distance to the body moved by the effect at θ)

The strength with the least depth is where the simulator starts to look. It has to be told: windows begin from cloth outside the body, so
about a body that is far off, the derivatives say nothing. A body that is too small leaves no trace here; then cloth hangs before it, and
the derivatives serve.

Source: contact constraints as evidence (SMPLify, Bogo et al. 2016, uses them for the body itself). Limits: one component; the depth of a
mesh's vertices, not of its faces.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.windows import Recording
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.geometry.distances import signed_distance

Array = NDArray[np.float64]

EVERY = 6  # frames
STEPS = 8  # strengths on either side of zero, up to the ends of the plausible range
CLEARED = 0.5  # share of the depth that must go for a strength to count


def depth(model: Model, recordings: Sequence[Recording]) -> float:
    """Root mean square depth [m] of what was observed of the free vertices in the body as the model's effects place it."""
    squares, count = 0.0, 0
    free = np.setdiff1d(np.arange(len(model.subject.cloth.x_rest)), model.subject.cloth.boundary)
    for recording in recordings:
        if not recording.collider.faces.size:
            continue
        body = recording.scene(model).driven(recording.motion).collider
        for t in range(0, len(recording), EVERY):
            x = recording.observed[t, free]
            d = signed_distance(x[np.isfinite(x).all(1)], body[t], recording.collider.faces)
            squares += float(np.sum(np.minimum(d, 0) ** 2))
            count += len(d)
    return float(np.sqrt(squares / count)) if count else 0.0


def cleared(model: Model, recordings: Sequence[Recording], effects: Sequence[Effect], noise: float) -> dict[str, float]:
    """column -> strength of each effect of one component on the motion that clears most of the depth; none where noise [m] alone makes as much."""
    plain = depth(model, recordings)
    if plain < noise:
        return {}
    found = {}
    for effect in effects:
        if "motion" not in effect.acts_through or len(effect.strengths) != 1 or effect.kind == "rerun":
            continue
        s = effect.strengths[0]
        tried = np.unique(np.concatenate([np.linspace(s.low, 0, STEPS + 1), np.linspace(0, s.high, STEPS + 1)]))
        depths = [depth(_with(model, effect, θ), recordings) for θ in tried]
        # the least departure that is as good as the best
        best = min(np.flatnonzero(np.array(depths) <= min(depths) + 0.05 * plain), key=lambda k: abs(tried[k]))
        if depths[best] < CLEARED * plain:
            found[effect.name] = float(tried[best])
    return found


def _with(model: Model, effect: Effect, θ: float) -> Model:
    return model.joined([effect], {effect.name: np.array([θ])})
