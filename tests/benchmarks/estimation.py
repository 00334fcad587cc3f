"""Fabrics found again: twins of known fabric, Algorithm 1 against Gauss–Newton, and C-IPC's own trajectories as observation.

    python -m tests.benchmarks.estimation     QUICK=1: a tenth     JSON=1: JSON on stdout     ONLY=word: parts whose name contains it

Every case is kept below PHYSAVATAR_CACHE (default ~/.cache/physavatar) and not computed again by a run with the same code.
"""

import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from tasks.cloth import gauss_newton
from tasks.cloth.adam_fd import ITERATIONS, Descent, as_algorithm_1, descend
from tasks.cloth.checkpoints import load_descent, save_descent
from tasks.cloth.driven_motion import quieted
from tasks.cloth.estimates import Z90, insensitive
from tasks.cloth.gauss_newton import PARAMETERS, Normal, Progress, fit, moved, normal_equations
from tasks.cloth.scene import Scene, replay
from tasks.cloth.windowed_fit import fit_windows, started_well
from tasks.simulator import Fabric, Settings
from tests.benchmarks.simulator import AS_CIPC, DATA, recording
from tests.cloth.twins import FPS, handkerchief, twin
from tests.test_science_lock import digest

QUICK = bool(os.environ.get("QUICK"))
START = Fabric(320.0, 4.0, 100.0)
TWINS = 2 if QUICK else 20
MESHES = {"coarse": (14, 28), "fine": (19, 38)} if QUICK else {}
SMALL = {"coarse": (7, 14), "fine": (9, 18)}
Row = tuple[str, Any, str, bool]


def cache() -> Path:
    """Where cases are kept."""
    folder = Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser() / "bench-estimation"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def code() -> str:
    """The state of the code that the cases depend on."""
    whole = digest("tasks.cloth.stage") + Path(__file__).read_text() + (Path(__file__).parents[1] / "cloth/twins.py").read_text()
    return hashlib.sha256(whole.encode()).hexdigest()[:12]


def kept(name: str, compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The case of that name, computed once per state of the code."""
    file = cache() / f"{name}-{code()}.json"
    if not file.exists():
        file.write_text(json.dumps(compute()))
    return json.loads(file.read_text())


def one_twin(seed: int) -> dict[str, Any]:
    """One twin fitted by the default method: logarithms of estimate over truth, their standard deviations, seconds."""
    made = twin(seed, **MESHES)
    clock = time.process_time()
    scene = started_well(replace(made.scene, boundary_motion=quieted(made.scene.boundary_motion, 1e-3)), START)
    found = fit_windows(scene, START)
    ratio = np.log([found.fabric.membrane / made.fabric.membrane, found.fabric.bending / made.fabric.bending])
    deviation = np.sqrt(np.diag(found.covariance))
    said = insensitive(scene, made.fabric)
    return {"log_ratio": ratio.tolist(), "deviation": deviation.tolist(), "ending": found.ending, "insensitive": said} | {
        "seconds": time.process_time() - clock,
        "rms_mm": found.history[-1]["rms_mm"],
    }


def twins() -> Iterator[Row]:
    """Errors and coverage."""
    cases = [kept(f"twin-{seed}-{'quick' if QUICK else 'full'}", lambda seed=seed: one_twin(seed)) for seed in range(TWINS)]
    errors = np.abs(np.expm1([c["log_ratio"] for c in cases]))
    for p, (name, target) in enumerate((("kappa_s/rho", 0.10), ("kappa_b/rho", 0.20))):
        median = float(np.median(errors[:, p]))
        yield f"twins: {name}, median error of {len(cases)}", median, f"<= {target:.2f}", median <= target
        inside = sum(abs(c["log_ratio"][p]) <= Z90 * c["deviation"][p] for c in cases)
        low, high = wilson(inside, len(cases))
        yield f"twins: {name}, truth inside the 90 % interval", inside / len(cases), f"0.9 in [{low:.2f}, {high:.2f}]", low <= 0.9 <= high
    yield "twins: CPU seconds per fit, median", float(np.median([c["seconds"] for c in cases])), "<= 90", True
    limp = kept("limp", said_of_a_limp_twin)
    yield "a bending length below 1.3 edges is called insensitive", limp["said"], "yes", limp["said"]


def said_of_a_limp_twin() -> dict[str, Any]:
    """What is said of a fabric whose bending the mesh cannot resolve."""
    scene = twin(0, frames=3, settings=Settings(substeps=2), fabric=Fabric(320.0, 2.0, 20.0), **SMALL).scene
    return {"said": "insensitive" in insensitive(scene, Fabric(320.0, 2.0, 20.0))}


def wilson(k: int, n: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a share k/n (Wilson 1927)."""
    p, d = k / n, 1 + z**2 / n
    centre, half = (p + z**2 / (2 * n)) / d, z / d * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    return float(centre - half), float(centre + half)


def race(seed: int, iterations: int) -> dict[str, Any]:
    """Algorithm 1 and Gauss–Newton on a handkerchief, whose bending the seed's range can show: same simulator, integrator, start and loss."""
    once = Settings(integrator="backward_euler", substeps=1)
    truth = Fabric(320.0, 3.0, 6.0)
    scene = as_algorithm_1(handkerchief(seed, settings=once, fabric=truth).scene)
    part = cache() / f"race-{seed}-{iterations}-{code()}.part"
    start = load_descent(part, Descent.at([320.0, 1.0, 1.0]))
    slow = descend(scene, Fabric(), start, iterations=iterations, on_iteration=lambda descent: save_descent(part, descent))
    with watched(scene) as seen:
        found = fit(scene, Progress(Fabric()), iterations=15)
    reached = next(((s, t) for s, t, mse in seen if mse <= slow.best_loss), (None, None))
    return {
        "slow_steps": slow.steps,
        "slow_seconds": sum(row["seconds"] for row in slow.history),
        "slow_mm": 1e3 * slow.best_loss**0.5,
        "best_mm": 1e3 * min(mse for *_, mse in seen) ** 0.5,
        "quick_steps": reached[0],
        "quick_seconds": reached[1],
        "found": [found.fabric.membrane, found.fabric.bending],
        "slow_found": slow.best.tolist(),
    }


@contextmanager
def watched(scene: Scene) -> Iterator[list[tuple[int, float, float]]]:
    """(steps so far, processor seconds so far, mean squared distance [m²]) after every replay of a Gauss–Newton fit, rejected proposals included."""
    seen: list[tuple[int, float, float]] = []

    def counted(scene: Scene, *arguments: Any, **named: Any) -> Any:
        now = replay(scene, *arguments, **named)
        steps, seconds = seen[-1][:2] if seen else (0, 0.0)
        steps += (len(now.x) - 1) * scene.settings.substeps
        mse = float(np.mean(np.sum((scene.observed - now.x)[scene.compared] ** 2, 1))) if now.complete else np.inf
        seen.append((steps, seconds + now.seconds, mse))
        return now

    with mock.patch.object(gauss_newton, "replay", counted):
        yield seen


def races() -> Iterator[Row]:
    """Algorithm 1 beside Gauss–Newton."""
    runs = [(0, 10)] if QUICK else [(0, ITERATIONS), (1, 25), (2, 25)]
    for seed, iterations in runs:
        r = kept(f"race-{seed}-{iterations}", lambda seed=seed, iterations=iterations: race(seed, iterations))
        name = f"adam-fd, {iterations} iterations, twin {seed}"
        fewer = r["slow_steps"] / r["quick_steps"] if r["quick_steps"] else 0.0
        faster = r["slow_seconds"] / r["quick_seconds"] if r["quick_seconds"] else 0.0
        yield f"{name}: simulated steps over Gauss–Newton's to its loss", fewer, ">= 30", fewer >= 30
        yield f"{name}: processor time over Gauss–Newton's", faster, ">= 20", faster >= 20
        yield f"{name}: its loss, root [mm]", r["slow_mm"], "-", True
        yield f"{name}: Gauss–Newton's at the end [mm]", r["best_mm"], f"<= {r['slow_mm']:.3g}", r["best_mm"] <= r["slow_mm"]
    frozen = kept("frozen", density_as_released)
    yield "as released, 10 iterations: density moved [kg/m3 of 440]", frozen["moved"], "<= 1", frozen["moved"] <= 1


def density_as_released() -> dict[str, Any]:
    """How far the released code's Adam moves the density in ten iterations."""
    once = Settings(integrator="backward_euler", substeps=1)
    scene = as_algorithm_1(handkerchief(3, settings=once, fabric=Fabric(500.0, 3.0, 6.0)).scene)
    found = descend(scene, Fabric(), Descent.at([320.0, 1.0, 1.0]), iterations=10, as_released=True)
    return {"moved": abs(float(found.θ[0]) - 320.0)}


def cipc() -> Iterator[Row]:
    """C-IPC's frames as observation, one step from each: its known ratios found from a start at twice and three times them."""
    for name in ("sphere_1600",) if QUICK else ("skirt_base", "sphere_1600"):
        found = kept(f"cipc-{name}", lambda name=name: steps_of_cipc(name))
        for key, ratio in (("kappa_s/rho", found["membrane"]), ("kappa_b/rho", found["bending"])):
            yield f"C-IPC {name}: {key} over its own", ratio, "0.9 to 1.1", 0.9 <= ratio <= 1.1


def steps_of_cipc(name: str) -> dict[str, Any]:
    """Fit κ_s and κ_b to single backward Euler steps from C-IPC's frames k−1, k to its frame k+1."""
    cloth, true, collider, x, c = recording(name)
    settings = replace(AS_CIPC, bending="independent")
    scenes = []
    for k in range(2, len(x) - 1, 8 if QUICK else 4):
        observed = x[k : k + 2]
        scenes.append(
            Scene(
                cloth,
                collider,
                c[k : k + 2],
                observed[:, cloth.boundary],
                x[k],
                (x[k] - x[k - 1]) * FPS,
                observed,
                np.full(observed.shape[:2], 1e-5),
                FPS,
                settings,
            )
        )
    fabric = replace(true, membrane=2.0, bending=3.0)
    for _ in range(8):
        replays = [replay(s, fabric, tangents=PARAMETERS) for s in scenes]
        normals = [normal_equations(s, r) for s, r in zip(scenes, replays) if r.complete]
        step = Normal(np.concatenate([n.g for n in normals]), np.concatenate([n.A for n in normals])).step
        fabric = moved(fabric, np.clip(step, -1.2, 1.2))
        if np.abs(step).max() < 5e-3:
            break
    return {"membrane": fabric.membrane, "bending": fabric.bending, "steps": len(scenes)}


def main() -> None:
    """Print the table."""
    as_json, table, clock = bool(os.environ.get("JSON")), [], time.process_time()
    for name, part in {"races": races, "twins": twins, "cipc": cipc}.items():
        if os.environ.get("ONLY", "") not in name or (name == "cipc" and not DATA.exists()):
            continue
        for metric, value, target, holds in part():
            table.append({"metric": metric, "value": value, "target": target, "holds": holds})
            if not as_json:
                sys.stdout.write(f"{metric:80s} | {value:10.4g} | {target:22s} | {'yes' if holds else 'NO'}\n")
                sys.stdout.flush()
    if as_json:
        sys.stdout.write(json.dumps({"rows": table, "cpu_seconds": time.process_time() - clock}, indent=1) + "\n")


if __name__ == "__main__":
    main()
