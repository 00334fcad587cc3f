"""How far a tracked vertex may be off: the posterior of the linearised problem.

Near the minimum the energy is ½ (x − x̂)ᵀ H (x − x̂) with H = JᵀWJ of all terms, so x ~ N(x̂, H⁻¹): image noise through the photometric
rows, and the ISO and normal terms as what is known beforehand of the shape. The standard deviation per coordinate of vertex v is
√(tr (H⁻¹)_vv/3).

Cloth that the fit leaves d inside skin (inside_skin.py) has the right colour at the wrong place, or the skin is wrong: d² n nᵀ, with n the
skin's normal, is added to its covariance, which is d²/3 per coordinate.

The diagonal blocks of H⁻¹ are estimated from N samples x = Pᵀ L⁻ᵀ z, z ~ N(0, I), of the Cholesky factor PHPᵀ = LLᵀ: 3N squares per vertex,
relative standard error 1/√(6N). Samples are drawn from a fixed seed.

Source: Gaussian approximation at the optimum (Triggs et al. 2000, Bundle adjustment, §8). Limits: it counts neither wrong correspondence
nor changed shading; `Settings.noise_calibration` scales it to observed errors.

Of a vertex that is not seen it is no error bar: only anchors and its neighbours' shape hold it there, and anchors err together where they
count as independent, so that σ falls with the mesh's size whatever the error. What was unseen of the textured skirt of
tests/benchmarks/tracking.py was said to be 1.0 mm off and was 1.7 per coordinate (rms, 6 frames); of the plain one, from four views, 1.5
and 12 mm.
"""

import numpy as np
from numpy.typing import NDArray

from tasks.geometry.cholmod_kernels import load_cholmod, one_thread
from tasks.tracking.blocks import NormalEquations

Array = NDArray[np.float64]

_SAMPLES = 32
_LOOSEST = 0.1  # [m] standard deviation of a vertex that nothing holds


def stated(posterior: Array, depth: Array) -> Array:
    """Standard deviation per coordinate [V] m of vertices that lie `depth` [V] m inside skin, from what the posterior says [V] m."""
    return np.sqrt(posterior**2 + depth**2 / 3)


def posterior(system: NormalEquations, *, samples: int = _SAMPLES) -> Array:
    """Standard deviation per coordinate [V] m, averaged over the three."""
    from scipy.sparse import bsr_matrix, eye

    n = len(system.gradient)
    H = bsr_matrix((system.blocks, system.pattern.column, system.pattern.row_start), shape=(3 * n, 3 * n))
    with one_thread():
        factor = load_cholmod().cholesky((H + eye(3 * n) / _LOOSEST**2).tocsc())
    z = np.random.default_rng(0).standard_normal((3 * n, samples))
    x = factor.apply_Pt(factor.solve_Lt(z, use_LDLt_decomposition=False))
    return np.sqrt((x.reshape(n, 3, samples) ** 2).mean((1, 2)))
