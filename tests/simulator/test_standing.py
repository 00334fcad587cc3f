"""A simulation that goes on from where another stood yields the same frames, bit by bit."""

import io
from dataclasses import replace

import numpy as np
import pytest

from tasks.effects.library import library
from tasks.geometry.faults import BadInput
from tasks.simulator import Cloth, Fabric, Settings, Standing, simulate
from tasks.simulator.potential import Potential
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


def test_what_is_moved_on_is_named():
    """A term that overrides `accept` has a memory; one that did not name it would be resumed wrongly."""
    terms = {c for c in every(Potential) if c.__module__.startswith("tasks.") and c.accept is not Potential.accept}
    assert terms and all(c.memory for c in terms)


def every(kind):
    return {kind}.union(*(every(c) for c in kind.__subclasses__()))


def test_a_standing_of_another_cloth_is_refused():
    cloth, scene = layers()
    stood = []
    next(simulate(cloth, on_standing=stood.append, **scene))
    other = replace(stood[0], now=replace(stood[0].now, x=np.zeros((3, 3))))
    with pytest.raises(BadInput, match="resume"):
        simulate(cloth, resume=other, **scene)
