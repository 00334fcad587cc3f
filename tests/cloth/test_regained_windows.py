"""A step is judged by the windows followed before and after it: one that is regained buys no loss in the others, one that is lost ends it.

Windows that nobody simulated: at the start five are followed and a sixth is not; what a step makes of each is said beforehand.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from tasks.cloth.base_parameters import PARAMETERS
from tasks.cloth.base_refit import BaseFit, refit
from tasks.cloth.joint_refit import refit_jointly
from tasks.cloth.nuisances import Prior
from tasks.cloth.shooting import Evidence, Job, about_nearer_start
from tasks.cloth.start_state import States
from tasks.cloth.windows import Normals, Prediction, Recording, Window
from tasks.effects.effect import Motion, Subject
from tasks.effects.model import Model
from tests.cloth.test_gauss_newton import TRUTH, panel

COORDINATES = 100
BEFORE = (1.0, 1.0, 1.0, 1.0, 1.0, None)  # χ² per coordinate; None: not followed


@dataclass
class Foretold:
    """Follows windows of the starting fabric as `BEFORE` says, and those of any other one as `after` does; all from where they were seen."""

    after: tuple[float | None, ...]

    def __call__(self, what, jobs):
        if what is about_nearer_start:
            return [found for _, found in jobs]
        at_start = jobs[0].model.subject.fabric == TRUTH
        return [evidence(job.window, misfit) for job, misfit in zip(jobs, BEFORE if at_start else self.after, strict=True)]


def evidence(window, misfit):
    x = np.zeros((window.length + 1, 9, 3))
    if misfit is None:
        return Evidence(Prediction(window, x[:1], {}, "stalled", 0), Normals((), np.zeros((0, 0)), np.zeros(0), np.nan, 0))
    G = 40.0 * np.eye(2)
    return Evidence(Prediction(window, x, {}, "converged", 0), Normals(PARAMETERS, G, G @ [0.5, 0.5], misfit * COORDINATES, COORDINATES))


def stepped(how, after):
    """The fabric after at most one step."""
    scene = panel(3, frames=4)
    model = Model(Subject(scene.cloth, TRUTH, scene.collider, np.full(9, "free"), scene.fps), scene.settings)
    recording = Recording(scene.collider, Motion(scene.collider_motion, scene.boundary_motion), scene.observed, scene.noise_m)
    known = States(np.zeros((4, 9, 3)), np.zeros((4, 9, 3)), "converged")
    jobs = [Job(model, recording, Window(0, 3 * k, 3), known, np.zeros((0, 9))) for k in range(len(BEFORE))]
    if how == "base":
        return refit(jobs, noise=1e-3, iterations=1, run=Foretold(after)).model.subject.fabric
    base = BaseFit(model, np.eye(2), Prior(1e-3, 1e-2), (), (), "converged")
    return refit_jointly(base, jobs, (), noise=1e-3, iterations=1, run=Foretold(after)).model.subject.fabric


@pytest.mark.parametrize("how", ["base", "joint"])
@pytest.mark.parametrize(
    ("after", "taken"),
    [
        ((4.0, 4.0, 4.0, 4.0, 4.0, 1.0), False),
        ((0.9, 0.9, 0.9, 0.9, 0.9, 1.0), True),
        ((0.9, 0.9, 0.9, 0.9, 0.9, 50.0), True),  # nothing was known of the sixth that it could be worse than
        ((0.9, 0.9, 0.9, 0.9, 0.9, None), True),
        ((0.9, 0.9, 0.9, 0.9, None, None), False),
        ((0.9, 0.9, 0.9, 0.9, None, 0.9), False),  # as many, but one of those that counted is lost
    ],
)
def test_a_step_is_taken_for_what_it_does_to_windows_followed_before_and_after(how, after, taken):
    assert (stepped(how, after) != TRUTH) == taken
