"""The account of a diagnosis: every figure that its report draws, as numbers, and as JSON beside the answer.

Nothing here simulates: all follows from the windows' evidence.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import Evidence
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Recording
from tasks.gap.acceleration import nameless_acceleration
from tasks.gap.budget import Item, budget
from tasks.gap.confusability import Confusability, confusability
from tasks.gap.constancy import Constancy, by_speed, by_window, by_zone, speeds
from tasks.gap.diagnosis import Diagnosis
from tasks.gap.hypotheses import Fitted
from tasks.gap.library_doubt import linear_rest
from tasks.gap.residual import rms_mm, weft_direction, where
from tasks.gap.screening import MODES, Screened
from tasks.gap.spectrum import Spectrum, spectrum
from tasks.gap.stretches import Stretch, stretches
from tasks.gap.zones import ZONES

Array = NDArray[np.float64]

COMPARED = 15  # effects whose signatures are compared
RIVALS = 6  # effects whose constancy is shown beside the named one's


@dataclass(frozen=True)
class Splits:
    """One zone's residual [mm] on the training windows: in all, and by direction name -> mm, before and after (None without a named effect)."""

    zone: str
    vertices: int
    before: dict[str, float]
    after: dict[str, float] | None


@dataclass(frozen=True)
class Account:
    """All but the answer itself.

    residual_mm [V]; missing [V] m/s², the nameless forcing beside the base, and its deviation [V]; added [V] m/s² by the named effect (None
    without one, or where it only changes what is seen); constancy: grouping -> effect; rivals: effect -> grouping; fields of `screened` are
    None or empty where nothing could be tested.
    """

    items: tuple[Item, ...]
    residual_mm: Array
    missing: Array
    deviation: Array
    added: Array | None
    splits: tuple[Splits, ...]
    evidence: tuple[Evidence, ...]
    stretches: tuple[Stretch, ...]
    before: Spectrum | None
    after: Spectrum | None
    singles: tuple[Fitted, ...]
    pairs: tuple[Fitted, ...]
    confusability: Confusability | None
    constancy: dict[str, dict[str, Constancy]]
    rivals: dict[str, dict[str, Constancy]]


def account(found: Diagnosis, recordings: Sequence[Recording]) -> Account:
    """Of a diagnosis of `recordings`."""
    residual = np.array([rms_mm(found.before[:, i]) for i in range(found.before.shape[1])])
    s, named, fps = found.screened, found.verdict.named, found.base.subject.fps
    if s is None:
        return Account((), residual, found.vertex_accel, np.full_like(residual, np.nan), None, (), (), (), None, None, (), (), None, {}, {})
    shown = stretches(found)
    noise = float(np.median([np.median(r.noise) for r in recordings]))
    singles = s.hypotheses
    speed = speeds(s.evidence, fps)
    linear = s.windows.fit(named.effects) if named else None  # about the base, as the windows' columns are
    mean, deviation = nameless_acceleration(s.windows, s.windows.base, smooth_modes(found.base.subject.cloth, MODES))
    return Account(
        items=budget(s, named, [h for c in found.verdict.ranking if c.fitted for h in (c.fitted, *c.others)]),
        residual_mm=residual,
        missing=np.sqrt(np.mean(np.sum(mean**2, -1), 0)),
        deviation=np.sqrt(np.mean(np.sum(deviation**2, -1), 0)),
        added=found.added,
        splits=_splits(found, s, linear),
        evidence=s.evidence,
        stretches=shown,
        before=spectrum([w.before for w in shown], fps, noise),
        after=spectrum([w.after for w in shown], fps, noise) if named else None,
        singles=singles,
        pairs=found.pairs,
        confusability=confusability(s.windows, [h.effects[0] for h in singles[:COMPARED]]),
        constancy=_constancy(s, linear, speed, found.zone) if linear else {},
        rivals={
            h.name: {"window": by_window(s.windows, h)[h.name], "speed": by_speed(s.windows, h, speed)[h.name]} for h in singles[:RIVALS]
        },
    )


def _constancy(s: Screened, named: Fitted, speed: Array, zone: NDArray[np.str_]) -> dict[str, dict[str, Constancy]]:
    return {"window": by_window(s.windows, named), "speed": by_speed(s.windows, named, speed), "zone": by_zone(s.evidence, named, zone)}


def _splits(found: Diagnosis, s: Screened, named: Fitted | None) -> tuple[Splits, ...]:
    done = [e for e in s.evidence if e.prediction.complete]
    before = np.concatenate([e.residual for e in done])
    after = np.concatenate([linear_rest(e, named) for e in done]) if named else None
    x = np.concatenate([e.prediction.x[1:] for e in done])
    zones = [z for z in dict.fromkeys(found.zone.tolist()) if z != "pinned"]
    free = np.flatnonzero(found.zone != "pinned")
    inside = {"all": free} | {str(z): np.flatnonzero(found.zone == z) for z in zones}
    cloth, fps = found.base.subject.cloth, found.base.subject.fps
    weft = (
        None
        if cloth.uv is None
        else weft_direction(x, cloth.faces, cloth.uv.reshape(-1, 2), np.arange(3 * len(cloth.faces)).reshape(-1, 3))
    )

    def along(r: Array, own: NDArray[np.int64]) -> dict[str, float]:
        seen = np.zeros(r.shape[:2], bool)
        seen[:, own] = True
        index = np.where(found.zone == "pinned", ZONES.index("pinned"), 0).astype(np.int32)
        told = where(x + r, x, seen=seen, noise_m=np.zeros(r.shape[:2]), zone=index, faces=cloth.faces, weft=weft, fps=fps)
        return {"all": told.rms_mm, **told.by_direction}

    return tuple(
        Splits(name, len(own), along(before, own), along(after, own) if after is not None else None)
        for name, own in inside.items()
        if len(own)
    )


def as_json(a: Account, found: Diagnosis) -> dict[str, Any]:
    """The account in plain JSON; None where a number is not finite."""
    c, s = a.confusability, found.screened
    return _plain(
        {
            "budget": [asdict(item) for item in a.items],
            "splits_mm": [asdict(s) for s in a.splits],
            "missing_accel": a.missing,
            "missing_accel_deviation": a.deviation,
            "forcing": {"base": s.windows.base.forcing, "leader": a.singles[0].forcing, "all": s.windows.forcing} if s else None,
            "added_accel": a.added,
            "training_windows": [_window(e) for e in a.evidence],
            "compared_windows": [
                {**asdict(w.window), "before_mm": w.before_mm, "after_mm": w.after_mm, "floor_mm": found.shrinkage.floor_mm}
                for w in a.stretches
            ],
            "spectra": {"before": a.before and asdict(a.before), "after": a.after and asdict(a.after)},
            "replayed": found.replayed
            and {
                "gap_mm": 1e3 * found.replayed.gap**0.5,
                "floor_mm": 1e3 * found.replayed.floor**0.5,
                "log_bayes_factor": found.replayed.something_missing,
            },
            "evidence": [
                {"effects": [e.name for e in h.effects], "weights": [asdict(w) for w in h.weights], "support": h.support}
                for h in (*a.singles, *a.pairs)
            ],
            "confusability": c and {**asdict(c), "testable": c.testable},
            "constancy": {grouping: {n: asdict(x) for n, x in own.items()} for grouping, own in a.constancy.items()},
            "rivals": {name: {grouping: asdict(x) for grouping, x in own.items()} for name, own in a.rivals.items()},
            "designs": [asdict(d) for d in found.designs],
            "base_refit": {"history": found.screened.base.history, "ending": found.screened.base.ending} if found.screened else None,
        }
    )


def _window(e: Evidence) -> dict[str, Any]:
    misfit = rms_mm(e.residual) if e.residual is not None else None
    return {**asdict(e.prediction.window), "ending": e.prediction.ending, "residual_mm": misfit}


def _plain(x: Any) -> Any:
    if isinstance(x, dict):
        return {str(k): _plain(v) for k, v in x.items()}
    if isinstance(x, (list, tuple, np.ndarray)):
        return [_plain(v) for v in x]
    if isinstance(x, (float, np.floating)):
        return float(x) if np.isfinite(x) else None
    return x.item() if isinstance(x, np.generic) else x
