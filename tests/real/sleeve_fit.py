"""The recorded sleeve fitted: fabric, friction, what its geometry leaves open, and strengths of effects, as parameters with priors, by
Gauss–Newton.

One simulation serves all places: the arm swings alike in all runs, so it is driven by the mean of repeats 1–3, and compared with the mean
trajectory of each place in the frame of the arm. The start of `clamps_across` is the mean offset of all places on repeats 1–3. The geometry
is known to a centimetre, and a sensor sits on the cloth: each place may be off by a constant δ ~ N(0, s_δ²) in each direction, which is
integrated out. With r = ȳ − y(θ), its mean r̄ over time and N independent instants per swing,

    minimise  Σ_places N/T Σ_t ‖r − r̄‖²/σ²  +  ‖r̄‖²/(σ²/N + s_δ²)  +  Σ (θ − θ₀)²/s²        σ the spread of repeats

Derivatives are differences over a third of a prior's deviation: tangents follow one history of contact, and after four seconds have grown
with every fold that could fall either way. For the same reason a difference that lowers the sum more than the step does is taken instead.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from tasks.effects.effect import Effect, Motion, Subject
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.simulator import Collider, Fabric, Settings
from tests.real.sleeve_model import CLAMPS, JERSEY, PLATE, ROW_1, Sleeve, arm_plate, at_rest, joined, posed, raised, sleeve
from tests.real.sleeve_recording import DOWN, PAIRS, RATE, Run, in_arm_frame, read_run

Array = np.ndarray
TRAIN, TEST = (1, 2, 3), (4, 5)
LEFT_OUT = (5, 9, 13)  # places that no fit sees: a middle one, one at the fold, the hem
SPREAD, INSTANTS = 2.2e-3, 12.0  # σ [m] of a place between repeats, N
OFFSET = 1e-2  # s_δ [m]
AROUND, ALONG = 6, 9  # cells of each layer
CLAMP_ACROSS = 0.038  # [m] of each clamp from the middle of the arm, the author's model
LAYER = 2e-3  # [m] of a layer's nodes off the arm
HANG, RAISE, HOLD = 8, 20, 4  # frames before the recording begins
SCAN = (0.0, 1.15, 2.3, 3.45)  # of log_bending
STEP = 0.3  # of a prior's deviation, in differences
PRIOR = {  # name: (start, standard deviation, low, high)
    "log_membrane": (0.0, 1.0, -np.inf, np.inf),  # relative to the guessed jersey
    "log_bending": (0.0, 1.5, -np.inf, np.inf),
    "friction": (0.3, 0.15, 0.0, np.inf),
    "clamp_seam": (0.0, 0.03, -np.inf, np.inf),  # [m] down the arm from where a photograph shows it
    "clamp_fold": (0.0, 0.03, -np.inf, np.inf),
    "clamps_across": (-0.02, 0.02, -np.inf, np.inf),  # [m] both to one side
    "clamps_out": (0.0, 0.01, -np.inf, np.inf),  # [m] off the plane of the arm
    "thickness": (PLATE, 0.004, 0.002, np.inf),  # [m] of the arm
    "delay": (0.0, 0.015, -np.inf, np.inf),  # [s] of the sleeve's recording behind the arm's
}
_UP = -DOWN / np.linalg.norm(DOWN)
_ACROSS = np.cross([0.0, 1.0, 0.0], _UP) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], _UP))
UPRIGHT = np.stack([np.cross(_UP, _ACROSS), _UP, _ACROSS])  # rows: axes with y up, as effects have them
SETTINGS = Settings(substeps=2, barrier_distance=8e-4)
Values = Mapping[str, float]
Places = Mapping[int, Array]


def mean_arm() -> Run:
    """The mean motion of the arm over repeats 1–3 of all pairs."""
    runs = [read_run(pair, r) for pair in PAIRS for r in TRAIN]
    return Run(runs[0].time, np.mean([r.s1 for r in runs], 0), np.mean([r.s2 for r in runs], 0), {})


@cache
def trajectories(repeats: tuple[int, ...]) -> dict[int, list[Array]]:
    """Every place's paths [T, 3] m in the frame of the arm."""
    found = {}
    for pair in PAIRS:
        for r in repeats:
            run = read_run(pair, r)
            for place in pair:
                found.setdefault(place, []).append(in_arm_frame(run, run.places[place]))
    return found


def start(effects: Iterable[str] = ()) -> dict[str, float]:
    """Where a fit begins: the priors' means, effects absent."""
    columns = (column for name in effects for column in library()[name].columns)
    return {name: prior[0] for name, prior in PRIOR.items()} | dict.fromkeys(columns, 0.0)


def scanned() -> dict[str, float]:
    """The start whose bending, of `SCAN`, misfits least: cloth that is too limp flaps otherwise at every step, and a fit crawls."""
    found = ({**start(), "log_bending": value} for value in SCAN)
    return min(found, key=lambda θ: misfit(θ, swing(θ)))


def prior(name: str) -> tuple[float, float, float, float]:
    """Mean, standard deviation, low and high of a parameter; of a strength: none, two and a half times the typical one, its plausible range."""
    if name in PRIOR:
        return PRIOR[name]
    effect, i = _effects([name])[0], _effects([name])[0].columns.index(name)
    s = effect.strengths[i]
    return 0.0, 2.5 * abs(s.typical), s.low, s.high


def swing(θ: Values) -> dict[int, Array]:
    """Simulate the mean swing; places in the frame of the arm {number: [T, 3]} m, none where the simulation failed.

    θ: the parameters of PRIOR, and strengths of effects by their columns.
    """
    run, garment = mean_arm(), _clamped(sleeve(around=AROUND, along=ALONG))
    path = _with_approach(run)
    motion, collider = _driven(garment, path, θ)
    effects = _effects(θ)
    strengths = {e.name: np.array([θ[c] for c in e.columns]) for e in effects}
    subject = Subject(garment.cloth, _fabric(θ), collider, _zones(garment), RATE)
    model = Model(subject, SETTINGS).joined(effects, strengths)
    x0 = posed(garment.x_arm, path, link=1)[0] @ UPRIGHT.T
    frames = list(model.run(motion, x0, np.zeros_like(x0)))
    if not frames[-1].converged:
        return {}
    x = (model.observed(np.stack([f.x for f in frames])) @ UPRIGHT)[HANG + RAISE + HOLD :]
    return {number: in_arm_frame(run, _delayed(np.einsum("k,tkj->tj", w, x[:, nodes]), θ)) for number, (nodes, w) in garment.places.items()}


def residual(θ: Values, places: Places) -> Array:
    """Whitened residuals of the training places, and of the priors."""
    parts = [np.array([(θ[name] - prior(name)[0]) / prior(name)[1] for name in θ])]
    for place, paths in trajectories(TRAIN).items():
        if place not in LEFT_OUT:
            r = np.mean(paths, 0) - places[place]
            parts += [
                np.sqrt(INSTANTS / len(r)) / SPREAD * (r - r.mean(0)).ravel(),
                r.mean(0) / np.hypot(SPREAD / np.sqrt(INSTANTS), OFFSET),
            ]
    return np.concatenate(parts)


def misfit(θ: Values, places: Places) -> float:
    """What a fit lowers; infinite where the simulation failed."""
    return float(np.sum(residual(θ, places) ** 2)) if places else np.inf


def fitted(
    θ: Values, *, iterations: int, run: Callable[..., Iterable[Any]] = map, tell: Callable[[str], None] = lambda text: None
) -> tuple[dict[str, float], dict[int, Array]]:
    """Gauss–Newton from θ over all that it names: the values of least misfit found, and their swing. run: a map, over processes perhaps."""
    θ, places = dict(θ), swing(θ)
    for _ in range(iterations):
        probes = [_probe(θ, name) for name in θ]
        swung = list(run(swing, probes))
        steps = _steps(θ, places, probes, swung)
        tried = [*zip(probes, swung, strict=True), *zip(steps, run(swing, steps), strict=True)]
        best, at = min(tried, key=lambda pair: misfit(*pair))
        if misfit(best, at) > 0.995 * misfit(θ, places):
            break
        θ, places = best, at
        tell(f"misfit {misfit(θ, places):.0f}: " + ", ".join(f"{name} {value:.3g}" for name, value in θ.items()))
    return θ, places


def _probe(θ: Values, name: str) -> dict[str, float]:
    _, s, _, high = prior(name)
    return {**θ, name: θ[name] + (STEP * s if θ[name] + STEP * s <= high else -STEP * s)}


def _steps(θ: Values, places: Places, probes: list[dict[str, float]], swung: list[dict[int, Array]]) -> list[dict[str, float]]:
    """Gauss–Newton's with growing damping, at most one standard deviation each, within the bounds."""
    r = residual(θ, places)
    Δ = np.array([probe[name] - θ[name] for probe, name in zip(probes, θ, strict=True)])
    J = np.stack([(residual(p, at) - r) / d if at else np.zeros_like(r) for p, at, d in zip(probes, swung, Δ, strict=True)], 1)
    A, found = J.T @ J, []
    _, s, low, high = np.array([prior(name) for name in θ]).T
    for damping in (0.05, 0.5, 5.0):
        step = np.clip(np.linalg.solve(A + damping * np.diag(np.diag(A)), -J.T @ r), -s, s)
        found.append(dict(zip(θ, np.clip(np.array([*θ.values()]) + step, low, high).tolist(), strict=True)))
    return found


def held_out_mm(places: Places) -> dict[int, tuple[float, float]]:
    """Root mean square errors [mm] per place on repeats 4 and 5, in three dimensions: as they are, and without the constant offset of repeats 1–3."""
    found = {}
    for place, paths in trajectories(TEST).items():
        offset = np.mean(trajectories(TRAIN)[place], (0, 1)) - places[place].mean(0)
        found[place] = tuple(1e3 * float(np.sqrt(np.mean([np.sum((p - places[place] - o) ** 2, 1) for p in paths]))) for o in (0.0, offset))
    return found


def _effects(names: Iterable[str]) -> list[Effect]:
    """Those whose columns are named."""
    wanted = set(names)
    return [e for e in library().values() if wanted & set(e.columns)]


def _delayed(x: Array, θ: Values) -> Array:
    return x - θ["delay"] * np.gradient(x, 1 / RATE, axis=0)


def _with_approach(run: Run) -> Run:
    up = raised(run, RAISE)
    still = Run(np.zeros(HOLD), np.tile(up.s1[-1], (HOLD, 1)), np.tile(up.s2[-1], (HOLD, 1)), {})
    return joined(at_rest(run, HANG), up, still, run)


def _fabric(θ: Values) -> Fabric:
    membrane, bending = (float(np.exp(θ[k])) for k in ("log_membrane", "log_bending"))
    return replace(JERSEY, membrane=JERSEY.membrane * membrane, bending=JERSEY.bending * bending, friction=θ["friction"])


def _zones(garment: Sleeve) -> Array:
    zone, ring = np.full(len(garment.x_arm), "free", "<U6"), 2 * AROUND
    zone[::ring], zone[-ring:], zone[garment.cloth.boundary] = "seam", "hem", "pinned"
    return zone


def _driven(garment: Sleeve, path: Run, θ: Values) -> tuple[Motion, Collider]:
    """Motion of the arm and of the clamped nodes, upright, and the arm's faces.

    The clamps press both layers onto the arm at the columns of places 1 and 3: while the arm hangs they close from the round tube of the
    start.
    """
    here = garment.x_arm[garment.cloth.boundary]
    seam, front = here[:, 1] < 0, np.where(here[:, 2] >= 0, 1.0, -1.0)
    along = here[:, 0] + np.where(seam, θ["clamp_seam"], θ["clamp_fold"])
    across = np.where(seam, -CLAMP_ACROSS, CLAMP_ACROSS) + θ["clamps_across"]
    clamped = np.stack([along, across, front * (PLATE / 2 + LAYER + θ["clamps_out"])], 1)
    closed = np.minimum(np.arange(len(path.time)) / HANG, 1.0)[:, None, None]
    boundary = (1 - closed) * posed(here, path, link=1) + closed * posed(clamped, path, link=1)
    arm, collider = arm_plate()
    arm = arm * [1, 1, θ["thickness"] / PLATE]
    return Motion(posed(arm, path) @ UPRIGHT.T, boundary @ UPRIGHT.T), collider


def _clamped(garment: Sleeve) -> Sleeve:
    """The sleeve held by both layers at the columns of places 1 and 3, where the photograph shows the clamps."""
    ring = 2 * AROUND
    nodes = []
    for place, height in ((1, CLAMPS["seam"]), (3, CLAMPS["fold"])):
        column = int(garment.places[place][0][0]) % ring
        row = int(np.argmin(np.abs(garment.x_arm[column::ring, 0] - (ROW_1 + height))))
        nodes += [row * ring + c for c in (column, ring - column)]
    return replace(garment, cloth=replace(garment.cloth, boundary=np.unique(nodes).astype(np.int32)))
