"""One shape for several frames, fitted jointly with their poses: a chain of unknowns (β, z_1, z_2, …) of which every frame knows its own part and β."""

from collections.abc import Sequence

import numpy as np

from tasks.body.levenberg_marquardt import minimise
from tasks.body.model import Array
from tasks.body.objective import Comparison, Objective

FRAMES = 5  # as the released fits freeze β after a few


def spread(seen: Sequence[int]) -> list[int]:
    """At most `FRAMES` of the frames in which something was seen, spread evenly."""
    return sorted({seen[i] for i in np.linspace(0, len(seen) - 1, FRAMES).round().astype(int)})


def shared_shape(
    terms: Sequence[tuple[Objective, Comparison]], shape: Array, poses: Sequence[Array], *, steps: int = 50
) -> tuple[Array, list[Array]]:
    """β [S] and z [n] of every frame at the minimum of the frames' objectives together, from `shape` and `poses`."""
    S, n = len(shape), len(poses[0])
    parts = [S + i * n + np.arange(n) for i in range(len(poses))]

    def energy(u: Array) -> float:
        return sum(o.energy(seen, u[part], u[:S]) for (o, seen), part in zip(terms, parts, strict=True))

    def expand(u: Array) -> tuple[float, Array, Array]:
        E, g, H = 0.0, np.zeros_like(u), np.zeros((len(u), len(u)))
        for (o, seen), part in zip(terms, parts, strict=True):
            at = np.append(np.arange(S), part)
            E_1, g_1, H_1 = o.expand(seen, u[part], u[:S])
            E, g[at], H[np.ix_(at, at)] = E + E_1, g[at] + g_1, H[np.ix_(at, at)] + H_1
        return E, g, H

    best = minimise(expand, energy, np.concatenate([shape, *poses]), steps=steps).z
    return best[:S], [best[part] for part in parts]
