"""The budget of the gap: its items add up, and each is what the dense computation says."""

from dataclasses import dataclass

import numpy as np
import pytest

from tasks.cloth.nuisances import Prior
from tasks.cloth.shooting import Evidence
from tasks.cloth.windows import Normals, Prediction, Window
from tasks.gap.budget import budget
from tasks.gap.screening import compress
from tests.gap.synthetic import EFFECTS, NAMES, TYPICAL, dense

STATE, PRIOR, START = ["x 0 x", "v 0 x"], Prior(0.5, 2.0), 9.0


@dataclass(frozen=True)
class Base:
    prior: Prior
    history: tuple


@dataclass(frozen=True)
class Screened:
    base: Base
    evidence: tuple
    prior: Prior
    windows: object


@pytest.fixture(scope="module")
def made():
    """Windows whose residual holds one and a half times the numerics' column; and what numerics take, dense."""
    rng, evidence, taken, count = np.random.default_rng(0), [], 0.0, 0
    for k, (A, r) in enumerate(dense(rng, lambda k: {"air_normal_drag": 5.0, "contact_friction": 0.2}, n=60)):
        S, D = rng.standard_normal((60, 2)), rng.standard_normal(60)
        r = r + 1.5 * D
        C = np.eye(60) + S @ np.diag(PRIOR.variances(STATE)) @ S.T
        taken += r @ np.linalg.solve(C, r) - (r - D) @ np.linalg.solve(C + np.outer(D, D), r - D)
        count += 60
        B = np.column_stack([A, S, D])
        n = Normals((*NAMES, *STATE, "numerics_mesh"), B.T @ B, B.T @ r, float(r @ r), 60)
        evidence.append(Evidence(Prediction(Window(0, k, 1), np.zeros((2, 20, 3)), {}, "converged", 1), n))
    windows = compress(evidence, PRIOR, EFFECTS)
    return Screened(Base(PRIOR, ({"misfit": START},)), tuple(evidence), PRIOR, windows), taken / count


def test_items_add_up_to_the_start(made):
    screened, _ = made
    for named in (None, screened.windows.fit([EFFECTS[0]]), screened.windows.fit([EFFECTS[0], EFFECTS[2]])):
        assert sum(i.misfit for i in budget(screened, named)) == pytest.approx(START)


def test_numerics_take_what_the_dense_covariance_says(made):
    screened, taken = made
    items = {i.part: i.misfit for i in budget(screened, None)}
    assert items["numerics"] == pytest.approx(taken) and taken > 0.5


def test_what_is_named_is_no_longer_unexplained(made):
    screened, _ = made
    before, after = ({i.name: i.misfit for i in budget(screened, h)} for h in (None, screened.windows.fit([EFFECTS[0], EFFECTS[2]])))
    ratio = (5.0 / TYPICAL["air_normal_drag"]) ** 2 / (0.2 / TYPICAL["contact_friction"]) ** 2  # of their mean squares, as made
    assert after["air_normal_drag"] / after["contact_friction"] == pytest.approx(ratio, rel=0.3)
    assert before["unexplained"] - after["unexplained"] == pytest.approx(after["air_normal_drag"] + after["contact_friction"])
    assert after["unexplained"] + after["noise floor"] == pytest.approx(1, abs=0.15)  # white noise alone is left
    assert after["noise floor"] == pytest.approx(0.9, abs=0.15)
