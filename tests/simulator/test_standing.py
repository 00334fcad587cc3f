"""A simulation that goes on from where another stood yields the same frames, bit by bit."""

import io
from dataclasses import replace

import numpy as np
import pytest

from tasks.effects.library import library
from tasks.geometry.faults import BadInput
from tasks.simulator import Cloth, Fabric, Settings, Standing, simulate
from tasks.simulator.base_model import base_problem
from tasks.simulator.potential import Step, StepTangent
from tests.effects.scenes import FPS, TIGHT, struck
from tests.simulator.scenes import sheet, sphere, still


def layers():
    """Two sheets, one lying on the other, that fall over a ball: friction, halved steps, a pattern that grows by contact among cloth."""
    x, faces = sheet(7, 7, length=0.4, width=0.4)
    ball = sphere(2, 0.08)
    cloth = Cloth(np.concatenate([x, x + np.array([0.003, 9e-4, 0.002])]), np.concatenate([faces, faces + len(x)]), np.arange(2))
    scene = still(6, cloth, (ball[0] + np.array([0.2, -0.09, 0.2]), ball[1]))
    return cloth, scene | {"fps": 25.0, "settings": Settings(newton_iterations=25), "fabric": Fabric(friction=0.4, self_friction=0.4)}


def both(cloth, scene, after, terms=tuple, **others):
    """Frames of one simulation, and those after frame `after` of one that was stopped there, its standing written to a file and read."""
    stood: list[Standing] = []
    whole = list(simulate(cloth, on_standing=stood.append, potentials=terms(), **scene, **others))
    assert whole[-1].converged, whole[-1].ending
    file = io.BytesIO()
    np.savez(file, **stood[after].as_arrays())
    file.seek(0)
    with np.load(file) as kept:
        resume = Standing.from_arrays(dict(kept))
    return whole, list(simulate(cloth, resume=resume, potentials=terms(), **scene, **others))


def alike(whole, resumed, after):
    assert [f.index for f in resumed] == list(range(after + 1, len(whole)))
    for one, other in zip(whole[after + 1 :], resumed, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        np.testing.assert_array_equal(one.v, other.v)
        assert one.newton_iterations == other.newton_iterations and one.tangents.keys() == other.tangents.keys()
        for name, pair in one.tangents.items():
            np.testing.assert_array_equal(pair, other.tangents[name])


@pytest.mark.parametrize("after", [0, 3])
def test_contact_friction_and_tangents(after):
    cloth, scene = layers()
    rng = np.random.default_rng(0)
    columns = {"tangents": ("friction", "log_bending"), "start_modes": {"sway": rng.normal(size=(2, *cloth.x_rest.shape))}}
    alike(*both(cloth, scene, after, **columns), after)


def test_the_layers_touch_one_another():
    """Else nothing above would depend on the pattern."""
    cloth, scene = layers()
    stood = []
    list(simulate(cloth, on_standing=stood.append, **scene))
    assert len(stood[3].pattern) > len(stood[0].pattern)


@pytest.mark.parametrize("name", ["fabric_bending_hysteresis", "fabric_shear_hysteresis", "fabric_crease"])
def test_terms_with_a_memory(name):
    s, motion, x0, v0 = struck()
    effect = library()[name]
    scene = {"collider_motion": motion.collider, "boundary_motion": motion.boundary, "fps": FPS, "x0": x0, "v0": v0, "settings": TIGHT}
    scene |= {"fabric": s.fabric, "collider": s.collider, "tangents": (name, "log_bending")}
    alike(*both(s.cloth, scene, 5, lambda: effect.potentials(s, [σ.typical for σ in effect.strengths])), 5)


@pytest.mark.parametrize("effect", [e for e in library().values() if "potentials" in e.acts_through], ids=lambda e: e.name)
def test_what_is_moved_on_is_named(effect):
    """What `begin`, `accept` and `accept_tangent` set is the term's memory, all of it; the base model has none."""
    s, motion, x0, _ = struck()
    own = effect.potentials(s, effect.typical)
    problem = base_problem(s.cloth, s.fabric, s.collider, motion.collider[0], settings=TIGHT, potentials=own)
    assert effect.kind != "state" or any(p.memory for p in own)
    for term in problem.potentials:
        assert moved_on(term, x0, motion.collider, effect.columns) == set(term.memory), type(term).__name__


def moved_on(term, x, collider, names):
    """Names of the attributes that a step of cloth from x [V, 3] changes."""
    rng, none = np.random.default_rng(0), np.zeros_like(x)
    dx = rng.normal(size=(len(names), *x.shape))
    step = Step(1 / FPS, 1 / FPS, x, none, x, none, collider[1], collider[0], collider[0])
    d = StepTangent(dx, dx, dx, dx, *(np.zeros((0, *collider[0].shape)),) * 3)
    y = x + 0.02 * rng.normal(size=x.shape)
    begun = changed(term, lambda: term.begin(x))
    return begun | changed(term, lambda: term.accept_tangent(y, step, dx, d, names)) | changed(term, lambda: term.accept(y, step))


def changed(term, call):
    """Names of the attributes that are another object after the call, or an array of other values."""
    before, values = dict(vars(term)), {name: np.copy(value) for name, value in vars(term).items() if isinstance(value, np.ndarray)}
    call()
    other = {name for name, value in vars(term).items() if name not in before or value is not before[name]}
    return other | {name for name, value in values.items() if not np.array_equal(value, before[name])}


def test_a_standing_of_another_cloth_is_refused():
    cloth, scene = layers()
    stood = []
    next(simulate(cloth, on_standing=stood.append, **scene))
    other = replace(stood[0], now=replace(stood[0].now, x=np.zeros((3, 3))))
    with pytest.raises(BadInput, match="resume"):
        simulate(cloth, resume=other, **scene)
