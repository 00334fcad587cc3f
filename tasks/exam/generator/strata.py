"""Which cases an exam holds: strata, causes, magnitudes, and what may be named without loss.

The table of admissible classes is part of the question and fixed with it: names that a recording need not be able to tell apart.
"""

from dataclasses import dataclass, replace

import numpy as np

from tasks.exam.generator.causes import CAUSES, LIBRARY, OUTSIDE
from tasks.exam.generator.scenes import MOTIONS

STRATA = {"single": 64, "pair": 24, "null": 32, "outside": 24, "inseparable": 16}
MAGNITUDES = (1.0, 2.0, 4.0, 8.0)  # multiples of the floor
ENGINE_STRATA = {"single": 16, "null": 6, "outside": 2}  # of another engine, whose nulls tell from which size on its effects can count
ENGINE_MAGNITUDES = (4.0, 8.0)
ENGINE_SEED = 4  # its own line of random numbers
NULLS = ("plain", "wrong_base", "white_noise", "correlated_noise")
INSEPARABLE = ("density", "body_offset", "observation_delay", "observation_scale")

_CLASSES = (
    ("air_normal_drag", "air_linear_drag", "fabric_mass_damping"),
    ("fabric_mass_damping", "air_tangential_drag", "air_linear_drag"),
    ("air_wind", "gravity_tilt"),
    ("fabric_bending_damping", "fabric_bending_hysteresis"),
    ("fabric_membrane_damping", "fabric_bending_damping"),
    ("fabric_membrane_damping", "fabric_shear_hysteresis"),
    ("fabric_hem_mass", "fabric_density_gradient"),
    ("fabric_rest_scale", "observation_scale", "fabric_stiffening"),
    ("fabric_rest_curvature", "fabric_crease", "fabric_bending_hysteresis"),
    ("body_offset", "contact_thickness"),
    ("body_lag", "observation_delay"),
)


DECOYS = 0.2  # share of the cases of the other strata whose diagnosis must do without effects that are not there either


def admissible(name: str) -> frozenset[str]:
    """Names that may stand beside `name` without loss of credit, itself included."""
    return frozenset({name}.union(*(c for c in _CLASSES if name in c)))


@dataclass(frozen=True)
class Question:
    """One case before it is made. causes: name -> multiple of the floor; withheld: effects that the diagnosis must do without; twist: variant."""

    number: int
    stratum: str
    causes: dict[str, float]
    withheld: tuple[str, ...]
    twist: str
    kind: str
    motions: tuple[str, str, str]
    seed: tuple[int, ...]


def questions(count: int, seed: int) -> list[Question]:
    """`count` cases in the proportions of `STRATA`, strata interleaved so that any beginning of the list is a fair sample."""
    return [_question(number, stratum, place, seed) for number, (stratum, place) in enumerate(_interleaved(count, STRATA))]


def engine_questions(count: int, seed: int, names: tuple[str, ...], outside: tuple[str, ...]) -> list[Question]:
    """`count` cases for an engine that can make the effects `names` and, of those that the library lacks, `outside`."""
    cases = enumerate(_interleaved(count, ENGINE_STRATA))
    return [_engine_question(number, stratum, place, seed, {"single": names, "outside": outside}) for number, (stratum, place) in cases]


def _engine_question(number: int, stratum: str, place: int, seed: int, names: dict[str, tuple[str, ...]]) -> Question:
    twist, causes = "", {}
    if stratum == "null":
        twist = NULLS[place % len(NULLS)]
    else:
        causes = {_turn(names[stratum], place, seed): ENGINE_MAGNITUDES[place % len(ENGINE_MAGNITUDES)]}
    return drawn(Question(number, stratum, causes, (), twist, "", ("", "", ""), (seed, number, ENGINE_SEED)), 0)


def _interleaved(count: int, strata: dict[str, int]) -> list[tuple[str, int]]:
    total = sum(strata.values())
    given = dict.fromkeys(strata, 0)
    order = []
    for n in range(1, count + 1):
        stratum = max(strata, key=lambda s: (strata[s] * n / total - given[s], strata[s]))
        order.append((stratum, given[stratum]))
        given[stratum] += 1
    return order


def _question(number: int, stratum: str, place: int, seed: int) -> Question:
    rng = np.random.default_rng([seed, number])
    withheld, twist, causes = (), "", {}
    if stratum == "single":
        causes = {_turn(LIBRARY, place, seed): MAGNITUDES[place % 4]}
    elif stratum == "pair":
        first = _turn(LIBRARY, place, seed + 1)
        far = [n for n in LIBRARY if not admissible(n) & admissible(first) and set(CAUSES[n].needs) & set(CAUSES[first].needs)]
        far = [n for n in far if n.split("_")[0] != first.split("_")[0]]
        causes = {first: 4.0, str(rng.choice(far)): 4.0}
    elif stratum == "null":
        twist = NULLS[place % len(NULLS)]
    elif stratum == "outside":
        if place % 2:
            name = _turn(LIBRARY, place // 2, seed + 2)
            withheld, causes = tuple(sorted(admissible(name))), {name: 4.0}
        else:
            causes = {OUTSIDE[place // 2 % len(OUTSIDE)]: MAGNITUDES[1 + place // 8 % 3]}
    else:
        twist = INSEPARABLE[place % len(INSEPARABLE)]
        causes = {} if twist == "density" else {twist: 4.0}
    if stratum != "outside" and rng.uniform() < DECOYS:
        withheld = _beside(causes, rng)
    return drawn(Question(number, stratum, causes, withheld, twist, "", ("", "", ""), (seed, number)), 0)


def _beside(causes: dict[str, float], rng: np.random.Generator) -> tuple[str, ...]:
    """A class of effects that may not stand for any of the causes."""
    near = frozenset().union(*(admissible(n) for n in causes))
    return tuple(sorted(admissible(str(rng.choice([n for n in LIBRARY if not admissible(n) & near])))))


def drawn(question: Question, attempt: int) -> Question:
    """The question with a garment that can show its causes, and motions for it."""
    rng = np.random.default_rng([*question.seed, attempt, 2])
    kind = str(rng.choice(sorted(set(MOTIONS).intersection(*(CAUSES[n].needs for n in question.causes)))))
    return replace(question, kind=kind, motions=_motions(kind, question.causes, rng))


def _turn(names: tuple[str, ...], place: int, seed: int) -> str:
    """Every name once before any comes again, in an order that the seed draws."""
    return names[np.random.default_rng([seed, 77, place // len(names)]).permutation(len(names))[place % len(names)]]


def _motions(kind: str, causes: dict[str, float], rng: np.random.Generator) -> tuple[str, str, str]:
    """Three different motions; what acts where the body is gets the one that makes contact among the first two."""
    order = [str(m) for m in rng.permutation(MOTIONS[kind])]
    touching = {"curtain": "ball", "skirt": "walk", "cape": "arms", "sleeve": "elbow"}[kind]
    if any(CAUSES[n].touches for n in causes):
        order.remove(touching)
        order.insert(int(rng.integers(2)), touching)
    return order[0], order[1], order[2]
