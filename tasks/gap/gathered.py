"""Recordings of one garment with the states that their windows start from, and which windows teach and which are kept for the end."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.shooting import Job, Map
from tasks.cloth.start_state import States, states
from tasks.cloth.tracking_noise import Correlation
from tasks.cloth.unwrinkled_start import unwrinkled_start
from tasks.cloth.windows import SHORT_S, Recording, Window, longest_s, windows
from tasks.cloth.yielded_collider import with_yielded_collider
from tasks.effects.model import Model

Array = NDArray[np.float64]

HELD = 0.3  # share of each recording's windows kept for the end where no recording is given for it
FEWEST_WINDOWS = 4  # of training windows that can be followed,
FOLLOWED = 0.75  # and least share of them
ENOUGH = 8  # windows of all recordings, before they are made longer: their scatter says how sure a strength is


@dataclass(frozen=True)
class Gathered:
    """Recordings of one garment with the states their windows start from."""

    recordings: tuple[Recording, ...]
    states: tuple[States, ...]
    windows: tuple[Window, ...]

    @property
    def noise(self) -> float:
        """Median over recordings [m]."""
        return typical_noise(self.recordings)

    def correlated(self, correlation: Correlation) -> "Gathered":
        """The same with errors of tracking that neighbours share."""
        return replace(self, recordings=tuple(replace(r, correlation=correlation) for r in self.recordings))

    def cut(self, length_s: float, fps: float) -> "Gathered":
        """The same in windows of another length, without those that start where the cloth could not be brought to what was seen."""
        return self.only(w for w in windows(self.recordings, fps, length_s) if w.start < len(self.states[w.recording].x))

    def compared(self) -> tuple[Recording, ...]:
        """Each recording as its windows compare it, unseen elsewhere; of their starts only the first, for another may be the end of a window kept out."""
        found = []
        for k, recording in enumerate(self.recordings):
            own, frames = [w for w in self.windows if w.recording == k], np.zeros(len(recording), bool)
            for w in own:
                frames[w.start + (w is not own[0]) : w.start + w.length + 1] = True
            found.append(replace(recording, observed=np.where(frames[:, None, None], recording.observed, np.nan)))
        return tuple(found)

    def only(self, windows: Iterable[Window]) -> "Gathered":
        """Some of the windows."""
        return replace(self, windows=tuple(windows))


def enough(followed: int, windows: int) -> bool:
    """Whether so many of the windows that can be followed tell of a model."""
    return followed >= max(FEWEST_WINDOWS, FOLLOWED * windows)


def typical_noise(recordings: Sequence[Recording]) -> float:
    """Median over recordings of their median noise [m]."""
    return float(np.median([np.median(r.noise) for r in recordings]))


def gather(model: Model, recordings: Sequence[Recording], run: Map = map) -> Gathered:
    """States and short windows of recordings."""
    found = list(run(_states, [(model, r) for r in recordings]))
    yielded, walked = zip(*found, strict=True)
    return Gathered(yielded, walked, ()).cut(SHORT_S, model.subject.fps)


def lengths(recordings: Sequence[Recording], fps: float) -> tuple[float, ...]:
    """Lengths [s] of windows in which causes may be weighed, the longest that leaves `ENOUGH` of them first."""
    longest = longest_s(recordings, fps, ENOUGH)
    return (longest, SHORT_S) if longest > SHORT_S else (SHORT_S,)


def _states(job: tuple[Model, Recording]) -> tuple[Recording, States]:
    model, recording = job
    recording = with_yielded_collider(recording, model)
    return recording, _restate((model, recording))


def restated(model: Model, data: Gathered, run: Map = map) -> Gathered:
    """The states that another model finds: cloth too soft keeps the noise as wrinkles, which make it look softer than it is."""
    return _where_longer(data, list(run(_restate, [(model, r) for r in data.recordings])), data.recordings)


def unwrinkled(model: Model, data: Gathered, φ: Array, run: Map = map) -> Gathered:
    """The same with windows that start without wrinkles of noise. φ [K, V]: the modes of the start that are marginalised."""
    states = [replace(s, x=s.x.copy(), v=s.v.copy()) for s in data.states]
    for w, (x, v) in zip(data.windows, run(unwrinkled_start, jobs(model, data, φ)), strict=True):
        states[w.recording].x[w.start], states[w.recording].v[w.start] = x, v
    return replace(data, states=tuple(states))


def restarted(model: Model, data: Gathered, run: Map = map, φ: Array | None = None) -> Gathered:
    """The same for a model whose effects move the collider: before a body in another place, the cloth is elsewhere too, and the body may
    pinch itself anew; or that make another fabric: what was cut to other lengths lies otherwise where it was seen.

    φ [K, V]: as in `unwrinkled`, where wrinkles matter.
    """
    if not _lies_otherwise(model):
        return data
    recordings, walked = zip(*run(_anew, [(model, r) for r in data.recordings]), strict=True)
    data = _where_longer(data, walked, recordings)
    return data if φ is None else unwrinkled(model, data, φ, run)


def _lies_otherwise(model: Model) -> bool:
    """Whether its effects change what states depend on: what drives the cloth, or its fabric but for friction, which no state feels."""
    moves = any("motion" in e.acts_through and model.strength(e).any() for e in model.effects)
    own = model.subject.fabric
    return moves or replace(model.dressed().fabric, friction=own.friction, self_friction=own.self_friction) != own


def _anew(job: tuple[Model, Recording]) -> tuple[Recording, States]:
    """States, and the collider drawn in again only where the model's effects move it."""
    model, recording = job
    as_driven, as_recorded = recording.scene(model).driven(recording.motion).collider, recording.motion.given_way.collider
    return (recording, _restate(job)) if np.array_equal(as_driven, as_recorded) else _states(job)


def _where_longer(data: Gathered, walked: Sequence[States], recordings: Sequence[Recording]) -> Gathered:
    """New states, and the recordings they belong to, but where they end before the old ones."""
    better = [len(new.x) >= len(old.x) for new, old in zip(walked, data.states, strict=True)]
    states = [new if ok else old for new, old, ok in zip(walked, data.states, better, strict=True)]
    kept = [new if ok else old for new, old, ok in zip(recordings, data.recordings, better, strict=True)]
    return replace(data, states=tuple(states), recordings=tuple(kept))


def _restate(job: tuple[Model, Recording]) -> States:
    model, recording = job
    model = recording.scene(model)
    return states(model, model.driven(recording.motion), recording.observed, float(np.median(recording.noise)))


def split(data: Gathered) -> tuple[Gathered, Gathered]:
    """Training windows, and those to hold out, spread over each recording (none where too few would teach): what acts in one place only, a
    touch or a turn, would otherwise be all on one side. The first window always teaches, for replays start there.
    """
    train, held = [], []
    for k in range(len(data.recordings)):
        own = [w for w in data.windows if w.recording == k]
        spare = max(len(data.windows) - FEWEST_WINDOWS - len(held), 0)
        kept = _spread(min(round(HELD * len(own)), spare), len(own))
        held += [w for i, w in enumerate(own) if i in kept]
        train += [w for i, w in enumerate(own) if i not in kept]
    return data.only(train), data.only(held)


def _spread(count: int, n: int) -> frozenset[int]:
    """`count` places of n, evenly apart, away from the ends."""
    return frozenset(int((j + 0.5) * n / count) for j in range(count))


def jobs(model: Model, data: Gathered, φ: Array, **options) -> list[Job]:
    """One job per window."""
    return [Job(model, data.recordings[w.recording], w, data.states[w.recording], φ, **options) for w in data.windows]
