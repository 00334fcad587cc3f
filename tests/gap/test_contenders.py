"""Which hypotheses the simulator refits."""

from dataclasses import replace

import numpy as np

from tasks.gap.refits import contenders
from tests.gap.test_hypotheses import EFFECTS, windows

NOBODY = frozenset()


def ranked(truth, **options):
    w = windows(np.random.default_rng(0), truth=truth, **options)
    return sorted((w.fit([e]) for e in EFFECTS), key=lambda h: -h.evidence)


def test_the_strongest_are_refitted_and_nothing_where_nothing_is_strong():
    assert contenders(ranked({"contact_friction": 0.3}), [], 3, NOBODY)[0].name == "contact_friction"
    assert contenders(ranked({}), [], 3, NOBODY) == []


def test_of_twins_one_is_refitted():
    singles = ranked({"air_normal_drag": 8.0}, alike=[("air_normal_drag", "fabric_mass_damping")])
    first, second = singles[:2]
    assert {first.name, second.name} == {"air_normal_drag", "fabric_mass_damping"}
    assert {h.name for h in contenders(singles, [], 3, NOBODY)} >= {first.name, second.name}
    assert second.name not in {h.name for h in contenders(singles, [], 3, frozenset([frozenset([first.name, second.name])]))}


def test_what_was_seen_otherwise_keeps_its_own_strength_and_leaves_room_for_one_more():
    singles = ranked({"contact_friction": 0.3})
    tilt = next(h for h in singles if h.name == "gravity_tilt")
    seen = replace(tilt, strengths=dict.fromkeys(tilt.strengths, 0.1))
    chosen = contenders(singles, [seen], 1, NOBODY)
    assert chosen[0] is seen
    assert [h.name for h in chosen] == ["gravity_tilt", "contact_friction"]
