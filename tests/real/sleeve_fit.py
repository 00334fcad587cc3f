"""The recorded sleeve fitted: fabric, friction, and what its geometry leaves open, as parameters with priors, by Gauss–Newton.

One simulation serves all places: the arm swings alike in all runs, so it is driven by the mean of repeats 1–3, and compared with the mean
trajectory of each place in the frame of the arm. The start of `clamps_across` is the mean offset of all places on repeats 1–3.

    minimise  Σ_places N/T Σ_t ‖ȳ − y(θ)‖²/σ²  +  Σ (θ − θ₀)²/s²        N independent instants per swing record, σ the spread of repeats

Clamp positions, the thickness of the arm and the time offset move what drives the cloth: they are motion modes, so tangents know them too.
"""

from dataclasses import dataclass, replace

import numpy as np

from tasks.simulator import Fabric, Settings, simulate
from tests.real.sleeve_model import CLAMPS, JERSEY, PLATE, ROW_1, Sleeve, arm_plate, at_rest, joined, posed, raised, sleeve
from tests.real.sleeve_recording import DOWN, PAIRS, RATE, Run, arm_frame, in_arm_frame, read_run

TRAIN, TEST = (1, 2, 3), (4, 5)
LEFT_OUT = (5, 9, 13)  # places that no fit sees: a middle one, one at the fold, the hem
SPREAD, INSTANTS = 2.2e-3, 12.0  # σ [m] of a place between repeats, N
CLAMP_ACROSS = 0.038  # [m] of each clamp from the middle of the arm, the author's model
LAYER = 2e-3  # [m] of a layer's nodes off the arm
HANG, RAISE, HOLD = 8, 20, 4  # frames before the recording begins
PRIOR = {  # name: (start, standard deviation)
    "log_membrane": (0.0, 1.0),  # relative to the guessed jersey
    "log_bending": (0.0, 1.0),
    "friction": (0.3, 0.15),
    "clamp_seam": (0.0, 0.03),  # [m] down the arm from where a photograph shows it
    "clamp_fold": (0.0, 0.03),
    "clamps_across": (-0.02, 0.02),  # [m] both to one side
    "clamps_out": (0.0, 0.01),  # [m] off the plane of the arm
    "thickness": (PLATE, 0.004),  # [m] of the arm
    "delay": (0.0, 0.015),  # [s] of the sleeve's recording behind the arm's
}
SETTINGS = Settings(substeps=2, gravity=tuple(9.81 * DOWN), barrier_distance=8e-4)


def mean_arm() -> Run:
    """The mean motion of the arm over repeats 1–3 of all pairs."""
    runs = [read_run(pair, r) for pair in PAIRS for r in TRAIN]
    return Run(runs[0].time, np.mean([r.s1 for r in runs], 0), np.mean([r.s2 for r in runs], 0), {})


def trajectories(repeats: tuple[int, ...]) -> dict[int, list[np.ndarray]]:
    """Every place's paths [T, 3] m in the frame of the arm."""
    found = {}
    for pair in PAIRS:
        for r in repeats:
            run = read_run(pair, r)
            for place in pair:
                found.setdefault(place, []).append(in_arm_frame(run, run.places[place]))
    return found


@dataclass(frozen=True)
class Swing:
    """Places in the frame of the arm, {number: [T, 3]} m, their derivatives {number: [T, 3, P]} in the order of PRIOR, and how it ended."""

    places: dict[int, np.ndarray]
    columns: dict[int, np.ndarray]
    ending: str


def swing(θ: dict[str, float], *, around: int = 6, along: int = 9, settings: Settings = SETTINGS, tangents: bool = True) -> Swing:
    """Simulate the mean swing with these parameters."""
    run, garment = mean_arm(), _clamped(sleeve(around=around, along=along), around)
    motion = _with_approach(run)
    fabric = _fabric(θ)
    boundary, arm, modes, collider = _driven(garment, motion, θ)
    start = posed(garment.x_arm, motion, link=1)[0]
    frames = list(
        simulate(
            garment.cloth,
            fabric,
            collider,
            collider_motion=arm,
            boundary_motion=boundary,
            fps=RATE,
            x0=start,
            settings=settings,
            tangents=("log_membrane", "log_bending", "friction") if tangents else (),
            motion_modes=modes if tangents else {},
        )
    )
    ending, skip = frames[-1].ending, HANG + RAISE + HOLD
    if ending != "converged":
        return Swing({}, {}, ending)
    recorded = frames[skip:]
    axes = arm_frame(run.s1, run.s2)
    places, columns = {}, {}
    for number, (nodes, w) in garment.places.items():
        x = np.stack([w @ f.x[nodes] for f in recorded])
        delayed = -np.gradient(x, 1 / RATE, axis=0)
        places[number] = np.einsum("tij,tj->ti", axes, x - run.s2 + θ["delay"] * delayed)
        if tangents:
            d = [np.stack([w @ f.tangents[n][0][nodes] for f in recorded]) if n != "delay" else delayed for n in PRIOR]
            columns[number] = np.einsum("tij,tjp->tip", axes, np.stack(d, -1))
    return Swing(places, columns, ending)


def secants(θ: dict[str, float], at: Swing) -> Swing:
    """The swing with derivatives from steps of half a prior's deviation, one simulation each.

    Tangents follow one history of contact: after four seconds they have grown with every fold that could fall either way, and a step
    along them is a thousandth of what it should be. Steps of a realistic size average over that.
    """
    columns = {place: [] for place in at.places}
    for name, (_, s) in PRIOR.items():
        there = swing(θ | {name: θ[name] + s / 2}, tangents=False)
        for place, x in at.places.items():
            columns[place].append((there.places[place] - x) / (s / 2) if there.places else np.zeros_like(x))
    return replace(at, columns={place: np.stack(c, -1) for place, c in columns.items()})


def improved(θ: dict[str, float], at: Swing, *, damping: float = 0.0) -> dict[str, float]:
    """One Gauss–Newton step with the priors; strengths stay physical."""
    A, g = np.zeros((len(PRIOR), len(PRIOR))), np.zeros(len(PRIOR))
    for place, paths in trajectories(TRAIN).items():
        if place in LEFT_OUT:
            continue
        r, J = np.mean(paths, 0) - at.places[place], at.columns[place]
        weight = INSTANTS / len(r) / SPREAD**2
        A += weight * np.einsum("tip,tiq->pq", J, J)
        g += weight * np.einsum("tip,ti->p", J, r)
    for k, (name, (start, s)) in enumerate(PRIOR.items()):
        A[k, k] += 1 / s**2
        g[k] += (start - θ[name]) / s**2
    scale = np.array([s for _, s in PRIOR.values()])
    step = np.linalg.solve(A + damping * np.diag(np.diag(A)), g)
    step = np.clip(step, -scale, scale)  # at most one standard deviation at once
    new = {name: θ[name] + float(d) for name, d in zip(PRIOR, step)}
    return new | {"friction": max(new["friction"], 0.0), "thickness": max(new["thickness"], 1e-3)}


def misfit(θ: dict[str, float], at: Swing) -> float:
    """What `improved` lowers; infinite where the simulation failed."""
    if not at.places:
        return np.inf
    total = sum(((θ[name] - start) / s) ** 2 for name, (start, s) in PRIOR.items())
    for place, paths in trajectories(TRAIN).items():
        if place not in LEFT_OUT:
            total += INSTANTS * np.mean(np.sum((np.mean(paths, 0) - at.places[place]) ** 2, 1)) / SPREAD**2
    return float(total)


def held_out_mm(at: Swing) -> dict[int, float]:
    """Root mean square error [mm] per place on repeats 4 and 5, in three dimensions."""
    return {
        place: 1e3 * float(np.sqrt(np.mean([np.sum((path - at.places[place]) ** 2, 1) for path in paths])))
        for place, paths in trajectories(TEST).items()
    }


def _with_approach(run: Run) -> Run:
    up = raised(run, RAISE)
    still = Run(np.zeros(HOLD), np.tile(up.s1[-1], (HOLD, 1)), np.tile(up.s2[-1], (HOLD, 1)), {})
    return joined(at_rest(run, HANG), up, still, run)


def _fabric(θ: dict[str, float]) -> Fabric:
    membrane, bending = (float(np.exp(θ[k])) for k in ("log_membrane", "log_bending"))
    return replace(JERSEY, membrane=JERSEY.membrane * membrane, bending=JERSEY.bending * bending, friction=θ["friction"])


def _driven(garment: Sleeve, motion: Run, θ: dict[str, float]):
    """Motion of the clamped nodes and of the arm, their modes, and the arm's faces.

    The clamps press both layers onto the arm at the columns of places 1 and 3: while the arm hangs they close from the round tube of the start.
    """
    here, seam = garment.x_arm[garment.cloth.boundary], garment.x_arm[garment.cloth.boundary, 1] < 0
    front = np.where(here[:, 2] >= 0, 1.0, -1.0)
    origin = posed(np.zeros((1, 3)), motion, link=1)
    axis = [posed(np.eye(3)[k][None], motion, link=1) - origin for k in range(3)]  # along, across, out: [T, 1, 3]
    closed = np.minimum(np.arange(len(motion.time)) / HANG, 1.0)[:, None, None]
    across = np.where(seam, -CLAMP_ACROSS, CLAMP_ACROSS)
    to = np.stack([here[:, 0], across, front * (PLATE / 2 + LAYER)], 1)
    modes = {
        "clamp_seam": closed * axis[0] * seam[None, :, None],
        "clamp_fold": closed * axis[0] * ~seam[None, :, None],
        "clamps_across": closed * axis[1] * np.ones((1, len(here), 1)),
        "clamps_out": closed * axis[2] * front[None, :, None],
    }
    boundary = (1 - closed) * posed(here, motion, link=1) + closed * posed(to, motion, link=1)
    boundary = boundary + sum(θ[name] * mode for name, mode in modes.items())
    arm, collider = arm_plate()
    half = np.sign(arm[:, 2]) / 2
    thick = arm * [1, 1, 0] + np.outer(half, [0, 0, θ["thickness"]])
    path = posed(thick, motion)
    grown = posed(thick + np.outer(half, [0, 0, 1.0]), motion) - path
    still = np.zeros_like(path)
    pairs = {name: (still, mode) for name, mode in modes.items()} | {"thickness": (grown, np.zeros_like(boundary))}
    return boundary, path, pairs, collider


def _clamped(garment: Sleeve, around: int) -> Sleeve:
    """The sleeve held by both layers at the columns of places 1 and 3, where the photograph shows the clamps."""
    ring = 2 * around
    nodes = []
    for place, height in ((1, CLAMPS["seam"]), (3, CLAMPS["fold"])):
        column = int(garment.places[place][0][0]) % ring
        row = int(np.argmin(np.abs(garment.x_arm[column::ring, 0] - (ROW_1 + height))))
        nodes += [row * ring + c for c in (column, ring - column)]
    return replace(garment, cloth=replace(garment.cloth, boundary=np.unique(nodes).astype(np.int32)))
