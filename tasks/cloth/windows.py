"""Multiple shooting: the recording cut into short windows, each simulated from its own start, with the derivatives of what it predicts.

Over seconds cloth is chaotic: predictions from one start lose the recording, and derivatives mean nothing. Over a fifth of a second they
hold, and in stiff cloth over a third. A window starts from the state of `start_state.py`, whose error is marginalised, not fitted, and so
is what may accelerate the cloth beyond the model (`forcing.py`): z ~ N(0, diag(σ_x², σ_v², σ_a²)) enters

    y − x(θ₀) = S_θ (θ − θ₀) + S_z z + ε,    ε ~ N(0, R)

as columns. What a window says about everything is kept as its normal equations, whitened by the noise (`tracking_noise.py`): a few hundred
numbers squared. A window in which hardly anything was seen says nothing, and is left out. Of more than `COMPARED` vertices so many are
compared, spread evenly over the garment: to whiten costs the cube of their number, and errors that neighbours share leave the others little
to say.

Source: Bock & Plitt 1984 (multiple shooting); Gelb 1974, ch. 7 (considered states).
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_triangular

from tasks.cloth.forcing import Forcing
from tasks.cloth.start_state import States, derivative
from tasks.cloth.state_modes import state_columns
from tasks.cloth.tracking_noise import INDEPENDENT, Correlation, whitened
from tasks.effects.effect import Motion, Subject
from tasks.effects.model import Model
from tasks.geometry.farthest_points import farthest_points
from tasks.simulator.cloth import Cloth, Collider
from tasks.simulator.newton import CONVERGED

Array = NDArray[np.float64]

AT_START = " at the start"
CONTEXT = 10  # frames before and after a window that a tracker may have mixed in
SHORT_S = 0.18  # [s] the start's error and the base's own chaos grow: beyond that derivatives do not hold in every cloth
LONG_S = 0.33  # [s] what a force does grows with the square of time: where cloth can be predicted that far, causes are told apart by more
PREDICTED = 4.0  # median misfit of windows per coordinate up to which cloth was predicted over their length
COMPARED = 1000  # vertices
TELLS = 0.01  # least share of the free vertices that some frame of a window must show
ROUNDING = 1e-12  # of the size of a column


@dataclass(frozen=True)
class Recording:
    """What was recorded: the collider and the motion of what drives the cloth, observed [T, V, 3] m (NaN where not seen), noise [T, V] m of
    one coordinate and how neighbours and frames share it. Recordings of one garment may have colliders of their own.
    """

    collider: Collider
    motion: Motion
    observed: Array
    noise: Array
    correlation: Correlation = INDEPENDENT

    def __len__(self) -> int:
        return len(self.observed)

    def cut(self, frames: slice) -> "Recording":
        """Some of the frames."""
        return replace(self, motion=self.motion.cut(frames), observed=self.observed[frames], noise=self.noise[frames])

    @property
    def forgetful(self) -> "Recording":
        """The same with errors of tracking that have no memory: with one, 720 columns take six times as long to whiten."""
        return replace(self, correlation=replace(self.correlation, memory=0.0))

    def scene(self, model: Model) -> Model:
        """The model before this recording's collider."""
        return replace(model, subject=replace(model.subject, collider=self.collider))


@dataclass(frozen=True)
class Window:
    """Frames `start` to `start + length` of a recording; the first is the start, the others are compared."""

    recording: int
    start: int
    length: int

    @property
    def frames(self) -> slice:
        """The start frame and those compared."""
        return slice(self.start, self.start + self.length + 1)


@dataclass(frozen=True)
class Prediction:
    """What a window's simulation says: x [L + 1, V, 3] m as the tracker would report it, columns name -> [L, V, 3], how it ended."""

    window: Window
    x: Array
    columns: dict[str, Array]
    ending: str
    newton_iterations: int

    @property
    def complete(self) -> bool:
        """Whether every frame was reached."""
        return self.ending == CONVERGED


def longest_s(recordings: Sequence[Recording], fps: float, count: int) -> float:
    """Length [s] of windows of which recordings give `count`, from `SHORT_S` to `LONG_S`."""
    return float(np.clip(sum(len(r) - 1 for r in recordings) / fps / count, SHORT_S, LONG_S))


def windows(recordings: Sequence[Recording], fps: float, length_s: float = SHORT_S) -> list[Window]:
    """Windows of about `length_s` one after another through every recording, but for those in which hardly anything was seen."""
    return [w for w in every_window(recordings, fps, length_s) if _tells(recordings[w.recording], w)]


def every_window(recordings: Sequence[Recording], fps: float, length_s: float = SHORT_S) -> list[Window]:
    """Windows of about `length_s` one after another through every recording."""
    length, found = max(3, round(length_s * fps)), []
    for k, recording in enumerate(recordings):
        count = max(1, round((len(recording) - 1) / length))
        starts = np.linspace(0, len(recording) - 1, count + 1).round().astype(int)
        found += [Window(k, int(a), int(b - a)) for a, b in itertools.pairwise(starts)]
    return found


def _tells(recording: Recording, window: Window) -> bool:
    """Whether in some frame after the start more was seen than the driven vertices, which are known where the cloth is lost from sight."""
    seen = np.isfinite(recording.observed[window.frames][1:]).all(-1).sum(1).max()
    driven, count = recording.motion.boundary.shape[1], recording.observed.shape[1]
    return bool(seen > driven + TELLS * (count - driven))


def predict(
    model: Model,
    recording: Recording,
    window: Window,
    states: States,
    *,
    parameters: Sequence[str] = (),
    φ: Array | None = None,
    columns: bool = False,
    forced: bool = False,
) -> Prediction:
    """Simulate a window. parameters: base parameters, φ [K, V]: modes of the start state and, if `forced`, of the forcing, columns:
    effects, to differentiate by.
    """
    model, modes = recording.scene(model), {}
    n = model.settings.substeps
    fine = replace(model, settings=replace(model.settings, substeps=1), subject=replace(model.subject, fps=model.subject.fps * n))
    drive = model.drive(recording.motion, columns=columns).each(lambda motion: smooth(motion.cut(window.frames), n))
    if φ is not None:
        modes = state_columns(φ)
    blurred = _starts_as_seen(model, states, window.start) if columns else {}
    if forced:
        forcing = Forcing(φ)
        fine, parameters = fine.joined([forcing], {}), (*parameters, *forcing.columns)
    x0, v0 = states.x[window.start], states.v[window.start]
    frames = list(fine.run_along(drive, x0, v0, parameters=parameters, start_modes=modes | blurred, columns=columns))
    ending, iterations = frames[-1].ending, sum(f.newton_iterations for f in frames)
    kept = frames[::n]
    x = np.stack([f.x for f in kept])
    if len(kept) < window.length + 1:
        x, _ = _seen(model, states, window, x, {}, columns=False)
        return Prediction(window, x, {}, ending if ending != CONVERGED else "the simulation ended early", iterations)
    tangents = {name: np.stack([f.tangents[name][0] for f in kept]) for name in kept[0].tangents}
    for name in blurred:
        column = name.removesuffix(AT_START)
        tangents[column] = tangents.pop(name) + tangents.get(column, 0.0)
    x, tangents = _seen(model, states, window, x, tangents, columns=columns)
    return Prediction(window, x, {name: c[1:] for name, c in tangents.items()}, ending, iterations)


def _seen(
    model: Model, states: States, window: Window, x: Array, tangents: dict[str, Array], *, columns: bool
) -> tuple[Array, dict[str, Array]]:
    """What the tracker reports of a window x [L + 1, V, 3] m, and its derivatives; `columns`: also those by what the tracker does.

    Before and after the window the cloth is as the states have it (on their mesh), for a tracker that smooths mixes that in.
    """
    t, L = window.start, len(x)
    around = states.x if states.x.shape[1] == x.shape[1] else x[:0]
    before, after = around[max(0, t - CONTEXT) : t], around[t + L : t + L + CONTEXT]
    whole, own = np.concatenate([before, x, after]), slice(len(before), len(before) + L)
    return model.observed(whole)[own], model.observed_tangents(whole, tangents, own, columns=columns)


def _starts_as_seen(model: Model, states: States, t: int) -> dict[str, tuple[Array, Array]]:
    """Column and `AT_START` -> (∂x, ∂v) [V, 3] of the state at frame t in effects on the observation: what was seen stays, so the cloth is elsewhere."""
    first = max(0, t - CONTEXT)
    fields = model.observation_columns(model.observed(states.x[first : t + CONTEXT + 1]))
    return {column + AT_START: (-D[t - first], -derivative(D, model.subject.fps, 1)[t - first]) for column, D in fields.items()}


def smooth(motion: Motion, n: int) -> Motion:
    """The motion at n times the frame rate, by cubic splines: linear motion between frames would jolt the cloth at every frame."""
    return Motion(_upsampled(motion.collider, n), _upsampled(motion.boundary, n))


def _upsampled(x: Array, n: int) -> Array:
    if len(x) < 3 or not x.size:
        at = np.linspace(0, len(x) - 1, n * (len(x) - 1) + 1)
        low = np.minimum(at.astype(int), len(x) - 2)
        return x[low] + (at - low)[:, None, None] * (x[low + 1] - x[low])
    t = np.arange(len(x))
    return CubicSpline(t, x)(np.linspace(0, len(x) - 1, n * (len(x) - 1) + 1))


@dataclass(frozen=True)
class Normals:
    """Normal equations of one window: G = AᵀC⁻¹A [P, P], g = AᵀC⁻¹r [P], c = rᵀC⁻¹r, n compared coordinates, log|C|; names of the columns
    of A.

    C is the noise R, and what was marginalised since.
    """

    names: tuple[str, ...]
    G: Array
    g: Array
    c: float
    n: int
    logdet: float = 0.0

    def index(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Places of columns."""
        place = {name: i for i, name in enumerate(self.names)}
        return np.array([place[name] for name in names], int)

    def stepped(self, δ: Array) -> "Normals":
        """The same about coefficients that are larger by δ [P]."""
        return replace(self, g=self.g - self.G @ δ, c=float(self.c - 2 * self.g @ δ + δ @ self.G @ δ))


def normals(prediction: Prediction, recording: Recording, subject: Subject) -> Normals:
    """Of a complete prediction against what was observed of the free vertices."""
    some = _compared(subject.cloth)
    y, σ = (a[prediction.window.frames][1:, some] for a in (recording.observed, recording.noise))
    fields = np.stack([y - prediction.x[1:, some], *(column[:, some] for column in prediction.columns.values())])
    white, logdet = whitened(fields, np.isfinite(y).all(-1), σ, subject.cloth.x_rest[some], recording.correlation, subject.fps)
    G = white.T @ white
    return Normals(tuple(prediction.columns), G[1:, 1:], G[1:, 0], float(G[0, 0]), len(white), logdet)


def _compared(cloth: Cloth) -> NDArray[np.int64]:
    """The free vertices that are compared."""
    free = np.setdiff1d(np.arange(len(cloth.x_rest)), cloth.boundary)
    return free[farthest_points(cloth.x_rest[free], COMPARED)]


def marginalised(normals: Normals, names: Sequence[str], variance: Array) -> Normals:
    """The same with the coefficients of `names` integrated out under N(0, diag(variance)).

    Each over its own size, d: where cloth is about to buckle the derivative by a start mode may grow by 1e8, and would drown the others in
    rounding.
    """
    z = normals.index(names)
    x = np.setdiff1d(np.arange(len(normals.names)), z)
    s = np.sqrt(variance)
    M = np.eye(len(z)) + s[:, None] * normals.G[np.ix_(z, z)] * s
    d = 1 / np.sqrt(np.diag(M))
    L = np.linalg.cholesky(d[:, None] * M * d + ROUNDING * np.eye(len(z)))
    B = solve_triangular(L, (d * s)[:, None] * normals.G[np.ix_(z, x)], lower=True)
    b = solve_triangular(L, d * s * normals.g[z], lower=True)
    return Normals(
        tuple(np.array(normals.names)[x]),
        normals.G[np.ix_(x, x)] - B.T @ B,
        normals.g[x] - B.T @ b,
        normals.c - float(b @ b),
        normals.n,
        normals.logdet + 2 * float(np.log(np.diag(L) / d).sum()),
    )


def columns_of(names: Sequence[str], prefix: str) -> Iterator[str]:
    """The names that start with a prefix: "x " and "v " are state modes, "a " is forcing."""
    return (name for name in names if name.startswith(prefix))
