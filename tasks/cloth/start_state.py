"""States from which windows start: positions and velocities of the cloth at every frame, near what was observed and possible for cloth.

Observed vertices carry a millimetre of noise, which on edges of 30 mm is 3 % of strain and more force than gravity. The state at a frame is
therefore the minimiser of

    ½ Σ_i m_i ‖x_i − (y_i − s² ÿ_i)‖² / s²  +  P(x)        P: gravity, membrane, bending, contact

that is, of all places the one where the observed acceleration ÿ and the forces of the model balance best: if y obeyed the model, x = y. The
time s says how far force may pull cloth from where it was seen: an acceleration error of a moves it by a s². That is so little that forces of
effects may be left out; but stiffness is no small force, and would draw cloth that has shrunk by 5 % out to the lengths it was cut to, by
centimetres. So P is that of the fabric that effects make of the base's.

y, ÿ and velocities are those of polynomials through the five frames around, as fast as the noise allows: order 4 follows every swing up to
fps/5 Hz and every bit of noise, the parabola averages (at the first frame their slopes carry 5.6 and 1.1 times the noise times fps). Cloth
that moves that fast mostly does so over lengths that smooth modes φ hold, while noise is as rough in space as the mesh, and its wrinkles
swing in a window as no cloth does: the fit would answer them with its stiffness. So the difference d of the two polynomials is split, and
of each part the share is kept that noise does not make:

    D = D₂ + k_φ P d + k (1 − P) d,      k = max(0, 1 − σ² Σ w²/mean d²)      per frame, w: weights of the frames in d

P: the harmonic continuation of the driven nodes' motion, and what φ hold of the rest. K modes hold K/V of white noise. Errors that are as
smooth as φ do little harm: they are marginalised.

What the tracker does to cloth (`Model.observed`) is taken back first.

Source: the implicit step as a maximum a posteriori estimate (weak-constraint assimilation, Trémolet 2006), one frame at a time;
James & Stein 1961 (the share k). Limits: what happens faster than that is missing from velocities; σ is what the tracker states.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from tasks.cloth.state_modes import smooth_modes
from tasks.effects.effect import Motion
from tasks.effects.model import Model
from tasks.geometry.meshes import edges
from tasks.simulator import Cloth
from tasks.simulator.base_model import base_problem
from tasks.simulator.contact_friction import ContactFriction
from tasks.simulator.inertia import Inertia
from tasks.simulator.newton import CONVERGED, Problem, solve
from tasks.simulator.potential import Step
from tasks.simulator.preflight import separate

Array = NDArray[np.float64]

FRAMES = 5
SMOOTH = 8  # modes that may move faster than a parabola through five frames
UNSEEN = 1e-3  # weight of a vertex that was not seen
LOOSENESS = 0.3  # share of the noise by which a force error of FORCE may move the cloth
FORCE = 3.0  # [m/s²]


@dataclass(frozen=True)
class States:
    """x [T, V, 3] m, v [T, V, 3] m/s, and how it ended: "converged" or why the cloth could not be brought to where it was seen."""

    x: Array
    v: Array
    ending: str


def states(model: Model, motion: Motion, observed: Array, noise: float) -> States:
    """Walk through observed [T, V, 3] m (NaN where not seen), noise [m] per coordinate, from frame to frame without crossing anything."""
    y, seen = filled(observed, model.subject.cloth.faces)
    y = model.unobserved(y)
    s = float(np.clip(np.sqrt(LOOSENESS * noise / FORCE), 0.005, 0.02))
    slopes = partial(shrunken, cloth=model.subject.cloth, fps=model.subject.fps, noise=noise)
    target = slopes(y, order=0) - s**2 * slopes(y, order=2)
    problem = _problem(model, motion, y[0])
    weights = problem.mass * np.where(seen, 1.0, UNSEEN)
    x, ending = [], CONVERGED
    for t in range(len(y)):
        found, ending = _place(problem, model, weights[t], target[t], motion, t, s, x[-1] if x else None)
        if ending != CONVERGED:
            break
        x.append(found)
    x = np.array(x).reshape(-1, *y.shape[1:])
    return States(x, slopes(x, order=1), ending if ending == CONVERGED else f"frame {len(x)}: {ending}")


def derivative(x: Array, fps: float, order: int, degree: int = 2) -> Array:
    """Time derivative [T, ...] of the polynomial through the five frames around each; 0 where there are too few frames for it."""
    frames = min(FRAMES, len(x) - 1 + len(x) % 2)
    if frames <= order:
        return np.zeros_like(x)
    return savgol_filter(x, frames, min(degree, frames - 1), deriv=order, delta=1 / fps, axis=0, mode="interp")


def shrunken(x: Array, cloth: Cloth, fps: float, order: int, noise: float) -> Array:
    """Time derivative of that order of x [T, V, 3] m, white noise [m] per coordinate."""
    calm = derivative(x, fps, order)
    if len(x) < FRAMES:
        return calm
    d = derivative(x, fps, order, 4) - calm
    every = np.eye(len(x))
    feigned = noise**2 * np.sum((derivative(every, fps, order, 4) - derivative(every, fps, order)) ** 2, 1)
    φ = smooth_modes(cloth, SMOOTH)
    smooth = _smooth(d, cloth, φ)
    share = len(φ) / (len(cloth.x_rest) - len(cloth.boundary))  # of white noise that lies in the modes
    return calm + _kept(smooth, share * feigned) + _kept(d - smooth, (1 - share) * feigned)


def told_by_two(v: Array, seen: Array, cloth: Cloth, fps: float, noise: float) -> Array:
    """Velocities v [V, 3] m/s between two states, of what neither driven nodes nor smooth modes hold the share that noise does not make of
    those `seen` [V, 3] m/s between the frames themselves.
    """
    φ = smooth_modes(cloth, SMOOTH)
    smooth, as_seen = (_smooth(each[None], cloth, φ)[0] for each in (v, seen))
    rough = 1 - len(φ) / (len(cloth.x_rest) - len(cloth.boundary))
    return smooth + _share(seen - as_seen, rough * 2 * (noise * fps) ** 2) * (v - smooth)


def _smooth(d: Array, cloth: Cloth, φ: Array) -> Array:
    """The harmonic continuation of what d [T, V, 3] is at the driven nodes, and what the modes φ [K, V] hold of the rest."""
    on, free = np.zeros_like(d), np.ones(d.shape[1], bool)
    free[cloth.boundary] = False
    if len(cloth.boundary):
        on[:, ~free] = d[:, ~free]
        on = _spread(on, free, cloth.faces)
    area = cloth.vertex_areas
    return on + np.einsum("kv,ktc->tvc", φ, np.einsum("kv,tvc->ktc", φ * area / area.sum(), d - on))


def _kept(d: Array, feigned: Array) -> Array:
    """Of d [T, V, 3] what is more than noise of variance `feigned` [T] makes."""
    return np.array([_share(each, of) * each for each, of in zip(d, feigned, strict=True)])


def _share(d: Array, feigned: float) -> float:
    """1 − `feigned`/mean d², the share of d [V, 3] that noise of that variance does not make."""
    return max(0.0, 1 - feigned / max(float(np.mean(d**2)), 1e-300))


def filled(observed: Array, faces: NDArray[np.int32]) -> tuple[Array, NDArray[np.bool_]]:
    """observed [T, V, 3] without gaps, and what was seen [T, V]: linear in time, and over the mesh where a vertex was never seen."""
    seen = np.isfinite(observed).all(-1)
    y, frames = observed.copy(), np.arange(len(observed))
    for i in np.flatnonzero(~seen.all(0) & seen.any(0)):
        for c in range(3):
            y[:, i, c] = np.interp(frames, frames[seen[:, i]], observed[seen[:, i], i, c])
    unknown = ~seen.any(0)
    if unknown.any():
        y = _spread(y, unknown, faces)
    return y, seen


def _spread(y: Array, unknown: NDArray[np.bool_], faces: NDArray[np.int32]) -> Array:
    """Harmonic fill of vertices that were never seen."""
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.linalg import splu

    e, V = edges(faces), y.shape[1]
    A = coo_matrix((np.ones(2 * len(e)), (np.r_[e[:, 0], e[:, 1]], np.r_[e[:, 1], e[:, 0]])), shape=(V, V)).tocsr()
    L = (diags(np.asarray(A.sum(1)).ravel()) - A).tocsr()
    known = ~unknown
    b = -(L[unknown][:, known] @ y[:, known].transpose(1, 0, 2).reshape(known.sum(), -1))
    y[:, unknown] = splu(L[unknown][:, unknown].tocsc()).solve(b).reshape(unknown.sum(), len(y), -1).transpose(1, 0, 2)
    return y


def _problem(model: Model, motion: Motion, x: Array) -> Problem:
    subject = model.dressed()
    return base_problem(subject.cloth, subject.fabric, subject.collider, motion.collider[0], settings=model.settings)


def _place(
    problem: Problem, model: Model, weight: Array, target: Array, motion: Motion, t: int, s: float, before: Array | None
) -> tuple[Array, str]:
    """Cloth at frame t, reached from where it was `before` [V, 3] (None: from the target itself, freed from the collider)."""
    subject, collider = model.subject, motion.collider[t]
    held = Inertia(np.arange(len(target), dtype=np.int32)[:, None], weight[:, None, None])
    terms = [held] + [p for p in problem.potentials if not isinstance(p, (Inertia, ContactFriction))]
    now = replace(problem, potentials=terms, tolerance=1e-2)
    still, previous = np.zeros_like(target), motion.collider[max(t - 1, 0)]
    if before is None:
        before = target.copy()
        before[problem.boundary] = motion.boundary[t]
        freed = separate(problem, subject.cloth, subject.collider, before, collider)
        if freed.ending != CONVERGED:
            return before, freed.ending
        before, previous = freed.x, collider
    step = Step(s, s, target, still, target, still, collider, previous, collider)
    problem.system.renew()
    problem.surface.forget()
    solution = solve(now, before, step, boundary_target=motion.boundary[t])
    return solution.x, solution.ending
