"""Effects are found by name; all unknown names are told at once, each with the nearest one."""

import pytest

from tasks.effects.library import library
from tasks.effects.named import named
from tasks.geometry.faults import BadInput

LIBRARY = library()


def test_names_give_effects_in_their_order_and_each_once():
    found = named(["gravity_tilt", "air_lift", "gravity_tilt"], LIBRARY, "--with-effect")
    assert [e.name for e in found] == ["gravity_tilt", "air_lift"]
    assert found[1] is LIBRARY["air_lift"]


def test_every_unknown_name_is_told_with_the_nearest():
    with pytest.raises(BadInput) as refused:
        named(["air_lfit", "air_lift", "qqq"], LIBRARY, "--with-effect")
    told = [str(f) for f in refused.value.faults]
    assert told == [
        "--with-effect: there is no effect 'air_lfit'. Did you mean 'air_lift'?",
        "--with-effect: there is no effect 'qqq'. See `physavatar effects`.",
    ]
