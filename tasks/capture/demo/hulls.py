"""Smooth convex curves around points of a body: what a garment that does not follow hollows is cut to.

A convex curve is given by its support function h(θ) = max p·n(θ), n = (sin θ, cos θ); its points are h n + h' n'. Adding the ease to h
moves the curve outwards evenly, and averaging h over neighbouring θ averages rotated copies of the curve: both keep it convex
(Schneider 2013, *Convex Bodies*, §1.7).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLES = 1440  # around one turn
ROUNDING = np.radians(10)  # standard deviation of the averaging over θ


def hull_curve(points: Array, ease: float) -> Array:
    """Closed curve [θ, 2] m around points [P, 2] m, at least `ease` away; the first point, where n = −x, comes again at the end."""
    from scipy.ndimage import gaussian_filter1d

    θ = -np.pi / 2 + 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    n = np.stack([np.sin(θ), np.cos(θ)], 1)
    h = (points @ n.T).max(0)
    smooth = gaussian_filter1d(h, ROUNDING / (2 * np.pi) * SAMPLES, mode="wrap")
    smooth += max(0.0, (h - smooth).max()) + ease
    slope = (np.roll(smooth, -1) - np.roll(smooth, 1)) / (4 * np.pi / SAMPLES)
    curve = smooth[:, None] * n + slope[:, None] * np.stack([np.cos(θ), -np.sin(θ)], 1)
    return np.concatenate([curve, curve[:1]])


def arc_length(curve: Array) -> Array:
    """Length [P] from the first point of a polyline [P, d] to each of its points."""
    return np.r_[0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))]


def bridge(start: Array, end: Array, obstacle: Array, *, ease: float) -> Array:
    """Polyline [P, 2] m from start to end, taut over the points obstacle [Q, 2] m at about `ease` from them; second coordinate is up.

    What does not rise above both ends is no obstacle.
    """
    from scipy.ndimage import gaussian_filter1d
    from scipy.spatial import ConvexHull

    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    wide = (obstacle[:, None] + ease * np.stack([np.cos(turn), np.sin(turn)], 1)).reshape(-1, 2)
    wide = wide[wide[:, 1] > max(start[1], end[1])]
    straight = np.linspace(0, 1, 200)[:, None] * (end - start) + start
    if not len(wide):
        return straight
    points = np.concatenate([start[None], end[None], wide])
    loop = ConvexHull(points).vertices  # counter-clockwise
    at = int(np.flatnonzero(loop == 0)[0])
    loop = np.roll(loop, -at)
    until = int(np.flatnonzero(loop == 1)[0])
    chain = points[loop[: until + 1]] if start[0] > end[0] else points[np.r_[loop[:1], loop[until:][::-1]]]
    s = arc_length(chain)
    fine = np.stack([np.interp(np.linspace(0, s[-1], 200), s, column) for column in chain.T], 1)
    # the ends stay where the straps meet the chest: only the departure from the straight line is rounded, as an odd function there
    away = np.concatenate([-(fine - straight)[:0:-1], fine - straight, -(fine - straight)[-2::-1]])
    return straight + gaussian_filter1d(away, 4.0, axis=0)[199:399]
