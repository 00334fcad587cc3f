"""Knitted strips pulled between clamps (Singal et al., Nature Communications 2024): the recorded forces, and the clamped strip as simulated
cloth.

q = force over width [N/m] against e = d/d₀ − 1, with d₀ the median of the first three rows of a repeat. Repeats 1–3 train, 4 and 5 test. X
is pulled along the courses (weft, u), Y along the wales (warp, v). The strip is W wide and d₀ long, its two ends held at full width: what
the ratio of length to width does is simulated, not read off. Quasi-static: steps of a second, no gravity, so that inertia is no more than a
regulariser.
"""

import os
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import product
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize

from tasks.effects.effect import Subject
from tasks.effects.fabric_stiffening import Stiffening
from tasks.simulator import NO_COLLIDER, Cloth, Fabric, Settings, simulate
from tasks.simulator.membrane_stvk import MembraneStVK
from tests.simulator.scenes import sheet

FABRICS = ("acrylic_rib", "cotton_seed", "cotton_stockinette")  # acrylic garter x has a width that is very probably a wrong entry
TRAIN, TEST = (1, 2, 3), (4, 5)
SECOND = Settings(integrator="backward_euler", substeps=1, gravity=(0, 0, 0), acceleration_tolerance=0.1)
CELLS, LEVELS = 6, 9
STIFFEST = 1e4  # c, the end of the effect's range
STEEPEST = 2.4  # |a|: a rib is more orthotropic than the effect's plausible range of 1.2


def folder() -> Path:
    """Where the recordings are."""
    return Path(os.environ.get("PHYSAVATAR_REAL_DATA", Path(__file__).parents[3] / "shared" / "data")) / "knit"


@dataclass(frozen=True)
class Pull:
    """width, gauge [m]; strain and force per width [N/m] of the training and test rows; ratio of lateral to longitudinal strain."""

    width: float
    gauge: float
    train: tuple[np.ndarray, np.ndarray]
    test: tuple[np.ndarray, np.ndarray]
    contraction: float


@lru_cache
def read(fabric: str, direction: str) -> Pull:
    """One file."""
    lines = (folder() / f"{fabric}_{direction}.csv").read_text().splitlines()
    width = float(lines[0].split(":")[1]) * 1e-3
    names = lines[1].split(",")
    rows = np.array([[float(v) for v in line.split(",")] for line in lines[2:]])
    column = {n.strip(): rows[:, k] for k, n in enumerate(names)}
    parts, gauges, slopes = {}, [], []
    for r in (*TRAIN, *TEST):
        on = column["repeat"] == r
        d, f, pins = (column[k][on] for k in ("clamp_distance_mm", "force_N", "lateral_pin_distance_mm"))
        d0 = np.median(d[:3])
        gauges.append(d0)
        e = d / d0 - 1
        parts[r] = e, f / width
        slopes.append(-np.polyfit(e, pins / np.median(pins[:3]) - 1, 1)[0])
    join = lambda repeats: tuple(np.concatenate([parts[r][k] for r in repeats]) for k in (0, 1))  # noqa: E731
    return Pull(width, float(np.median(gauges)) * 1e-3, join(TRAIN), join(TEST), float(np.median(slopes)))


@dataclass(frozen=True)
class Knit:
    """A material up to its stiffness: orthotropy a, stiffening c, Poisson's ratio ν. One stretch E·t [N/m] multiplies all forces."""

    orthotropy: float = 0.0
    stiffening: float = 0.0
    poisson: float = Fabric().poisson


@cache
def curve(knit: Knit, width: float, gauge: float, along: str, most: float) -> PchipInterpolator:
    """q/(E t) [1] of the clamped strip as a function of e, up to `most`."""
    x, faces = sheet(CELLS + 1, CELLS + 1, length=gauge, width=width)
    ends = np.r_[0 : CELLS + 1, len(x) - CELLS - 1 : len(x)]
    uv = x[faces][:, :, [0, 2]] if along == "x" else x[faces][:, :, [2, 0]]
    cloth = Cloth(x, faces, ends, uv=uv, rest_angles="flat")
    fabric = Fabric(membrane=10.0, orthotropy=knit.orthotropy, poisson=knit.poisson)
    subject = Subject(cloth, fabric, NO_COLLIDER, np.full(len(x), "free"), 1.0)
    stiffening = Stiffening(subject, knit.stiffening)
    e = most * np.linspace(0, 1, LEVELS)
    held = np.tile(x[ends], (LEVELS, 1, 1))
    held[:, CELLS + 1 :, 0] += gauge * e[:, None]
    frames = list(
        simulate(
            cloth,
            fabric,
            NO_COLLIDER,
            collider_motion=np.zeros((LEVELS, 0, 3)),
            boundary_motion=held,
            fps=1.0,
            settings=SECOND,
            potentials=(stiffening,),
        )
    )
    assert frames[-1].converged, frames[-1].ending
    membrane = MembraneStVK.of(cloth, fabric)
    pull = [float(np.sum((membrane.gradient(f.x, None) + stiffening.gradient(f.x, None))[ends[CELLS + 1 :], 0])) for f in frames]
    return PchipInterpolator(e, np.array(pull) / width / fabric.stretch_stiffness)


def predicted(knit: Knit, fabric: str, part: str) -> tuple[np.ndarray, np.ndarray]:
    """q/(E t) predicted and q measured [N/m] at the rows of `part` ("train", "test") of both directions."""
    guess, measured = [], []
    for direction in "xy":
        pull = read(fabric, direction)
        e, q = getattr(pull, part)
        most = max(pull.train[0].max(), pull.test[0].max())
        guess.append(curve(knit, pull.width, pull.gauge, direction, float(most))(np.maximum(e, 0)))
        measured.append(q)
    return np.concatenate(guess), np.concatenate(measured)


def stretch(knit: Knit, fabric: str) -> float:
    """E t [N/m] of least squares on the training rows: forces are proportional to it."""
    guess, measured = predicted(knit, fabric, "train")
    return float(guess @ measured / (guess @ guess))


def rms(knit: Knit, fabric: str, part: str) -> float:
    """Root mean square error [N/m], with E t from the training rows."""
    guess, measured = predicted(knit, fabric, part)
    return float(np.sqrt(np.mean((stretch(knit, fabric) * guess - measured) ** 2)))


def fitted(fabric: str, *, orthotropic: bool, stiffening: bool, poisson: float = Fabric().poisson) -> Knit:
    """The material of least error on the training rows (over a and log(1 + c): a grid, then Nelder & Mead 1965 from its best point)."""

    def knit(θ: np.ndarray) -> Knit:
        a, s = orthotropic * np.clip(θ[0], -STEEPEST, STEEPEST), stiffening * np.clip(θ[-1], 0, np.log1p(STIFFEST))
        return Knit(round(float(a), 4), round(float(np.expm1(s)), 4), poisson)

    if not orthotropic and not stiffening:
        return Knit(poisson=poisson)
    spans = [np.linspace(-2.0, 2.0, 9)] * orthotropic + [np.linspace(0.0, 6.0, 7)] * stiffening
    error = lambda θ: rms(knit(θ), fabric, "train")  # noqa: E731
    best = min((np.array(θ) for θ in product(*spans)), key=error)
    corners = np.vstack([best, best + 0.4 * np.eye(len(best))])
    found = minimize(error, best, method="Nelder-Mead", options={"initial_simplex": corners, "xatol": 0.01, "fatol": 0.01})
    return knit(found.x)


def stiffness_ratio(fabric: str, knit: Knit, *, up_to: float = 0.15) -> float:
    """How many times stiffer the simulated X strip is than the Y strip up to a strain, in secants of force per width."""
    secant = []
    for direction in "xy":
        pull = read(fabric, direction)
        secant.append(float(curve(knit, pull.width, pull.gauge, direction, 0.2)(up_to)))
    return secant[0] / secant[1]


def measured_ratio(fabric: str, *, up_to: float = 0.15) -> float:
    """The same of the recorded strips: least squares through zero up to the strain."""
    secant = []
    for direction in "xy":
        e, q = read(fabric, direction).train
        low = (e > 0) & (e < up_to)
        secant.append(float(e[low] @ q[low] / (e[low] @ e[low])))
    return secant[0] / secant[1]
