"""Algorithm 1 of PhysAvatar: density and stiffness by forward differences and Adam, over simulations that know no derivative.

    E(ρ, κ_s, κ_b) = 1/(T−1) Σ_{t=1}^{T−1} 1/V Σ_i ‖x_{t,i} − x̂_{t,i}‖²       free vertices, x̂ the tracked mesh, x_0 = x̂_0
    g_k = (E(θ + δ_k e_k) − E(θ)) / δ_k,      θ ← clamp(θ − Adam(g)),      all three at once, 100 times

δ = (5 kg/m³, 0.05, 0.05), ρ in 200–640 kg/m³, κ in 0.1–8, 24 frames, one backward Euler step per frame (0.04 s at 25 frames per second); at
the top of a range the difference is taken backwards. Adam works on (θ − low)/(high − low): in raw units, as released, its steps are at most
the learning rate, so 100 of them move the density by about 7 of 440 kg/m³ and the parameter is in effect frozen. `as_released` shows that:
raw units, rate 0.1 to 0.04, the perturbed value clipped at the top of its range yet divided by the whole δ, the density cut to an integer.

The four simulations of an iteration know nothing of one another: `run` maps over them, here, in a pool of processes, or on workers.
A point whose simulation fails is pulled half-way back to the last good one; a perturbed one that fails is taken on the other side.

Source: PhysAvatar, supplement A.3, Algorithm 1; Kingma & Ba 2015. The answer is the best point seen, as in the released code.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.scene import Scene, replay
from tasks.simulator import Fabric

Array = NDArray[np.float64]

FRAMES = 24  # after the first
ITERATIONS = 100
DIFFERENCES = np.array([5.0, 0.05, 0.05])
LOW, HIGH = np.array([200.0, 0.1, 0.1]), np.array([640.0, 8.0, 8.0])
RATE, RATE_AS_RELEASED = (0.05, 0.02), (0.1, 0.04)  # first and last, cosine between
β1, β2, ε = 0.9, 0.999, 1e-8
RETREATS = 5
AT_END = 1e-6  # of a range: the search is clamped to its ends


@dataclass(frozen=True)
class Score:
    """What one simulation says: loss [m²] (infinite where it failed), mean distance [mm], implicit steps and seconds spent, ending, and what
    had to be retried.
    """

    loss: float
    mean_mm: float = np.inf
    steps: int = 0
    seconds: float = 0.0
    ending: str = "converged"
    reasons: tuple[str, ...] = ()


class Run(Protocol):
    """Applies a function to each item, in order; `map` will do."""

    def __call__(self, function: Callable[[Array], Score], items: Iterable[Array], /) -> Iterable[Score]:
        """The scores of these points."""
        ...


@dataclass(frozen=True)
class Descent:
    """Where the search stands: θ [3] = (ρ, κ_s, κ_b), Adam's moments, the best point, a row of figures per iteration, and what had to be
    retried in each.
    """

    θ: Array
    first: Array
    second: Array
    best: Array
    history: tuple[dict[str, float], ...] = ()
    ending: str = ""
    reasons: tuple[str, ...] = ()

    @classmethod
    def at(cls, θ: Array) -> "Descent":
        """A start."""
        return cls(np.asarray(θ, float), np.zeros(3), np.zeros(3), np.asarray(θ, float))

    @property
    def last(self) -> Array:
        """The last point [3] whose simulation succeeded; where the search stands if there is none."""
        row = self.history[-1] if self.history else None
        return np.array([row["density"], row["kappa_s"], row["kappa_b"]]) if row else self.θ

    @property
    def best_loss(self) -> float:
        """The least loss seen [m²]."""
        return min((row["loss"] for row in self.history), default=np.inf)

    @property
    def steps(self) -> int:
        """Implicit steps simulated so far, perturbed simulations included."""
        return int(sum(row["steps"] for row in self.history))


def as_algorithm_1(scene: Scene) -> Scene:
    """The scene as Algorithm 1 sees it: 24 frames after the first, one backward Euler step each, beginning at rest."""
    T = FRAMES + 1
    return replace(
        scene,
        collider_motion=scene.collider_motion[:T],
        boundary_motion=scene.boundary_motion[:T],
        observed=scene.observed[:T],
        noise_m=scene.noise_m[:T],
        noise_cov=None if scene.noise_cov is None else scene.noise_cov[:T],
        v0=np.zeros_like(scene.v0),
        settings=replace(scene.settings, integrator="backward_euler", substeps=1),
    )


def score(scene: Scene, fabric: Fabric, θ: Array) -> Score:
    """Simulate with θ = (ρ, κ_s, κ_b) in place of the fabric's own, and compare with the tracked mesh."""
    now = replay(scene, replace(fabric, density=float(θ[0]), membrane=float(θ[1]), bending=float(θ[2])))
    steps = (len(now.x) - 1) * scene.settings.substeps
    if not now.complete:
        return Score(np.inf, np.inf, steps, now.seconds, now.ending, now.reasons)
    distance = np.linalg.norm((scene.observed - now.x)[scene.compared], axis=1)
    return Score(float(np.mean(distance**2)), float(1e3 * distance.mean()), steps, now.seconds, reasons=now.reasons)


def descend(
    scene: Scene,
    fabric: Fabric,
    start: Descent,
    *,
    iterations: int = ITERATIONS,
    as_released: bool = False,
    run: Run = map,
    on_iteration: Callable[[Descent], None] = lambda descent: None,
) -> Descent:
    """Algorithm 1 on a scene, from `start` up to so many iterations in all."""
    return minimise(
        partial(score, scene, fabric), start, iterations=iterations, as_released=as_released, run=run, on_iteration=on_iteration
    )


def minimise(
    simulated: Callable[[Array], Score],
    start: Descent,
    *,
    iterations: int,
    as_released: bool = False,
    run: Run = map,
    on_iteration: Callable[[Descent], None] = lambda descent: None,
) -> Descent:
    """Algorithm 1 with any simulation that scores θ [3]."""
    now, good = replace(start, ending=""), start.last
    at = np.floor if as_released else (lambda ρ: ρ)
    while len(now.history) < iterations and not now.ending:
        for _ in range(RETREATS + 1):
            points, widths = _stencil(now.θ, as_released)
            points[:, 0] = at(points[:, 0])
            here, *beside = run(simulated, points)
            now = _told(now, [here, *beside])
            if np.isfinite(here.loss):
                break
            now = replace(now, θ=(now.θ + good) / 2)
        else:
            now = replace(now, ending=f"the simulation fails wherever the search turns: {here.ending}")
            break
        good = now.θ
        slopes, more = _slopes(simulated, here, beside, points[0], widths)
        now = _moved(_told(now, more), here, [here, *beside, *more], slopes, iterations, as_released)
        on_iteration(now)
    return now if now.ending else replace(now, ending=f"stopped after {len(now.history)} iterations")


def _told(now: Descent, scores: Iterable[Score]) -> Descent:
    """With what these simulations of the iteration in progress had to retry."""
    return replace(now, reasons=(*now.reasons, *(f"iteration {len(now.history) + 1}: {said}" for s in scores for said in s.reasons)))


def _stencil(θ: Array, as_released: bool) -> tuple[Array, Array]:
    """The point and its three neighbours [4, 3], and by what each difference is divided [3]."""
    if as_released:
        ahead = np.minimum(θ + DIFFERENCES, HIGH)
        return np.vstack([θ, θ + np.diag(ahead - θ)]), DIFFERENCES
    widths = np.where(θ + DIFFERENCES > HIGH, -DIFFERENCES, DIFFERENCES)
    return np.vstack([θ, θ + np.diag(widths)]), widths


def _slopes(simulated: Callable[[Array], Score], here: Score, beside: list[Score], θ: Array, widths: Array) -> tuple[Array, list[Score]]:
    """∂E/∂θ [3], and what had to be simulated on the other side; 0 where both sides fail."""
    slopes, more = np.zeros(3), []
    for k, (there, width) in enumerate(zip(beside, widths)):
        if not np.isfinite(there.loss):
            width = -width
            there = simulated(np.clip(θ + width * np.eye(3)[k], LOW, HIGH))
            more.append(there)
        if np.isfinite(there.loss):
            slopes[k] = (there.loss - here.loss) / width
    return slopes, more


def _moved(now: Descent, here: Score, spent: list[Score], slopes: Array, iterations: int, as_released: bool) -> Descent:
    """One joint step of Adam, clamped to the ranges."""
    n = len(now.history)
    unit = np.ones(3) if as_released else HIGH - LOW
    first_rate, last_rate = RATE_AS_RELEASED if as_released else RATE
    rate = last_rate + (first_rate - last_rate) * (1 + np.cos(np.pi * n / max(iterations, 1))) / 2
    g = slopes * unit
    m, v = β1 * now.first + (1 - β1) * g, β2 * now.second + (1 - β2) * g**2
    step = rate * (m / (1 - β1 ** (n + 1))) / (np.sqrt(v / (1 - β2 ** (n + 1))) + ε * _scale(v))
    row = {
        "loss": here.loss,
        "rms_mm": 1e3 * float(np.sqrt(here.loss)),
        "mean_mm": here.mean_mm,
        "density": float(now.θ[0]),
        "kappa_s": float(now.θ[1]),
        "kappa_b": float(now.θ[2]),
        "steps": sum(s.steps for s in spent),
        "seconds": sum(s.seconds for s in spent),
    }
    best = now.θ if here.loss < now.best_loss else now.best
    return replace(now, θ=np.clip(now.θ - step * unit, LOW, HIGH), first=m, second=v, best=best, history=(*now.history, row))


def _scale(v: Array) -> float:
    """Adam's ε presumes gradients near 1; ours are square metres, so it is taken relative to the largest."""
    return float(np.sqrt(v.max())) or 1.0


def at_ends(descent: Descent) -> dict[str, str]:
    """Name of a base parameter -> at which end of its range the best point lies; none for those between."""
    found = {}
    for k, name in enumerate(PARAMETERS, 1):
        for end, value in (("lower", LOW[k]), ("upper", HIGH[k])):
            if abs(descent.best[k] - value) <= AT_END * (HIGH[k] - LOW[k]):
                which = f"at the {end} end of Algorithm 1's range, {LOW[k]:g} to {HIGH[k]:g}"
                found[name] = f"{which}: the recording does not limit it on this side"
    return found


def found_fabric(fabric: Fabric, descent: Descent, *, density: float | None = None) -> Fabric:
    """The best fabric of a search; with a density that was weighed, the one of that density that moves alike."""
    ρ, κ_s, κ_b = (float(value) for value in descent.best)
    c = 1.0 if density is None else density / ρ
    return replace(fabric, density=c * ρ, membrane=c * κ_s, bending=c * κ_b)
