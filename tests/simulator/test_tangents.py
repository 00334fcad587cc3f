"""Tangents against central differences of whole simulations, over windows of ten frames."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.simulator import Cloth, Fabric, Settings
from tests.effects.scenes import FPS, struck
from tests.effects.scenes import TIGHT as STRUCK
from tests.effects.test_memory import Diary
from tests.simulator.scenes import run, sheet, sphere, still

FRAMES = 11
TIGHT = Settings(integrator="bdf2", substeps=2, acceleration_tolerance=1e-8)
CHANGE = {
    "log_density": lambda f, e: replace(f, density=f.density * np.exp(e)),
    "log_membrane": lambda f, e: replace(f, membrane=f.membrane * np.exp(e)),
    "log_bending": lambda f, e: replace(f, bending=f.bending * np.exp(e)),
    "log_rest_scale": lambda f, e: replace(f, rest_scale=f.rest_scale * np.exp(e)),
    "orthotropy": lambda f, e: replace(f, orthotropy=f.orthotropy + e),
    "friction": lambda f, e: replace(f, friction=f.friction + e),
}


def _scene():
    """A cloth that hangs by an edge over a sphere which pushes it aside and rubs along it."""
    x, faces = sheet(6, 6, length=0.3, width=0.3)
    cloth = Cloth(x, faces, np.arange(6))
    ball, ball_faces = sphere(2, 0.08)
    motions = still(FRAMES, cloth, (ball + np.array([0.17, -0.0851, 0.15]), ball_faces))
    way = np.linspace(0, 1, FRAMES)[:, None, None]
    motions["collider_motion"] = motions["collider_motion"] + 0.02 * way * np.array([0.0, 1.0, 1.0])
    return cloth, motions


def _ends(cloth, fabric, motions, settings, **others):
    frame = run(cloth, fabric, motions, settings=settings, **others)[-1]
    return np.stack([frame.x, frame.v])


def _relative(tangent, difference):
    return np.linalg.norm(tangent[0] - difference[0]) / np.linalg.norm(difference[0])


@pytest.mark.parametrize("name", CHANGE)
@pytest.mark.parametrize("integrator", ["bdf2", pytest.param("backward_euler", marks=pytest.mark.slow)])
def test_parameters_against_central_differences(name, integrator):
    cloth, motions = _scene()
    fabric, settings = Fabric(bending=20, friction=0.3, orthotropy=0.1), replace(TIGHT, integrator=integrator)
    frame = run(cloth, fabric, motions, settings=settings, tangents=(name,))[-1]
    e = 1e-6 if name == "log_rest_scale" else 1e-5  # 1e-5 of rest length meets another contact history; 1e-6 drowns the others in rounding
    high, low = (_ends(cloth, CHANGE[name](fabric, sign * e), motions, settings) for sign in (1, -1))
    difference = (high - low) / (2 * e)
    assert _relative(frame.tangents[name], difference) < 1e-4
    assert _relative(frame.tangents[name], 1.01 * difference) > 1e-3  # the comparison can tell 1 %


def test_start_modes_against_central_differences():
    cloth, motions = _scene()
    rng = np.random.default_rng(3)
    mode = rng.normal(size=(2, *cloth.x_rest.shape)) * np.array([0.01, 0.3])[:, None, None]
    mode[:, cloth.boundary] = 0
    x0, v0 = cloth.x_rest, np.zeros_like(cloth.x_rest)
    frame = run(cloth, Fabric(bending=20), motions, settings=TIGHT, x0=x0, v0=v0, start_modes={"mode": (mode[0], mode[1])})[-1]
    e = 1e-5
    high, low = (_ends(cloth, Fabric(bending=20), motions, TIGHT, x0=x0 + s * e * mode[0], v0=v0 + s * e * mode[1]) for s in (1, -1))
    assert _relative(frame.tangents["mode"], (high - low) / (2 * e)) < 1e-4


def test_motion_modes_against_central_differences():
    """The ball and the pinned edge displaced by a smooth wiggle each, beside a column that moves neither."""
    cloth, motions = _scene()
    t = np.linspace(0, 3, FRAMES)[:, None, None]
    dc = 0.01 * np.sin(t) * np.ones_like(motions["collider_motion"]) * np.array([0.3, 1.0, 0.2])
    db = 0.01 * np.sin(2 * t) * np.ones_like(motions["boundary_motion"]) * np.array([1.0, 0.5, -0.5])
    fabric = Fabric(bending=20, friction=0.3)
    frame = run(cloth, fabric, motions, settings=TIGHT, tangents=("log_bending",), motion_modes={"both": (dc, db)})[-1]
    e = 1e-4
    ends = []
    for sign in (1, -1):
        moved = motions | {
            "collider_motion": motions["collider_motion"] + sign * e * dc,
            "boundary_motion": motions["boundary_motion"] + sign * e * db,
        }
        ends.append(_ends(cloth, fabric, moved, TIGHT))
    assert _relative(frame.tangents["both"], (ends[0] - ends[1]) / (2 * e)) < 1e-4


@pytest.mark.parametrize("name", ["log_membrane", "log_density", "start", "motion"])
def test_a_start_that_is_freed_against_central_differences(name):
    """A ball begins 10 mm inside a sheet, where it says where cloth is: derivatives had held that the start still did, 50 times too much."""
    x, faces = sheet(6, 6, length=0.3, width=0.3)
    cloth, (ball, ball_faces) = Cloth(x, faces, np.arange(6)), sphere(2, 0.08)
    motions = still(4, cloth, (ball + np.array([0.17, -0.07, 0.15]), ball_faces))
    rng = np.random.default_rng(5)
    dx, dv = rng.normal(size=(2, *x.shape)) * np.array([0.01, 0.3])[:, None, None]
    dx[cloth.boundary], dv[cloth.boundary] = 0, 0
    dc, db = 0.01 * np.ones_like(motions["collider_motion"]), 0.02 * np.ones_like(motions["boundary_motion"]) * np.array([0, 1.0, 0])
    kind = {"start": {"start_modes": {"start": (dx, dv)}}, "motion": {"motion_modes": {"motion": (dc, db)}}}
    fabric, e = Fabric(bending=20), 1e-5

    def ends(by):
        start, moved = by * (name == "start"), by * (name == "motion")
        driven = motions | {
            "collider_motion": motions["collider_motion"] + moved * dc,
            "boundary_motion": motions["boundary_motion"] + moved * db,
        }
        own = CHANGE[name](fabric, by) if name in CHANGE else fabric
        frames = run(cloth, own, driven, settings=TIGHT, x0=x + start * dx, v0=start * dv)
        return [np.stack([f.x, f.v]) for f in (frames[0], frames[-1])]

    frames = run(cloth, fabric, motions, settings=TIGHT, x0=x, v0=0 * x, **kind.get(name, {"tangents": (name,)}))
    assert frames[0].moved > 5e-3
    for frame, high, low in zip((frames[0], frames[-1]), ends(e), ends(-e), strict=True):
        assert _relative(frame.tangents[name], (high - low) / (2 * e)) < 1e-4


def test_through_halved_steps_against_central_differences():
    """A panel struck by a ball, with too few iterations for two steps of the blow: step lengths change there and back under friction."""
    s, motion, x0, v0 = struck()
    settings = replace(STRUCK, newton_iterations=12)

    def walk(fabric, **others):
        diary = Diary()
        motions = {"collider": s.collider, "collider_motion": motion.collider, "boundary_motion": motion.boundary}
        frames = run(s.cloth, fabric, motions, fps=FPS, settings=settings, x0=x0, v0=v0, potentials=(diary,), **others)
        return frames[-1], [step.h for _, step in diary.accepted]

    frame, lengths = walk(s.fabric, tangents=("log_bending", "friction"))
    assert len(lengths) == FRAMES + 1 and min(lengths) == pytest.approx(0.5 / FPS)
    e = 1e-5
    (high, one), (low, two) = (
        walk(replace(s.fabric, bending=s.fabric.bending * np.exp(δ), friction=s.fabric.friction + δ)) for δ in (e, -e)
    )
    assert one == two == lengths
    together = np.add(frame.tangents["log_bending"], frame.tangents["friction"])
    assert _relative(together, np.stack([high.x - low.x, high.v - low.v]) / (2 * e)) < 1e-6


def test_unknown_parameter_is_named():
    cloth, motions = _scene()
    with pytest.raises(KeyError, match=r"no term has the parameter 'stiffness'; there are .*log_membrane"):
        run(cloth, Fabric(), motions, settings=TIGHT, tangents=("stiffness",))
