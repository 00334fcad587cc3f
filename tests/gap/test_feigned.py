"""What a finer re-run alone feigns: the strength it looks like, and the forcing it would be taken for."""

import numpy as np
import pytest

from tasks.cloth.windows import Normals
from tasks.effects.effect import MeshDoubt
from tasks.gap.feigned import feigned, numerics_forcing
from tasks.gap.hypotheses import FORCING, Windows
from tests.gap.synthetic import EFFECTS, NAMES, TYPICAL, dense

SURE = MeshDoubt(0.0, 0.0, 0.0)
DRAG, DAMPING = EFFECTS[:2]


def windows(rng, *, like=0.0, push=0.0, modes=4, count=6, n=80):
    """Normal equations of windows whose finer re-run D is `like` typical drags and pushed by accelerations of size `push` [m/s²]; D and S_a beside them."""
    found = []
    for A, r in dense(rng, lambda k: {}, count=count, n=n):
        S = rng.standard_normal((n, modes))
        D = like * TYPICAL["air_normal_drag"] * A[:, NAMES.index("air_normal_drag")] + S @ (push * rng.standard_normal(modes))
        B = np.column_stack([A, S, D])
        names = (*NAMES, *(f"a {k} x" for k in range(modes)), "numerics")
        found.append((Normals(names, B.T @ B, B.T @ r, float(r @ r), n), S, D))
    return found


def test_a_finer_run_that_looks_like_drag_feigns_as_much_drag():
    normals = [n for n, *_ in windows(np.random.default_rng(0), like=0.6)]
    found = feigned(EFFECTS, SURE, normals, 0.0)
    assert found["air_normal_drag"] == pytest.approx(0.6 * TYPICAL["air_normal_drag"], rel=0.05)
    assert found["fabric_mass_damping"] < 0.1 * TYPICAL["fabric_mass_damping"]


def test_so_much_drag_is_then_no_evidence():
    rng = np.random.default_rng(1)
    made = dense(rng, lambda k: {"air_normal_drag": 0.5 * TYPICAL["air_normal_drag"]})
    normals = [Normals(tuple(NAMES), A.T @ A, A.T @ r, float(r @ r), len(r)) for A, r in made]
    sure, doubtful = (
        Windows(normals, EFFECTS, feigned=f).fit([DRAG]).evidence for f in ({}, {"air_normal_drag": 0.6 * TYPICAL["air_normal_drag"]})
    )
    assert sure > 5 > 1 > doubtful


def test_what_the_mesh_and_the_finer_run_feign_adds_in_quadrature():
    class Doubtful(type(DRAG)):
        def feigned(self, doubt):
            return np.array([doubt.contact])

    normals = [n for n, *_ in windows(np.random.default_rng(0), like=0.6)]
    alone = feigned([DRAG], SURE, normals, 0.0)["air_normal_drag"]
    assert feigned([Doubtful()], MeshDoubt(2.0, 1.0, 0.0), normals, 0.0)["air_normal_drag"] == pytest.approx(np.hypot(2.0, alone))


@pytest.mark.parametrize("push", [0.0, 2.0])
def test_the_forcing_of_a_finer_run_is_the_likeliest_one(push):
    """Against the dense expectation of −2 log likelihood for data that are D and noise."""
    made = windows(np.random.default_rng(2), push=push)
    losses = []
    for σ in FORCING:
        total = 0.0
        for _, S, D in made:
            C = np.eye(len(D)) + σ**2 * S @ S.T
            total += D @ np.linalg.solve(C, D) + np.trace(np.linalg.inv(C)) + np.linalg.slogdet(C)[1]
        losses.append(total)
    found = numerics_forcing([n for n, *_ in made])
    assert found == FORCING[int(np.argmin(losses))]
    assert found == 0.0 if push == 0 else 1.0 < found < 4.0
