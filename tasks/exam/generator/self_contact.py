"""Contact of the cloth with itself: ipctk's barrier and continuous collision detection, without friction."""

import ipctk
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

from tasks.geometry.meshes import edges

Array = NDArray[np.float64]
REACH = 1e-3  # d̂ [m]
SEEN = 6e-3  # how near surfaces must come to be watched [m]


class SelfContact:
    """Barrier κ between parts of one cloth: rest [V, 3] m, faces [F, 3], areal density [kg/m²]."""

    def __init__(self, rest: Array, faces: NDArray[np.int32], areal_density: float) -> None:
        ipctk.set_num_threads(1)
        ipctk.set_logger_level(ipctk.LoggerLevel.error)
        self._mesh = ipctk.CollisionMesh(np.asfortranarray(rest), np.asfortranarray(edges(faces)), np.asfortranarray(faces))
        self._barrier = ipctk.BarrierPotential(REACH, 60.0 * areal_density / REACH**3)
        self._ccd = ipctk.AdditiveCCD(conservative_rescaling=0.9)
        self._candidates = ipctk.Candidates()
        self._centre: Array | None = None

    def watch(self, x: Array) -> None:
        """Look for all pairs that are near x [V, 3]; free until nodes have gone SEEN/3 from there."""
        if self._centre is None or np.abs(x - self._centre).max() > SEEN / 6:
            self._candidates = ipctk.Candidates()
            self._candidates.build(self._mesh, np.asfortranarray(x), SEEN / 2)
            self._centre = x.copy()

    @property
    def active(self) -> bool:
        """Whether anything is near."""
        return len(self._candidates) > 0

    def largest_step(self, x: Array, y: Array) -> float:
        """Share of the way from x to y that is free."""
        if not self.active:
            return 1.0
        return self._candidates.compute_collision_free_stepsize(self._mesh, np.asfortranarray(x), np.asfortranarray(y), 0.0, self._ccd)

    def forces(self, x: Array) -> tuple[Array, csc_matrix | None]:
        """Forces [V, 3] and −∂f/∂x, made convex; None where nothing touches."""
        if not self.active:
            return np.zeros_like(x), None
        X = np.asfortranarray(x)
        pairs = ipctk.NormalCollisions()
        pairs.use_area_weighting = True
        pairs.build(self._candidates, self._mesh, X, REACH)
        if not len(pairs):
            return np.zeros_like(x), None
        g = self._barrier.gradient(pairs, self._mesh, X).reshape(-1, 3)
        return -g, self._barrier.hessian(pairs, self._mesh, X, ipctk.PSDProjectionMethod.CLAMP)

    def crosses(self, x: Array) -> bool:
        """Whether the cloth passes through itself at x (exact)."""
        return bool(ipctk.has_intersections(self._mesh, np.asfortranarray(x)))
