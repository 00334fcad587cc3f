"""A replay that goes on after a difficulty: from its last good frame, with a smaller step or a looser start, at most as often as allowed.

A simulation can stall (Newton's method does not converge), crawl (a frame costs more processor time than allowed) or have been killed
(frames of an earlier process are handed in). One that left where it stood goes on as if nobody had killed it. Attempt n takes 2ⁿ times the
substeps; the last one also settles for ten times the residual. Where not even the first step succeeded, the start is loosened: at rest
instead of at the observed velocity, and allowed to lie twice as near.

Tangents are linear in their start, so what a column held at the last good frame enters the next attempt as a mode of its start state.
BDF2 begins anew with one backward Euler step: such a restart costs accuracy of the order of one step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.simulator import Cloth, Collider, Fabric, Frame, Settings, Standing, simulate
from tasks.simulator.newton import CONVERGED

Array = NDArray[np.float64]
OnFrame = Callable[[Sequence[Frame], Standing | None], None]
BEFORE = " before"  # marks the column that carries on what was gathered in earlier attempts


@dataclass(frozen=True)
class Patience:
    """attempts: how often a replay may be begun or gone on with, in all; frame_s [s]: processor time that a frame may take."""

    attempts: int = 3
    frame_s: float = 600.0


PATIENT = Patience()


@dataclass(frozen=True)
class Drive:
    """What is simulated: cloth on a collider with its motion [T, C, 3] m, boundary_motion [T, B, 3] m, start x0 [V, 3] m, v0 [V, 3] m/s, fps."""

    cloth: Cloth
    collider: Collider
    collider_motion: Array
    boundary_motion: Array
    x0: Array
    v0: Array
    fps: float


@dataclass(frozen=True)
class Journey:
    """The frames reached, how the last attempt ended, and why there was more than one."""

    frames: tuple[Frame, ...]
    ending: str
    reasons: tuple[str, ...]


def persevere(
    drive: Drive,
    fabric: Fabric,
    settings: Settings,
    *,
    tangents: tuple[str, ...] = (),
    patience: Patience = PATIENT,
    kept: Sequence[Frame] = (),
    standing: Standing | None = None,
    on_frame: OnFrame = lambda frames, standing: None,
) -> Journey:
    """All frames of a drive, or as many as can be had. `on_frame` hears of all so far after each, and where the first attempt stands.

    kept: frames of a process that was killed, and where it stood if it is to go on in the same way.
    """
    frames, reasons = list(kept), []
    eased = bool(kept) and standing is None
    if eased:
        reasons.append(f"killed after frame {len(kept) - 1}: gone on from there with twice the substeps")
    ending = CONVERGED
    for attempt in range(eased, patience.attempts + eased):
        now, start = _eased(settings, drive, attempt, last=attempt + 1 >= patience.attempts, begun=len(frames) > 1)
        if len(frames) <= 1 and attempt:
            frames = []
        anew = not attempt  # as if nothing had happened: from the start, or from where it stood
        ending = _go_on(start, fabric, now, tangents, patience, frames, on_frame, standing if anew else None, anew=anew)
        if ending == CONVERGED:
            break
        reasons.append(f"attempt {attempt + 1}, {now.substeps} substeps, after frame {max(len(frames) - 1, 0)}: {ending}")
    return Journey(tuple(frames), ending, tuple(reasons))


def _eased(settings: Settings, drive: Drive, attempt: int, *, last: bool, begun: bool) -> tuple[Settings, Drive]:
    if not attempt:
        return settings, drive
    eased = replace(settings, substeps=settings.substeps * 2**attempt)
    if last:
        eased = replace(eased, acceleration_tolerance=10 * settings.acceleration_tolerance)
    if begun:
        return eased, drive
    return replace(eased, barrier_distance=settings.barrier_distance / 2), replace(drive, v0=np.zeros_like(drive.v0))


def _go_on(
    drive: Drive,
    fabric: Fabric,
    settings: Settings,
    tangents: tuple[str, ...],
    patience: Patience,
    frames: list[Frame],
    on_frame: OnFrame,
    standing: Standing | None,
    *,
    anew: bool,
) -> str:
    """Append frames from the start or `standing` on, or else from the last one on by a simulation that begins there; how it ended."""
    first = 0 if anew else max(len(frames) - 1, 0)
    last = None if anew or not frames else frames[-1]
    modes = {name + BEFORE: last.tangents[name] for name in tangents} if last else {}
    stood: list[Standing] = []
    walk = simulate(
        drive.cloth,
        fabric,
        drive.collider,
        collider_motion=drive.collider_motion[first:],
        boundary_motion=drive.boundary_motion[first:],
        fps=drive.fps,
        x0=last.x if last else drive.x0,
        v0=last.v if last else drive.v0,
        settings=settings,
        tangents=tangents,
        start_modes=modes,
        resume=standing,
        on_standing=stood.append,
    )
    for frame in walk:
        if last is not None and frame.index == 0:
            if not frame.converged:
                return frame.ending
            continue
        if not frame.converged:
            if frame.index == 0:
                frames.append(frame)  # where the start stands, for a report of what could not begin
            return frame.ending
        frames.append(replace(frame, index=first + frame.index, tangents=_summed(frame, tangents)))
        on_frame(frames, stood[-1] if anew else None)
        stood.clear()
        if frame.seconds > patience.frame_s and len(frames) < len(drive.collider_motion):
            return f"slow: the frame took {frame.seconds:.0f} s, {patience.frame_s:.0f} s are allowed"
    return CONVERGED


def _summed(frame: Frame, tangents: tuple[str, ...]) -> dict[str, tuple[Array, Array]]:
    """Columns gathered in this attempt and in those before it."""
    found = {}
    for name in tangents:
        dx, dv = frame.tangents[name]
        before_x, before_v = frame.tangents.get(name + BEFORE, (0.0, 0.0))
        found[name] = (dx + before_x, dv + before_v)
    return found
