"""The order of the stages: a diagnosis waits for no texture."""

from flows.pipeline import AVATAR


def walked(until: str) -> list[str]:
    names: list[str] = []
    AVATAR.walk(until, lambda stage, inputs, done: names.append(stage.name))
    return names


def test_the_stages_are_listed_in_the_order_in_which_they_run():
    assert walked("report") == list(AVATAR.stages)


def test_the_diagnosis_comes_before_the_appearance_which_needs_masks():
    assert "gap" in walked("appearance") and "appearance" not in walked("gap")
