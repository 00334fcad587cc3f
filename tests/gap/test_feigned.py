"""What the coarse mesh feigns, and the forcing that a finer computation would be taken for."""

from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth.windows import Normals
from tasks.effects.effect import MeshDoubt
from tasks.gap.feigned import feigned, mesh_doubt, numerics_forcing, without_doubts
from tasks.gap.hypotheses import FORCING, Windows
from tests.gap.synthetic import EFFECTS, NAMES, TYPICAL, dense

DRAG = EFFECTS[0]


def windows(rng, *, push=0.0, modes=4, count=6, n=80):
    """Normal equations of windows whose finer computation D = D_1 + D_2 is pushed by accelerations of size `push` [m/s²]; S_a and D beside them."""
    found = []
    for A, r in dense(rng, lambda k: {}, count=count, n=n):
        S = rng.standard_normal((n, modes))
        D = S @ (push * rng.standard_normal((modes, 2)) / np.sqrt(2))
        B = np.column_stack([A, S, D])
        names = (*NAMES, *(f"a {k} x" for k in range(modes)), "numerics_mesh", "numerics_time_step")
        found.append((Normals(names, B.T @ B, B.T @ r, float(r @ r), n), S, D.sum(1)))
    return found


def test_so_much_drag_as_the_mesh_feigns_is_no_evidence():
    rng = np.random.default_rng(1)
    made = dense(rng, lambda k: {"air_normal_drag": 0.5 * TYPICAL["air_normal_drag"]})
    normals = [Normals(tuple(NAMES), A.T @ A, A.T @ r, float(r @ r), len(r)) for A, r in made]
    sure, doubtful = (
        Windows(normals, EFFECTS, feigned=f).fit([DRAG]).evidence for f in ({}, {"air_normal_drag": 0.6 * TYPICAL["air_normal_drag"]})
    )
    assert sure > 5 > 1 > doubtful


def test_states_may_be_smoothed_by_a_quarter_of_a_squared_frame(monkeypatch):
    monkeypatch.setattr("tasks.gap.feigned.chord_shortening", lambda *_: 0.01)
    monkeypatch.setattr("tasks.gap.feigned.body_speed", lambda *_: 0.4)
    for fps in (25.0, 50.0):
        model = SimpleNamespace(subject=SimpleNamespace(cloth=None, fps=fps))
        found = mesh_doubt(model, SimpleNamespace(states=(), noise=1e-3, recordings=()), 0.002)
        assert found == MeshDoubt(0.002, 0.4, 0.01, pytest.approx(0.25 / fps**2))


def test_every_column_hears_what_its_effect_says_of_the_mesh():
    class Doubtful(type(DRAG)):
        def feigned(self, doubt):
            return np.array([doubt.contact])

    assert feigned([Doubtful(), EFFECTS[1]], MeshDoubt(2.0, 1.0, 0.0), [], 0.0) == {"air_normal_drag": 2.0, "fabric_mass_damping": 0.0}


def test_a_way_of_computing_feigns_what_the_others_cannot_explain():
    """Each of two ways looks like drag; what both share is known once either is, so that one more would feign only what is its own."""
    rng, found = np.random.default_rng(3), {}
    for shared in (0.0, 1.0):
        normals = []
        for A, r in dense(rng, lambda k: {}, count=6, n=80):
            drag = TYPICAL["air_normal_drag"] * A[:, NAMES.index("air_normal_drag")]
            common = 3 * (drag + rng.standard_normal(80))
            own = [0.6 * drag + rng.standard_normal(80) for _ in range(2)]
            B = np.column_stack([A, *(shared * common + (1 - shared) * d for d in own)])
            normals.append(Normals((*NAMES, "numerics_mesh", "numerics_contact"), B.T @ B, B.T @ r, float(r @ r), 80))
        found[shared] = feigned([DRAG], MeshDoubt(0.0, 0.0, 0.0), normals, 0.0)["air_normal_drag"]
    assert found[0.0] == pytest.approx(0.6 * TYPICAL["air_normal_drag"], rel=0.25)
    assert found[1.0] < 0.05 * TYPICAL["air_normal_drag"]


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


def test_what_the_mesh_leaves_in_doubt_is_evidence_for_nobody():
    """Against the dense covariance; the doubtful effect keeps its own column."""

    class Doubtful(type(DRAG)):
        def feigned(self, doubt):
            return np.array([doubt.contact])

    rng = np.random.default_rng(5)
    (A, r), *_ = dense(rng, lambda k: {}, count=1, n=60)
    n = without_doubts(Normals(tuple(NAMES), A.T @ A, A.T @ r, float(r @ r), 60), [Doubtful(), EFFECTS[1]], MeshDoubt(3.0, 1.0, 0.0))
    a = A[:, NAMES.index("air_normal_drag")]
    C = np.eye(60) + 9.0 * np.outer(a, a)
    assert n.names == tuple(NAMES)
    np.testing.assert_allclose(n.G, A.T @ np.linalg.solve(C, A), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(n.g, A.T @ np.linalg.solve(C, r), rtol=1e-8, atol=1e-10)
    assert n.logdet == pytest.approx(np.linalg.slogdet(C)[1])
