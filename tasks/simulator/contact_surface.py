"""The surface of contact: cloth and collider as one collision mesh, the pairs near each other, and how far one may move.

Collider vertices come after the cloth's; those of no face are no skin, and take no part. Pairs whose vertices are all prescribed
(collider, boundary) are ignored: nothing could answer them. Candidates found for a segment x → y hold for every point of it and for all
within a little slack around, so that the broad phase, which sees the whole collider, is asked about once per step, not once per Newton
iteration.

Pairs and their potentials are ipctk's; what asks about every candidate, the broad phase and continuous collision detection, is compiled
here (`near_pairs.py`, `additive_ccd.py`), for there a step spent a third of its time.

Source: Li et al. 2020 (IPC); additive continuous collision detection of Li, Kaufman, Jiang 2021.
"""

import ipctk
import numpy as np
from numpy.typing import NDArray

from tasks.geometry.meshes import edge_lengths, edges
from tasks.simulator.additive_ccd import free_share, nearer_than
from tasks.simulator.cloth import Cloth, Collider
from tasks.simulator.near_pairs import BoxTree, near_pairs

Array = NDArray[np.float64]
Pairs = tuple[NDArray[np.int32], NDArray[np.int32]]  # of edges [N, 2], of a face and a vertex [M, 2]
KEPT = 0.1  # share of the gap that a step leaves
LEAST = 1e-9  # [m] that gaps keep: where they are as small as rounding, what has crossed cannot be told
LEAP = 16.0  # barrier distances of a long segment that are looked at first
SLACK = 4.0  # barrier distances around a segment for which its candidates hold as well, but no more than
WITHIN = 0.25  # of the cloth's median edge: else cloth with edges of 6.3 mm has 89 candidates a vertex, not 7


class ContactSurface:
    """Collision mesh of V cloth and C collider vertices; keeps the candidates and the pairs of the place last asked for."""

    def __init__(
        self,
        cloth: Cloth,
        collider: Collider,
        collider_rest: Array,
        *,
        barrier_distance: float,
        offset: float = 0.0,
        area_weighting: bool = True,
    ) -> None:
        """barrier_distance d̂ [m]: surfaces closer than offset + d̂ repel; offset [m]: they never come closer than this."""
        ipctk.set_num_threads(1)  # sums in a fixed order: the same input gives the same bits
        ipctk.set_logger_level(ipctk.LoggerLevel.error)
        self.cloth_size = len(cloth.x_rest)
        self.barrier_distance, self.offset, self.area_weighting = barrier_distance, offset, area_weighting
        self.faces = np.concatenate([cloth.faces, collider.faces + self.cloth_size]).astype(np.int32)
        self.edges = np.ascontiguousarray(edges(self.faces), np.int32)
        rest = np.concatenate([cloth.x_rest, collider_rest.reshape(-1, 3)])
        self.mesh = ipctk.CollisionMesh(np.asfortranarray(rest), np.asfortranarray(self.edges), np.asfortranarray(self.faces))
        prescribed = np.full(len(rest), True)
        prescribed[: self.cloth_size] = False
        prescribed[cloth.boundary] = True
        patch = np.arange(1, len(rest) + 1, dtype=np.int32)
        patch[prescribed] = 0
        self.mesh.can_collide = ipctk.make_vertex_patches_filter(patch)
        self.contact_areas = np.array([self.mesh.vertex_area(i) for i in range(len(rest))])
        self._skin = np.unique(self.faces)
        self._trees = [BoxTree.of(elements, rest, prescribed) for elements in (self.edges, self.faces, self._skin[:, None])]
        own = self.edges[self.edges[:, 1] < self.cloth_size]
        self._slack = min(SLACK * barrier_distance, WITHIN * float(np.median(edge_lengths(cloth.x_rest, own))))
        self._candidates: Pairs | None = None
        self._region = (np.empty((0, 3)), np.empty((0, 3)))
        self._near: tuple[Array, ipctk.NormalCollisions] | None = None

    def join(self, x: Array, collider: Array) -> Array:
        """One array [V + C, 3] in the memory order that ipctk wants."""
        return np.asfortranarray(np.concatenate([x, collider]))

    def prepare(self, X: Array, Y: Array) -> None:
        """Know all pairs that come near each other between X and Y [V + C, 3]: those of the segment before, where they hold for this one."""
        if self._known(X) and self._known(Y):
            return
        self._candidates = self.coming_near(X, Y, (self.offset + self.barrier_distance) / 2 * 1.01 + self._slack)
        self._region = (np.minimum(X, Y) - self._slack, np.maximum(X, Y) + self._slack)

    def coming_near(self, X: Array, Y: Array, inflation: float) -> Pairs:
        """Pairs whose swept boxes between X and Y [V + C, 3], grown by inflation [m] on every side, meet."""
        low, high = np.minimum(X, Y) - inflation, np.maximum(X, Y) + inflation
        edge_edge, face_vertex = near_pairs(*self._trees, np.ascontiguousarray(low), np.ascontiguousarray(high))
        face_vertex[:, 1] = self._skin[face_vertex[:, 1]]
        return edge_edge, face_vertex

    def _known(self, X: Array) -> bool:
        """Whether the candidates hold at X: every vertex within its box."""
        low, high = self._region
        return self._candidates is not None and bool((low <= X).all() and (high >= X).all())

    def forget(self) -> None:
        """Drop the candidates: the next question may be asked anywhere."""
        self._candidates = None
        self._near = None

    def free_step(self, X: Array, Y: Array) -> float:
        """Largest share of the segment X → Y that stays free of contact; 1 when all of it does, 0 where Y is not finite. A long segment is
        looked at in stretches, each four times the last, for most that are long are blocked early.
        """
        longest = float(np.abs(Y - X).max(initial=0.0))
        if not np.isfinite(longest):
            return 0.0
        looked_at = min(1.0, LEAP * self.barrier_distance / longest) if longest else 1.0
        while True:
            Z = X + looked_at * (Y - X) if looked_at < 1 else Y
            self.prepare(X, Z)
            assert self._candidates is not None
            share = self.free_share_of(X, Z, self._candidates)
            if share < 1 or looked_at == 1:
                return share * looked_at
            looked_at = min(1.0, 4 * looked_at)

    def free_share_of(self, X: Array, Y: Array, candidates: Pairs) -> float:
        """The same in one go, asked of these candidates alone."""
        X, Y = np.ascontiguousarray(X), np.ascontiguousarray(Y)
        return free_share(X, Y, self.edges, self.faces, *candidates, keep=self.offset + LEAST, kept_share=KEPT)

    def pairs(self, X: Array) -> ipctk.NormalCollisions:
        """Pairs closer than offset + d̂ at X."""
        if self._near is None or not np.array_equal(self._near[0], X):
            reach = self.offset + self.barrier_distance
            candidates = self._candidates if self._known(X) else self.coming_near(X, X, reach / 2 * 1.01)
            edge_edge, face_vertex = nearer_than(np.ascontiguousarray(X), self.edges, self.faces, *candidates, reach=1.01 * reach)
            few = ipctk.Candidates()
            few.ee_candidates = [ipctk.EdgeEdgeCandidate(i, j) for i, j in edge_edge.tolist()]
            few.fv_candidates = [ipctk.FaceVertexCandidate(f, v) for f, v in face_vertex.tolist()]
            near = ipctk.NormalCollisions()
            near.collision_set_type = ipctk.NormalCollisions.IPC
            near.use_area_weighting = self.area_weighting
            near.build(few, self.mesh, X, self.barrier_distance, self.offset)
            self._near = (X, near)
        return self._near[1]

    def least_distance(self, X: Array) -> float:
        """Least distance among the pairs at X [m]; infinite when none is near."""
        return float(np.sqrt(self.pairs(X).compute_minimum_distance(self.mesh, X)))

    def tightest(self, X: Array) -> str:
        """The closest pair at X in words: its vertices, distance and place."""
        near = self.pairs(X)
        best, vertices = np.inf, []
        for pair in (*near.vv_collisions, *near.ev_collisions, *near.ee_collisions, *near.fv_collisions):
            ids = [i for i in pair.vertex_ids(self.mesh.edges, self.mesh.faces) if i >= 0]
            squared = pair.compute_distance(X[ids].ravel())
            if squared < best:
                best, vertices = squared, ids
        if not vertices:
            return "no surfaces are near each other"
        cloth, collider = [i for i in vertices if i < self.cloth_size], [i - self.cloth_size for i in vertices if i >= self.cloth_size]
        place = ", ".join(f"{value:.3f}" for value in X[vertices].mean(0))
        against = f"collider vertices {collider}" if collider else "itself"
        return f"cloth vertices {cloth} and {against} are {1e3 * np.sqrt(best):.3g} mm apart near ({place}) m"

    def intersects(self, X: Array) -> bool:
        """Whether any edge crosses any face at X (exact)."""
        return bool(ipctk.has_intersections(self.mesh, X))
