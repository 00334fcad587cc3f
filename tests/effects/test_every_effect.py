"""What every effect of the library must be: described, absent at strength zero, differentiated rightly, and true to its claims."""

import inspect
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from tasks.effects.effect import Effect, MeshDoubt
from tasks.effects.library import library, suspects
from tasks.effects.model import Model
from tasks.simulator import Fabric, Settings, Step, StepTangent
from tasks.simulator.base_model import base_problem
from tasks.simulator.potential import Blocks, Potential
from tests.effects.scenes import FABRIC, FRAMES, TIGHT, draped, flying, hanging, seen, signature, struck, walk

LIBRARY = library()
NAMES = {
    *("air_normal_drag", "air_tangential_drag", "air_linear_drag", "air_lift", "air_added_mass", "air_wind"),
    *("fabric_membrane_damping", "fabric_bending_damping", "fabric_mass_damping", "fabric_bending_hysteresis", "fabric_shear_hysteresis"),
    *("fabric_orthotropy", "fabric_stiffening", "fabric_density_gradient", "fabric_hem_mass", "fabric_seam_stiffness"),
    *("fabric_rest_scale", "fabric_rest_curvature", "fabric_crease", "contact_friction", "contact_thickness"),
    *("body_offset", "body_lag", "boundary_slip", "observation_delay", "observation_smoothing", "observation_scale", "gravity_tilt"),
    *("numerics_time_step", "numerics_mesh", "numerics_integrator", "numerics_triangulation"),
    *("numerics_material", "numerics_bending", "numerics_contact"),
}
SECTIONS = ("Strength", "Range", "Signature:", "Confounders:", "Source:", "Limits:")
CHANGE = {
    "log_density": lambda f, e: replace(f, density=f.density * np.exp(e)),
    "log_membrane": lambda f, e: replace(f, membrane=f.membrane * np.exp(e)),
    "log_bending": lambda f, e: replace(f, bending=f.bending * np.exp(e)),
    "log_rest_scale": lambda f, e: replace(f, rest_scale=f.rest_scale * np.exp(e)),
    "orthotropy": lambda f, e: replace(f, orthotropy=f.orthotropy + e),
}

every = pytest.mark.parametrize("effect", LIBRARY.values(), ids=LIBRARY)
tangible = pytest.mark.parametrize("effect", [e for e in LIBRARY.values() if e.kind != "rerun"], ids=lambda e: e.name)
acting = pytest.mark.parametrize("effect", [e for e in LIBRARY.values() if "potentials" in e.acts_through], ids=lambda e: e.name)


def claiming(claim: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("effect", [e for e in LIBRARY.values() if claim in e.keeps], ids=lambda e: e.name)


def zero(effect: Effect) -> np.ndarray:
    return np.zeros(len(effect.strengths))


@cache
def base(scene: Callable[[], tuple] = struck, settings: Settings = TIGHT) -> list:
    """The frames of the base model."""
    return walk(scene(), settings=settings)[0]


@cache
def absent(effect: Effect) -> tuple[list, Model]:
    """The walk of the base model with the tangents of an effect that is not there."""
    return walk(struck(), (effect,), columns=True)


@cache
def present(effect: Effect) -> tuple[list, Model]:
    """The walk under an effect at typical strength, with its tangents."""
    return walk(struck(), (effect,), {effect.name: effect.typical}, columns=True)


# --- what it says


@every
def test_it_says_what_it_is(effect):
    module = sys.modules[type(effect).__module__]
    missing = [s for s in SECTIONS if s not in module.__doc__]
    assert not missing, f"{module.__file__} lacks {missing}"
    assert effect.name in NAMES and effect.confused_with <= NAMES - {effect.name}
    assert module.__name__.split(".")[-1] == effect.name
    for s in effect.strengths:
        assert s.low <= 0 <= s.high and s.low <= s.typical <= s.high and s.typical != 0 and s.symbol and s.unit


@every
def test_its_confusions_are_mutual(effect):
    assert not {other for other in effect.confused_with & set(LIBRARY) if effect.name not in LIBRARY[other].confused_with}


# --- strength zero


@every
def test_strength_zero_is_the_base_model_bit_for_bit(effect):
    frames, model = absent(effect)
    for a, b in zip(base(), frames, strict=True):
        assert np.array_equal(a.x, b.x) and np.array_equal(a.v, b.v)
    x = np.stack([f.x for f in frames])
    assert np.array_equal(model.observed(x), x)


@acting
def test_strength_zero_costs_nothing(effect):
    s, *_ = struck()
    step, x = _moment()
    for p in effect.potentials(s, zero(effect)):
        _begin(p, step)
        H = p.hessian(x, step, convex=False)
        assert p.energy(x, step) == 0 and not p.gradient(x, step).any()
        assert len(H.stencils) == 0 if isinstance(H, Blocks) else H.nnz == 0
        assert p.history_gradient(x, step, _direction(step)) is None


# --- derivatives of one step


def _moment(seed: int = 0) -> tuple[Step, np.ndarray]:
    """A step of wrinkled cloth in some motion, and where it might end."""
    _, motion, x_rest, v = struck()
    rng = np.random.default_rng(seed)
    x_n = x_rest + 0.008 * rng.normal(size=x_rest.shape)
    h, σ = 1 / 60, 1 / 90
    x_before = x_n - h * v - 0.002 * rng.normal(size=x_n.shape)
    step = Step(
        h=h,
        s=σ,
        x_n=x_n,
        v_n=v + 0.1 * rng.normal(size=v.shape),
        x_hat=(4 * x_n - x_before) / 3,
        v_hat=v + 0.1 * rng.normal(size=v.shape),
        collider=motion.collider[1],
        collider_n=motion.collider[0],
        collider_hat=motion.collider[0],
    )
    return step, x_n + h * v + 0.002 * rng.normal(size=v.shape)


def _direction(step: Step, seed: int = 1) -> StepTangent:
    """Some direction in which what the step knows might differ, collider apart."""
    rng = np.random.default_rng(seed)
    names = [f.name for f in fields(StepTangent)]
    return StepTangent(**{n: (0.0 if "collider" in n else 1.0) * rng.normal(size=(1, *getattr(step, n).shape)) for n in names})


def _begin(p: Potential, step: Step) -> None:
    """Give a term with a memory something to remember."""
    p.begin(step.x_n - 0.9 * step.h * step.v_n)
    past = replace(step, x_n=step.x_n - 0.9 * step.h * step.v_n, x_hat=step.x_n - 0.9 * step.h * step.v_n)
    p.accept(step.x_n, past)


def _terms(effect: Effect, θ: np.ndarray, step: Step, fabric: Fabric = FABRIC) -> tuple[Potential, ...]:
    s = replace(struck()[0], fabric=effect.fabric(fabric, θ))
    terms = effect.potentials(s, θ)
    for p in terms:
        _begin(p, step)
    return terms


def _dense(H, size: int) -> np.ndarray:
    if isinstance(H, Blocks):
        return H.times(np.eye(size).reshape(size, -1, 3)).reshape(size, size)
    return H.toarray()[:size, :size]


def _close(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-5) -> None:
    assert np.linalg.norm(a - b) <= tolerance * np.linalg.norm(b) + 1e-15


@acting
def test_gradient_and_hessian_are_those_of_the_energy(effect):
    step, x = _moment()
    rng = np.random.default_rng(2)
    for p in _terms(effect, effect.typical, step):
        H = _dense(p.hessian(x, step, convex=False), x.size)
        np.testing.assert_allclose(H, H.T, atol=1e-12 * max(np.abs(H).max(), 1e-30))
        lowest = np.linalg.eigvalsh(_dense(p.hessian(x, step, convex=True), x.size)).min()
        assert lowest >= -1e-9 * max(np.abs(H).max(), 1e-30)
        for _ in range(3):
            dx, e = rng.normal(size=x.shape), 1e-6
            slope = (p.energy(x + e * dx, step) - p.energy(x - e * dx, step)) / (2 * e)
            assert np.sum(p.gradient(x, step) * dx) == pytest.approx(slope, rel=1e-5, abs=1e-7 * np.linalg.norm(p.gradient(x, step)))
            e = 2e-7  # shear friction bends within strains of 5e-3
            _close((H @ dx.ravel()).reshape(x.shape), (p.gradient(x + e * dx, step) - p.gradient(x - e * dx, step)) / (2 * e))


@acting
@pytest.mark.parametrize("share", [0.0, 1.0], ids=["zero", "typical"])
def test_parameter_gradients(effect, share):
    step, x = _moment()

    def force(θ):
        return np.sum([p.gradient(x, step) for p in _terms(effect, θ, step)], axis=0)

    θ = share * effect.typical
    for i, column in enumerate(effect.columns):
        e = 1e-5 * effect.strengths[i].typical * np.eye(len(θ))[i]
        # forwards only (second order), because a strength need not make sense below zero
        difference = (4 * force(θ + e) - force(θ + 2 * e) - 3 * force(θ)) / (2 * np.abs(e).sum() * np.sign(e[i]))
        given = [p.parameter_gradient(column, x, step) for p in _terms(effect, θ, step) if column in p.parameters]
        if "fabric" in effect.acts_through:
            continue  # the terms of the base model answer too; the whole motion is compared below
        _close(np.sum(given, axis=0), difference)


@acting
@pytest.mark.parametrize("name", CHANGE)
def test_parameters_of_the_fabric(effect, name):
    """A term that grows with the density or a stiffness says so in `parameters`; one that does not has no such slope."""
    step, x = _moment()
    e = 1e-5

    def force(δ):
        return np.sum([p.gradient(x, step) for p in _terms(effect, effect.typical, step, CHANGE[name](FABRIC, δ))], axis=0)

    difference = (force(e) - force(-e)) / (2 * e)
    given = [p.parameter_gradient(name, x, step) for p in _terms(effect, effect.typical, step) if name in p.parameters]
    _close(np.sum([np.zeros_like(x), *given], axis=0), difference)


@acting
def test_history_gradient(effect):
    step, x = _moment()
    d, e = _direction(step), 1e-7
    for p in _terms(effect, effect.typical, step):

        def force(sign, p=p):
            known = {f.name: getattr(step, f.name) + sign * e * getattr(d, f.name)[0] for f in fields(StepTangent)}
            return p.gradient(x, replace(step, **known))

        given = p.history_gradient(x, step, d)
        _close(np.zeros_like(x) if given is None else given[0], (force(1) - force(-1)) / (2 * e))


# --- derivatives of the motion


@tangible
def test_the_motion_leaves_the_base_along_the_tangent_at_zero(effect):
    scene, S = struck(), signature(*absent(effect), effect)
    x = np.stack([f.x for f in base()])
    for i, column in enumerate(effect.columns):
        e = 2e-4 * effect.strengths[i].typical
        one, two = (seen(scene, effect, k * e * np.eye(len(effect.strengths))[i]) - x for k in (1, 2))
        _same_motion(S[column], (4 * one - two) / (2 * e), effect)
        bend = np.linalg.norm(two - 2 * e * S[column]) / np.linalg.norm(one - e * S[column])
        assert bend == pytest.approx(4, rel=0.2) or np.linalg.norm(one - e * S[column]) < 1e-5 * np.linalg.norm(one)


@tangible
def test_tangents_at_typical_strength(effect):
    scene, θ = struck(), effect.typical
    S = signature(*present(effect), effect)
    for i, column in enumerate(effect.columns):
        e = 5e-5 * effect.strengths[i].typical * np.eye(len(θ))[i]
        _same_motion(S[column], (seen(scene, effect, θ + e) - seen(scene, effect, θ - e)) / (2 * e[i]), effect)


def _same_motion(S: np.ndarray, difference: np.ndarray, effect: Effect) -> None:
    assert np.linalg.norm(difference) > 0
    error = np.linalg.norm(S - difference) / np.linalg.norm(difference)
    assert error <= (1e-3 if effect.kind == "state" else 1e-4)


# --- what it claims to keep


@claiming("rest")
def test_rest_is_kept(effect):
    _stays(hanging, effect)


@claiming("statics")
def test_statics_are_kept(effect):
    _stays(draped, effect)


def _stays(scene: Callable[[], tuple], effect: Effect) -> None:
    x = np.stack([f.x for f in base(scene)])
    assert np.abs(x - x[0]).max() < 1e-6
    assert np.abs(seen(scene(), effect, effect.typical) - x).max() < 1e-6


@pytest.mark.parametrize("effect", [e for e in LIBRARY.values() if e.keeps & {"momentum", "energy", "shape"}], ids=lambda e: e.name)
def test_what_is_claimed_of_flying_cloth_is_claimed_by_what_moves_it(effect):
    """Else the claim could not fail: a body that is not there lags as it likes."""
    x = np.stack([f.x for f in base(flying)])
    assert np.abs(seen(flying(), effect, effect.typical) - x).max() > 1e-7


@claiming("momentum")
def test_momentum_of_flying_cloth_is_kept(effect):
    m = FABRIC.areal_density * flying()[0].cloth.vertex_areas
    frames, _ = walk(flying(), (effect,), {effect.name: effect.typical})
    wanted = m @ base(flying)[-1].v
    np.testing.assert_allclose(m @ frames[-1].v, wanted, atol=1e-8 * np.abs(wanted).max())


@claiming("energy")
def test_no_energy_is_added(effect):
    """Kinetic energy and that of all terms for cloth held where it is, of cloth that flies without weight; strong wrinkles at the start."""
    settings, θ = replace(TIGHT, gravity=(0.0, 0.0, 0.0)), effect.typical
    frames, _ = walk(flying(), (effect,), {effect.name: θ}, settings=settings)
    before, after = (_energy(effect, θ, settings, f.x, f.v) for f in (frames[0], frames[-1]))
    own = [_energy(effect, zero(effect), settings, f.x, f.v) for f in (base(flying, settings)[k] for k in (0, -1))]
    assert after <= before * (1 + 1e-9)
    assert before - after >= 0.9 * (own[0] - own[1])  # the integrator alone loses some


def _energy(effect: Effect, θ: np.ndarray, settings: Settings, x: np.ndarray, v: np.ndarray) -> float:
    s = flying()[0]
    s = replace(s, fabric=effect.fabric(s.fabric, θ))
    problem = base_problem(s.cloth, s.fabric, s.collider, np.zeros((0, 3)), settings=settings, potentials=effect.potentials(s, θ))
    none = np.zeros((0, 3))
    still = Step(1.0, 1.0, x, 0 * x, x, 0 * x, none, none, none)
    for p in problem.potentials:
        p.begin(x)
    return problem.energy(x, still) + 0.5 * float(s.fabric.areal_density * s.cloth.vertex_areas @ np.sum(v**2, 1))


@claiming("shape")
def test_shape_is_kept(effect):
    for frame, y in zip(base(flying), seen(flying(), effect, effect.typical), strict=True):
        a, b = frame.x - frame.x.mean(0), y - y.mean(0)
        U, σ, Vt = np.linalg.svd(a.T @ b)
        assert np.abs(b - σ.sum() / np.sum(a**2) * a @ U @ Vt).max() < 1e-6


@claiming("gauge")
def test_the_gauge_is_kept(effect):
    """Twice the density and twice all stiffness leave the motion as it is."""
    twice = replace(FABRIC, density=2 * FABRIC.density, membrane=2 * FABRIC.membrane, bending=2 * FABRIC.bending)
    frames, model = present(effect)
    once = model.observed(np.stack([f.x for f in frames]))
    assert np.abs(seen(struck(twice), effect, effect.typical) - once).max() < 1e-7


# --- the library


def test_the_names_of_the_columns_differ():
    columns = [c for e in LIBRARY.values() for c in e.columns]
    assert len(set(columns)) == len(columns)


def test_all_tangents_in_one_walk_are_those_of_each_alone():
    """The 25 and more columns that the diagnosis takes from one simulation of the base model."""
    effects = tuple(suspects(LIBRARY.values()))
    together = walk(struck(), effects, columns=True)
    for effect in effects:
        one, alone = signature(*together, effect), signature(*absent(effect), effect)
        for column in effect.columns:
            _close(one[column], alone[column], 1e-9)


def test_hooks_are_all_known():
    hooks = {name for name, _ in inspect.getmembers(Effect, inspect.isfunction)}
    assert hooks == {"fabric", "settings", "potentials", "motion", "subject", "start", "observe", "feigned"}
    assert len(list(Model(struck()[0], TIGHT).run(struck()[1], *struck()[2:]))) == FRAMES


@every
def test_what_a_mesh_may_feign_grows_with_its_doubt(effect):
    """An effect that a coarse mesh can feign says so for each kind of doubt in proportion, and the others do not."""
    sure, doubtful = MeshDoubt(0.0, 0.5, 0.0), MeshDoubt(0.002, 0.5, 0.01, 1e-4)
    assert not effect.feigned(sure).any()
    σ = effect.feigned(doubtful)
    assert σ.shape == (len(effect.strengths),) and (σ >= 0).all()
    np.testing.assert_allclose(effect.feigned(MeshDoubt(0.004, 0.5, 0.02, 2e-4)), 2 * σ)
