"""Closed forms of what is different about the fabric."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.effects.effect import Motion, Subject
from tasks.effects.library import library
from tasks.effects.model import Model
from tasks.simulator import NO_COLLIDER, Cloth, Fabric, Settings
from tasks.simulator.hinge_bending import angles
from tests.effects.scenes import FABRIC, TIGHT, struck, walk
from tests.simulator.scenes import sheet

LIBRARY = library()
LENGTH, WIDTH = 0.4, 0.1


def strip(columns: int = 3, rows: int = 9, fabric: Fabric = FABRIC, boundary: int = 3) -> Subject:
    """A vertical strip that hangs from its first row, u across and v along it."""
    flat, faces = sheet(rows, columns, length=LENGTH, width=WIDTH)
    x = np.stack([flat[:, 2], -flat[:, 0], np.zeros(len(flat))], 1)
    cloth = Cloth(x, faces, np.arange(boundary), np.ascontiguousarray(x[faces][:, :, :2]))
    return Subject(cloth, fabric, NO_COLLIDER, np.full(len(x), "free", "<U7"), 2.0)


def at_rest(s: Subject, name: str, θ: list[float], *, x0: np.ndarray | None = None, frames: int = 30, **settings) -> np.ndarray:
    """Where cloth comes to rest under one effect: backward Euler in long steps."""
    model = Model(s, replace(Settings(integrator="backward_euler", substeps=1, **settings)), (LIBRARY[name],), {name: np.array(θ)})
    x0 = s.cloth.x_rest if x0 is None else x0
    still = Motion(np.zeros((frames, 0, 3)), np.tile(s.cloth.x_rest[s.cloth.boundary], (frames, 1, 1)))
    last = list(model.run(still, x0, np.zeros_like(x0)))[-1]
    assert last.converged and np.abs(last.v).max() < 1e-4, last.ending
    return last.x


def test_a_longer_pattern_hangs_lower_by_its_share():
    """Scaled by e^s the strip is e^s longer, and its own sag, second order in weight, e^2s of what it was."""
    s, stiff = 0.02, replace(FABRIC, membrane=50.0)
    base, longer = (at_rest(strip(fabric=stiff), "fabric_rest_scale", [θ])[-2, 1] for θ in (0.0, s))
    assert longer / base == pytest.approx(np.exp(s), rel=5e-4)
    assert longer / base != pytest.approx(1, rel=1e-2)


def test_orthotropy_stretches_the_weak_way():
    """Hanging along the warp, E_v = E e^−a: the sag is e^a of what it was."""
    a, stiff = 0.5, replace(FABRIC, membrane=50.0, poisson=0.0)
    sag = [-at_rest(strip(fabric=stiff), "fabric_orthotropy", [θ])[-2, 1] - LENGTH for θ in (0.0, a)]
    assert sag[1] / sag[0] == pytest.approx(np.exp(a), rel=0.02)


def test_stiffening_under_uniaxial_stretch():
    """σ = E t ε (1 + c ε²) per unit width, ε the Green strain; the force is σ λ."""
    s, c, λ = strip(fabric=replace(FABRIC, poisson=0.0)), 500.0, 1.06
    x = s.cloth.x_rest * np.array([1.0, λ, 1.0])
    x[: s.cloth.boundary.size] = s.cloth.x_rest[: s.cloth.boundary.size]
    top = s.cloth.boundary
    (term,) = LIBRARY["fabric_stiffening"].potentials(s, [c])
    pull = -term.gradient(x, None)[top, 1].sum()
    ε = (λ**2 - 1) / 2
    assert pull == pytest.approx(-s.fabric.stretch_stiffness * c * ε**3 * λ * WIDTH, rel=1e-9)


def _rolled(flat: np.ndarray, κ: float, direction: float) -> np.ndarray:
    """The sheet (x, 0, z) on a cylinder of curvature κ [1/m] whose generators lie across `direction` [rad] and that bulges towards +y."""
    u = np.array([np.cos(direction), 0, np.sin(direction)])
    s = flat @ u
    return flat + np.outer(np.sin(κ * s) / κ - s, u) + np.outer((np.cos(κ * s) - 1) / κ, [0, 1, 0])


@pytest.mark.parametrize("direction", [0.0, 0.5, np.pi / 2])
def test_the_moment_of_the_rest_curvature_is_that_of_its_tensor(direction):
    """Rolling a sheet up by κ in a direction gains 6k κ κ̄ per area, κ̄ = κ₀ + Δκ cos 2φ, whatever the mesh; only its border lacks hinges."""
    flat, faces = sheet(41, 41)
    faces = faces[:, ::-1] if np.cross(*(flat[faces[0]][1:] - flat[faces[0]][0]))[1] < 0 else faces
    cloth = Cloth(flat, faces, uv=np.ascontiguousarray(flat[faces][:, :, [0, 2]]))
    s, κ, (mean, difference) = Subject(cloth, FABRIC, NO_COLLIDER, np.full(len(flat), "free"), 30.0), 0.1, (6.0, 2.5)
    (term,) = LIBRARY["fabric_rest_curvature"].potentials(s, [mean, difference])
    gain = -term.energy(_rolled(flat, κ, direction), None)
    assert gain == pytest.approx(6 * FABRIC.hinge_constant * κ * (mean + difference * np.cos(2 * direction)), rel=0.03)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_strip_without_weight_curls_away_from_its_normals_when_positive(sign):
    flat, faces = _regular(17)
    cloth = Cloth(flat, faces, np.arange(2), np.ascontiguousarray(flat[faces][:, :, [0, 2]]))
    s = Subject(cloth, FABRIC, NO_COLLIDER, np.full(len(flat), "free", "<U7"), 2.0)
    x = at_rest(s, "fabric_rest_curvature", [3.0 * sign, 3.0 * sign], frames=40, gravity=(0.0, 0.0, 0.0))
    normal = np.cross(*(flat[faces[0]][1:] - flat[faces[0]][0]))
    height = (x[16:18].mean(0) - (x[:2].mean(0) + x[-2:].mean(0)) / 2) @ normal / np.linalg.norm(normal)
    assert sign * height == pytest.approx(
        6.0 * 0.2**2 / 8, rel=0.2
    )  # the sagitta; one row of triangles bends 12 % more than the tensor says


def _regular(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """A strip along x, two vertices wide, of equilateral triangles whose ties across are 25 mm apart."""
    h = 0.0125
    side = 2 * h / np.sqrt(3)
    x = np.array([[h * i, 0, side * (k + 0.5 * (i % 2))] for i in range(rows) for k in range(2)])
    faces = []
    for i in range(rows - 1):
        a, b, c, d = 2 * i, 2 * i + 1, 2 * i + 2, 2 * i + 3
        faces += [[a, b, c], [b, d, c]] if i % 2 == 0 else [[a, d, c], [a, b, d]]
    return x, np.array(faces, np.int32)


def test_seams_are_found_by_zone_and_by_cuts_of_the_pattern():
    from tasks.effects.fabric_seam_stiffness import seam_hinges

    s = struck()[0]
    hinges = s.cloth.hinges
    by_zone = seam_hinges(s)
    assert by_zone.any() and (s.zone[hinges[by_zone, :2]] == "seam").all()
    x = s.cloth.x_rest
    right = x[s.cloth.faces].mean(1)[:, 0] > 0.06
    uv = s.cloth.uv + 0.5 * right[:, None, None]
    cut = replace(s, cloth=replace(s.cloth, uv=uv), zone=np.full(len(x), "free"))
    on = x[hinges[seam_hinges(cut), :2], 0]
    assert len(on) == 5 and np.allclose(on, 0.06)


def test_a_seam_is_as_stiff_as_said():
    """Bent about the seam alone, the hinges give e^r of the base's moment."""
    from tasks.simulator.hinge_bending import HingeBending

    s, r = struck()[0], 1.5
    x = s.cloth.x_rest.copy()
    beyond = x[:, 0] > 0.18 + 1e-9
    x[beyond, 2] += 0.3 * (x[beyond, 0] - 0.18)
    base = HingeBending.of(s.cloth, s.fabric)
    (term,) = LIBRARY["fabric_seam_stiffness"].potentials(s, [r])
    from tasks.effects.fabric_seam_stiffness import seam_hinges

    folded = np.abs(angles(x, base.hinges)) > 0.1
    on = seam_hinges(s)
    share = (base.weight * angles(x, base.hinges) ** 2)[on & folded].sum()
    assert term.energy(x, None) == pytest.approx((np.exp(r) - 1) * share, rel=1e-9)


def test_a_fold_beyond_yield_leaves_its_share():
    """One hinge folded to φ and opened: its rest angle is p (φ − φ_y), where no moment is left."""
    cloth = Cloth(np.array([[0, 0, 0], [0.02, 0, 0], [0.01, 0, 0.02], [0.01, 0, -0.02]]), np.array([[0, 2, 1], [0, 1, 3]]))
    s, p = Subject(cloth, FABRIC, NO_COLLIDER, np.full(4, "free"), 30.0), 0.3
    (term,) = LIBRARY["fabric_crease"].potentials(s, [p])
    term.begin(cloth.x_rest)

    def folded(φ):
        x = cloth.x_rest.copy()
        x[3] = [0.01, -0.02 * np.sin(φ), -0.02 * np.cos(φ)]
        return x

    sign = np.sign(angles(folded(0.5), cloth.hinges)[0])
    for φ in (0.4, 1.2, 0.9, 0.3):
        term.accept(folded(φ), None)
    assert term.limit[0] == pytest.approx(0.5)  # 20 mm triangles are too coarse for 50 1/m
    assert term.π[0] == pytest.approx(sign * (1.2 - 0.5))
    crease = term.π.copy()
    term.accept(folded(-0.1), None)  # 0.8 back from the crease: beyond yield the other way
    assert term.π[0] == pytest.approx(sign * 0.4)
    term.π = crease
    flat = term.base.gradient(folded(0), None) + term.gradient(folded(0), None)
    ease = term.base.gradient(folded(p * 0.7), None) + term.gradient(folded(p * 0.7), None)
    assert np.abs(ease).max() < 1e-12 < 1e-6 < np.abs(flat).max()


def test_all_creases_of_the_struck_panel_are_those_of_the_slow_walk():
    """The memory after a whole motion, hinge by hinge, against a loop over its frames."""
    from tasks.effects.fabric_crease import Creases

    s, *_ = struck()
    frames, _ = walk(struck(), settings=TIGHT)
    term = Creases(s, 0.0)
    slow = np.zeros(len(s.cloth.hinges))
    for f in frames[1:]:
        term.accept(f.x, None)
        for i, θ in enumerate(angles(f.x, s.cloth.hinges) - term.base.rest_angle):
            φ = θ - slow[i]
            if abs(φ) > term.limit[i]:
                slow[i] = θ - np.sign(φ) * term.limit[i]
    np.testing.assert_allclose(term.π, slow, atol=1e-14)
    assert np.count_nonzero(slow) > 0
