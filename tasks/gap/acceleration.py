"""Missing acceleration: the force per mass [m/s²] that a model lacks, told in three ways.

Of effects at strengths θ: what they add where cloth is and as it moves, before it has answered. From the state of a frame one implicit step
of h = `STEP_S` is made, whose tangent is

    a = θ ∂v(h)/∂θ / h,    (M + h D + h² K) ∂v/∂θ = h ∂f/∂θ

so that a force spreads no farther than stretch travels in 2 ms, an edge or so, where within a window it would be all over the cloth.

Without a name, by vertex and without any smoothness: in a window that starts from a corrected state, what is missing moves a vertex by ½ a
t². a is the least-squares fit of that parabola to a field of displacements over the window; its standard deviation from the noise is
σ/√Σ(½t²)². Cloth spreads a force to its neighbours within the window, and noise of a millimetre makes accelerations of 1 m/s².

As weak-constraint forcing (Trémolet 2006), smooth over the cloth: with the windows' normal equations, start state and numerics integrated
out, and base parameters and effects at θ, the coefficients of `cloth/forcing.py` are

    a ~ N(H⁻¹ (g_a − G_aθ θ), H⁻¹),    H = G_aa + 1/σ_a²

Source: as said. Limits: constant over a window; no finer than the forcing's modes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.shooting import Evidence, Map
from tasks.cloth.start_state import States
from tasks.cloth.windows import Recording, Window, columns_of, smooth
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered
from tasks.gap.hypotheses import Fitted, Windows

Array = NDArray[np.float64]

STEP_S = 2e-3


def fitted_acceleration(displacement: Array, fps: float) -> Array:
    """a [V, 3] m/s² of displacements [L, V, 3] m at 1/fps … L/fps after the start; NaN frames left out."""
    b = 0.5 * (np.arange(1, len(displacement) + 1) / fps) ** 2
    known = np.isfinite(displacement)
    weight = np.sum(np.where(known, b[:, None, None] ** 2, 0.0), 0)
    total = np.sum(np.where(known, b[:, None, None] * np.nan_to_num(displacement), 0.0), 0)
    return np.where(weight > 0, total / np.maximum(weight, 1e-30), np.nan)


def residual_acceleration(evidence: Sequence[Evidence], fps: float) -> Array:
    """Root mean square over windows of what is missing at each vertex [V] m/s²."""
    return _rms([fitted_acceleration(e.residual, fps) for e in evidence if e.prediction.complete])


def effect_acceleration(model: Model, data: Gathered, strengths: Mapping[str, float], run: Map = map) -> Array:
    """Root mean square over frames of windows of what the model's effects add at `strengths`, column -> θ, where they push or hold cloth
    [V] m/s²; zero at driven vertices, NaN without any frame. data: with states that the model's body allows.
    """
    jobs = [(model, data.recordings[w.recording], data.states[w.recording], w, strengths) for w in data.windows]
    fields = [a for of in run(_added, jobs) for a in of]
    return _rms(fields) if fields else np.full(len(model.subject.cloth.x_rest), np.nan)


def _added(job: tuple[Model, Recording, States, Window, Mapping[str, float]]) -> list[Array]:
    """a [V, 3] m/s² at every other frame of a window from which a step can be made."""
    model, recording, states, window, strengths = job
    n = max(1, round(1 / (STEP_S * model.subject.fps)))
    fps = n * model.subject.fps
    fine = replace(recording.scene(model), settings=replace(model.settings, substeps=1), subject=replace(model.subject, fps=fps))
    drive = model.drive(recording.motion, columns=True).each(lambda motion: smooth(motion.cut(window.frames), n))
    found = []
    for t in range(0, min(window.length, len(states.x) - window.start), 2):
        ahead, k = drive.each(lambda motion, t=t: motion.cut(slice(t * n, t * n + 2))), window.start + t
        *_, last = fine.run_along(ahead, states.x[k], states.v[k], columns=True)
        if last.index == 1 and last.converged:
            a = fps * sum(θ * last.tangents[c][1] for c, θ in strengths.items())
            a[model.subject.cloth.boundary] = 0.0
            found.append(a)
    return found


def nameless_acceleration(windows: Windows, fitted: Fitted, φ: Array) -> tuple[Array, Array]:
    """Posterior mean [W, V, 3] m/s² of the forcing beside a hypothesis, and its standard deviation [W, V, 3]; modes φ [K, V]."""
    names = [*PARAMETERS, *fitted.strengths]
    θ = np.array([*fitted.base, *fitted.strengths.values()]) - [windows.origin.get(n, 0.0) for n in names]
    means, deviations = [], []
    for n in windows.given:
        a = n.index(list(columns_of(n.names, "a ")))
        modes = φ[: len(a) // 3]
        if not fitted.forcing or not len(a):
            means.append(np.zeros((φ.shape[1], 3)))
            deviations.append(np.zeros((φ.shape[1], 3)))
            continue
        covariance = np.linalg.inv(n.G[np.ix_(a, a)] + np.eye(len(a)) / fitted.forcing**2)
        mean = covariance @ (n.g[a] - n.G[np.ix_(a, n.index(names))] @ θ)
        by_axis = np.stack([covariance[c::3, c::3] for c in range(3)])
        means.append(modes.T @ mean.reshape(-1, 3))
        deviations.append(np.sqrt(np.einsum("kv,ckl,lv->vc", modes, by_axis, modes)))
    return np.stack(means), np.stack(deviations)


def _rms(a: Sequence[Array]) -> Array:
    squared = np.sum(np.stack(a) ** 2, -1)
    known = np.isfinite(squared)
    return np.sqrt(np.where(known, squared, 0.0).sum(0) / np.where(known.any(0), known.sum(0), np.nan))
