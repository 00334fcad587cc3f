"""How far off the start state of a window is, mode by mode, where errors of tracking are all that is wrong with it.

    var z_k = Σ_ij w_ki R_ij w_kj,    w_ki = φ_ki A_i/ΣA        of places [m²]

and of velocities `PER_FRAME` of that deviation in a frame, for states are smoothed. R: errors of one frame, as neighbours share them
(`tracking_noise.py`). A mode averages over the cloth: of white noise each holds one part in √V, of errors that the whole garment shares the
lowest hold nearly all.

The prior of the marginal likelihood (`likeliest_errors.py`) may be wider, for it has to hold what the model errs by as well. Simulated from
where a wider one leads, stiff cloth goes elsewhere altogether: how it is stretched at the start is hardly seen a frame later, so that noise
alone may ask for centimetres of it.

Source: errors of a linear estimate (Gelb 1974, ch. 4). Limits: the first and last frames of a recording are known less well than this says.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.windows import Recording
from tasks.effects.effect import Subject

Array = NDArray[np.float64]
PER_FRAME = 0.5  # of the error of a place, by which a velocity may be off


def start_variances(recording: Recording, subject: Subject, φ: Array, names: Sequence[str]) -> Array:
    """Variances [Z] of the coefficients of modes φ [K, V] called `names`: places [m²], velocities [m²/s²]."""
    w = φ * subject.cloth.vertex_areas / subject.cloth.vertex_areas.sum()
    share = recording.correlation.share
    R = recording.correlation.shared(subject.cloth.x_rest) + (1 - share) * np.eye(w.shape[1])
    places = np.median(recording.noise) ** 2 * np.sum((w @ R) * w, 1)
    return np.array([places[mode_of(n)] * (1.0 if n.startswith("x ") else (PER_FRAME * subject.fps) ** 2) for n in names])


def mode_of(name: str) -> int:
    """Of a column: "x 57 y" is of mode 57."""
    return int(name.split()[1])
