"""The garment of a quick diagnosis: at most `VERTICES` of its vertices, thinned out in its rest shape.

The vertices left are some of the given ones, so observations, driven nodes and zones carry over as they are; nothing is interpolated.
Driven nodes, hems and seams go only onto their own kind. A vertex that is not simulated shows what the nearest simulated one does, along
the edges of the rest shape. Longer edges stand higher on a curved body, which is drawn in further for that (`cloth/contact_sagitta.py`).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.contact_sagitta import contact_sagitta, drawn_in
from tasks.cloth.windows import Recording
from tasks.effects.effect import Motion
from tasks.effects.model import Model
from tasks.effects.retriangulated import retriangulated
from tasks.gap.garment_recordings import Garment
from tasks.geometry.decimation import decimate
from tasks.simulator import Cloth

Indices = NDArray[np.int32]

VERTICES = 256
BENDING = "kappa_b_over_rho"
LINES = ("hem", "seam")  # zones that are lines; contact and free are areas, whose border may move by a vertex


@dataclass(frozen=True)
class CoarseGarment:
    """The thinned garment; kept [N]: the vertices left, by their numbers in the whole one; nearest [V]: the kept one nearest to each of the whole."""

    whole: Garment
    garment: Garment
    kept: Indices
    nearest: Indices

    def recording(self, recording: Recording) -> Recording:
        """A recording of the whole garment, as one of the thinned one, whose longer edges hold it further off the body."""
        driven = np.isin(self.whole.model.subject.cloth.boundary, self.kept)
        motion = Motion(recording.motion.collider, recording.motion.boundary[:, driven])
        thinned = replace(recording, motion=motion, observed=recording.observed[:, self.kept], noise=recording.noise[:, self.kept])
        return drawn_in(thinned, self.garment.contact_doubt - self.whole.contact_doubt)

    def on_whole(self, found: Model) -> Model:
        """The whole garment in the fabric and with the effects that were found on the thinned one."""
        model = self.whole.model
        fabric = retriangulated(found.subject, model.subject.cloth).fabric
        return replace(model, subject=replace(model.subject, fabric=fabric), effects=found.effects, strengths=found.strengths)

    def told(self, answer: dict[str, Any]) -> dict[str, Any]:
        """The answer with a value for every vertex of the whole garment."""
        each = {name: [answer["where"][name][i] for i in self.nearest] for name in ("vertex_mm", "vertex_accel")}
        return answer | {"where": answer["where"] | each, "parameters": self._on_whole(answer["parameters"])}

    def _on_whole(self, parameters: dict[str, Any]) -> dict[str, Any]:
        """Ratios of stiffness to density found on the thinned garment, as they are on the whole one."""
        thinned, cloth = self.garment.model.subject, self.whole.model.subject.cloth
        times = retriangulated(thinned, cloth).fabric.bending / thinned.fabric.bending
        thin = parameters[BENDING]
        known = {end: times * thin[end] for end in ("value", "low", "high") if thin[end] is not None}
        return parameters | {BENDING: thin | known}


def coarse_garment(garment: Garment, *, count: int = VERTICES) -> CoarseGarment:
    """`garment` on at most `count` vertices; as it is where it has no more."""
    subject = garment.model.subject
    cloth, V = subject.cloth, len(subject.zone)
    if count >= V:
        return whole_garment(garment)
    pattern = _pattern(cloth)
    flat = cloth.x_rest if pattern is None else np.column_stack([pattern, np.zeros(V)])
    thin = decimate(flat, cloth.faces, count, kind=_kinds(subject.zone, cloth.boundary))
    number = np.full(V, -1, np.int32)
    number[thin.kept] = np.arange(len(thin.kept))
    boundary = number[cloth.boundary]
    uv = None if pattern is None else pattern[thin.kept][thin.faces]
    thinned = Cloth(cloth.x_rest[thin.kept], thin.faces, boundary[boundary >= 0], uv, cloth.rest_angles)
    model = replace(garment.model, subject=replace(retriangulated(subject, thinned), zone=subject.zone[thin.kept]))
    coarse = CoarseGarment(garment, replace(garment, model=model), thin.kept, thin.nearest)
    as_seen = [coarse.recording(drawn_in(r, -garment.contact_doubt)) for r in garment.recordings]
    doubt = contact_sagitta(thinned, as_seen, model.settings.barrier_distance)
    recordings = tuple(drawn_in(r, doubt) for r in as_seen)
    return replace(coarse, garment=replace(coarse.garment, recordings=recordings, contact_doubt=doubt))


def whole_garment(garment: Garment) -> CoarseGarment:
    """Nothing thinned out."""
    everything = np.arange(len(garment.model.subject.zone), dtype=np.int32)
    return CoarseGarment(garment, garment, everything, everything)


def _kinds(zone: NDArray[np.str_], boundary: Indices) -> Indices:
    """0 for areas, one number for each line and one for driven nodes [V]."""
    kind = np.zeros(len(zone), np.int32)
    for k, line in enumerate(LINES, 1):
        kind[zone == line] = k
    kind[boundary] = len(LINES) + 1
    return kind


def _pattern(cloth: Cloth) -> NDArray[np.float64] | None:
    """Place of each vertex in the pattern [V, 2] m, which files give once per vertex; None where there is no pattern."""
    if cloth.uv is None:
        return None
    place = np.zeros((len(cloth.x_rest), 2))
    place[cloth.faces] = cloth.uv
    return place
