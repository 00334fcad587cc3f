"""The door of gap diagnoses from the cloth it was given: effects that this has are part of the base, and no suspects."""

from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.gap import stage
from tests.cloth.test_boundary import swing

RATIOS = {"kappa_s_over_rho": {"value": 0.01}, "kappa_b_over_rho": {"value": 0.5}}
DRAG = {"air_normal_drag": {"value": 7.5}}


class Stop(Exception):
    pass


@pytest.fixture
def asked(monkeypatch):
    """parameters of the fitted skirt -> (the model, the suspects) that the diagnosis would begin with."""
    x, faces, body, body_faces = swing(12)
    V, found = x.shape[1], {}

    def diagnose(model, recordings, effects, **options):
        found.update(model=model, suspects={e.name for e in effects})
        raise Stop

    monkeypatch.setattr(stage, "diagnose", diagnose)
    tracking = SimpleNamespace(
        vertices=x,
        faces=faces,
        uv_vertices=np.zeros((0, 2)),
        uv_faces=np.zeros_like(faces),
        part_names=("skirt",),
        part_of_face=np.zeros(len(faces), int),
        seen=np.ones(x.shape[:2], bool),
        noise_m=np.full(x.shape[:2], 1e-3),
    )

    def ask(parameters, fps=25.0):
        cloth = SimpleNamespace(parameters={"skirt": parameters}, vertices_index=np.arange(V))
        with pytest.raises(Stop):
            stage._diagnosed(
                SimpleNamespace(progress=lambda *told: None, spread=lambda run, at_once: run),
                SimpleNamespace(fps=fps),
                tracking,
                SimpleNamespace(vertices=body, faces=body_faces),
                cloth,
                np.zeros(V, int),
                stage.GapParameters(),
            )
        return found["model"], found["suspects"]

    return ask


def test_an_effect_of_the_cloth_is_in_the_base_and_no_suspect(asked):
    model, suspects = asked(RATIOS | DRAG)
    assert [e.name for e in model.effects] == ["air_normal_drag"]
    np.testing.assert_array_equal(model.strengths["air_normal_drag"], [7.5])
    assert "air_normal_drag" not in suspects and "air_lift" in suspects
    assert model.subject.fabric.bending == pytest.approx(0.5 * model.subject.fabric.density)


def test_without_effects_the_base_is_bare_and_all_are_suspects(asked):
    model, suspects = asked(RATIOS)
    assert model.effects == () and "air_normal_drag" in suspects


def test_a_computation_of_the_whole_recording_may_take_longer_than_one_of_a_second(asked, monkeypatch):
    """Twelve frames, four in a second."""
    limits = []
    monkeypatch.setattr(stage, "Pool", lambda *, limit_s, at_once: limits.append(limit_s) or nullcontext(SimpleNamespace(map=map)))
    for fps in (25.0, 4.0):
        asked(RATIOS, fps)
    assert limits == [600.0, 1800.0]
