"""The scorer on answers written by hand."""

import numpy as np
import pytest
from rich.console import Console

from flows import cli_exam
from tasks.exam.scorer.beside import columns
from tasks.exam.scorer.case import area_under_curve, closing, credit, credits, most_changed, score
from tasks.exam.scorer.demo import demo_scores
from tasks.exam.scorer.engine import counted, heading
from tasks.exam.scorer.intervals import bootstrap, wilson
from tasks.exam.scorer.listing import HEAD, confusions, listing
from tasks.exam.scorer.page import page
from tasks.exam.scorer.summary import calibration_error, confusion, summary

OWN = {
    "split": "open",
    "version": "0123456789abcdef",
    "left_out": [],
    "engine": "own",
    "null_residual_mm": None,
    "too_small": [],
    "apart": {},
}


def truth(causes: dict[str, float], *, stratum: str = "single", withheld: tuple[str, ...] = (), multiple: float = 4.0) -> dict:
    return {
        "question": {"number": 3, "stratum": stratum, "twist": "", "withheld": withheld},
        "causes": {n: {"strength": θ, "unit": "m2/kg"} for n, θ in causes.items()},
        "admissible": {n: [n, "air_linear_drag"] for n in causes},
        "multiple": multiple,
        "local": True,
        "acceleration": list(range(10)),
    }


def answer(kind: str, classes: list[list[str]], ranking: list[tuple[list[str], float]], **where) -> dict:
    return {
        "version": 1,
        "verdict": {"kind": kind, "effects": [c[0] for c in classes], "class": classes, "probability": ranking[0][1]},
        "ranking": [
            {"class": c, "probability": p, "strength": {n: {"value": 9.0, "unit": "m2/kg", "low": 8, "high": 12} for n in c}}
            for c, p in ranking
        ],
        "answer_set_90": [n for c, p in ranking for n in c if p > 0.05],
        "where": where,
        "seconds": 20.0,
    }


DRAG, LINEAR, HEM = "air_normal_drag", "air_linear_drag", "fabric_hem_mass"


def test_credit_is_divided_by_names_outside_the_admissible_class():
    assert credit([DRAG], DRAG, [DRAG]) == 1
    assert credit([DRAG, LINEAR], DRAG, [DRAG, LINEAR]) == 1
    assert credit([DRAG, HEM], DRAG, [DRAG, LINEAR]) == 1 / 2
    assert credit([DRAG, HEM, "body_lag", LINEAR], DRAG, [DRAG, LINEAR]) == 1 / 3
    assert credit([DRAG, LINEAR, HEM, "body_lag", "air_lift"], DRAG, [DRAG, LINEAR]) == 0  # five names
    assert credit([LINEAR], DRAG, [DRAG, LINEAR]) == 0  # admissible, but not the truth


def test_a_right_name_scores():
    row = score(truth({DRAG: 10.0}), answer("effect", [[DRAG, LINEAR]], [([DRAG, LINEAR], 0.9), (["none"], 0.1)]))
    assert (row["credit"], row["top1"], row["top3"], row["right"], row["covered"]) == (1, 1, 1, True, True)
    assert row["probability_of_truth"] == pytest.approx(0.9)
    assert row["strength_error"] == pytest.approx(0.1) and row["strength_covered"]


def test_a_second_place_counts_for_top3_only():
    row = score(truth({DRAG: 10.0}), answer("effect", [[HEM]], [([HEM], 0.6), ([DRAG], 0.3), (["none"], 0.1)]))
    assert (row["credit"], row["top1"], row["top3"], row["right"]) == (0, 0, 1, False)


def test_an_answer_set_may_hold_the_truth_alone_and_three_places_are_three():
    told = answer("effect", [[DRAG]], [([DRAG], 1.0)])
    assert told["answer_set_90"] == [DRAG] and score(truth({DRAG: 10.0}), told)["covered"]
    fourth = answer("effect", [[HEM]], [([HEM], 0.4), (["body_lag"], 0.3), (["air_lift"], 0.2), ([DRAG], 0.1)])
    assert score(truth({DRAG: 10.0}), fourth)["top3"] == 0
    for asked in (truth({}, stratum="null"), truth({DRAG: 1.0}, stratum="outside", withheld=(DRAG,))):
        right, wrong = ("none", "outside_library") if not asked["causes"] else ("outside_library", "none")
        last = [([wrong], 0.5), ([HEM], 0.2), (["body_lag"], 0.2), ([right], 0.1)]
        assert [score(asked, answer(wrong, [], last))[k] for k in ("top1", "top3")] == [0, 0]
        first = [([right], 0.9), ([wrong], 0.1)]
        assert [score(asked, answer(right, [], first))[k] for k in ("top1", "top3")] == [1, 1]


def test_what_is_named_is_in_the_classes_or_among_the_effects():
    told = answer("effect", [[DRAG, LINEAR]], [([DRAG, LINEAR], 1.0)])
    told["verdict"]["effects"] = [HEM]
    assert score(truth({DRAG: 10.0}), told)["named"] == sorted([DRAG, LINEAR, HEM])


def test_an_interval_holds_its_ends():
    told = answer("effect", [[DRAG]], [([DRAG], 1.0)])  # 8 to 12
    assert [score(truth({DRAG: θ}), told)["strength_covered"] for θ in (7.9, 8.0, 12.0, 12.1)] == [False, True, True, False]


def test_a_pair_needs_both_names():
    both = truth({DRAG: 10.0, HEM: 1.0}, stratum="pair")
    row = score(both, answer("effect", [[DRAG], [HEM]], [([DRAG], 0.6), ([HEM], 0.3), (["none"], 0.1)]))
    assert (row["found"], row["right"], row["credit"]) == (2, True, 1.0)
    row = score(both, answer("effect", [[DRAG]], [([DRAG], 0.6), (["none"], 0.4)]))
    assert (row["found"], row["right"], row["credit"]) == (1, False, 0.5)
    row = score(both, answer("effect", [[DRAG, LINEAR], [HEM], ["body_lag"]], [([DRAG, HEM], 0.6), (["none"], 0.4)]))
    assert (row["found"], row["right"], row["credit"]) == (2, False, 0.5)


def test_names_in_any_class_of_the_verdict_count_against_a_single_cause():
    """Otherwise a wrong name would be free as soon as it stood in a class of its own."""
    split = score(truth({DRAG: 10.0}), answer("effect", [[DRAG], [HEM]], [([DRAG, HEM], 0.8), (["none"], 0.2)]))
    assert split["credit"] == split["top1"] == 1 / 2 and not split["right"]
    assert split["probability_of_truth"] == pytest.approx(0.4)
    many = [[DRAG], [HEM], ["body_lag"], ["air_lift"], ["air_wind"]]
    assert score(truth({DRAG: 10.0}), answer("effect", many, [([DRAG], 0.8)]))["credit"] == 0


def test_of_a_pair_each_name_is_judged_without_what_may_stand_for_the_other():
    both = truth({DRAG: 10.0, HEM: 1.0}, stratum="pair")
    assert credits([DRAG, LINEAR, HEM], both) == [1, 1]
    assert credits([DRAG, "body_lag"], both) == [1 / 2, 0]
    assert credits([DRAG, HEM, "body_lag"], both) == [1 / 2, 1 / 2]


def test_a_decoy_changes_nothing_about_what_is_right():
    row = score(truth({DRAG: 10.0}, withheld=(HEM,)), answer("effect", [[DRAG]], [([DRAG], 0.9), (["none"], 0.1)]))
    assert row["expected"] == "effect" and row["right"] and row["withheld"] == []


def test_a_strength_among_several_is_compared_by_its_own_symbol():
    """A slip of u m/s is no length of (u, q), and a curvature has a sign."""
    told = answer("effect", [[DRAG]], [([DRAG], 1.0)])
    own = {"value": -10.0, "unit": "m2/kg", "low": -12.0, "high": -9.0}
    told["ranking"][0]["strength"][DRAG] |= {"components": {"κ₀": own, "Δκ": own | {"value": 3.0}}}
    asked = truth({DRAG: -10.0})
    asked["causes"][DRAG]["along"] = "κ₀"
    assert score(asked, told)["strength_error"] == 0 and score(asked, told)["strength_covered"]
    asked["causes"][DRAG]["along"] = None
    assert score(asked, told)["strength_error"] == pytest.approx(1.9)


def test_nulls_and_unknown_causes():
    none = answer("none", [], [(["none"], 0.8), ([DRAG], 0.2)])
    outside = answer("outside_library", [], [(["outside_library"], 0.7), ([DRAG], 0.3)])
    assert score(truth({}, stratum="null"), none)["right"]
    withheld = score(truth({DRAG: 1.0}, stratum="outside", withheld=(DRAG,)), outside)
    assert withheld["expected"] == "outside_library" and withheld["right"] and withheld["covered"]
    assert not score(truth({DRAG: 1.0}, stratum="outside", withheld=(DRAG,)), none)["right"]


def test_no_answer_is_wrong_everywhere():
    row = score(truth({DRAG: 1.0}), None)
    assert (row["credit"], row["top1"], row["probability_of_truth"], row["failed"], row["covered"]) == (0, 0, 0, True, False)


def test_localisation_is_the_share_of_pairs_in_order():
    value, positive = np.array([0.1, 0.4, np.nan, 0.4, 0.9]), np.array([False, True, False, False, True])
    brute = np.mean([1.0 if a > b or np.isnan(b) else 0.5 if a == b else 0.0 for a in value[positive] for b in value[~positive]])
    assert area_under_curve(value, positive) == pytest.approx(brute)
    row = score(truth({DRAG: 1.0}), answer("effect", [[DRAG]], [([DRAG], 1.0)], vertex_accel=[0.0] * 8 + [1.0, 2.0]))
    assert row["auc"] == 1
    nowhere = truth({DRAG: 1.0}) | {"acceleration": [0.0] * 10}
    assert "auc" not in score(nowhere, answer("effect", [[DRAG]], [([DRAG], 1.0)], vertex_accel=[0.0] * 8 + [1.0, 2.0]))


def test_of_causes_that_cannot_be_named_the_row_tells_the_place_and_the_figure_does_not():
    said = answer("outside_library", [], [(["outside_library"], 0.9)], vertex_accel=[0.0] * 8 + [1.0, 2.0])
    row = score(truth({DRAG: 1.0}, stratum="outside", withheld=(DRAG,)), said)
    assert row["auc"] == 1
    assert next(f for f in summary([row]) if f["metric"] == "localisation, AUC")["cases"] == 0


def test_vertices_that_nothing_happens_to_are_not_among_the_most_changed():
    assert most_changed(np.arange(10.0)).tolist() == [False] * 8 + [True] * 2
    assert most_changed(np.array([0.0] * 9 + [1.0])).tolist() == [False] * 9 + [True]


def test_closed_fraction_counts_seen_free_vertices_of_frames_that_were_hidden():
    T, V = 5, 4
    x = np.zeros((T, V, 3))
    held_out = {"vertices": x, "observed": np.ones((T, V), bool), "boundary": np.array([0])}
    held_out["observed"][3, 2] = False
    before, after = np.full((T, V, 3), 99.0), np.full((T, V, 3), 99.0)
    before[2:, 1:], after[2:, 1:] = [0.03, 0, 0], [0.01, 0, 0]
    before[3, 2] = after[3, 2] = np.nan
    row = closing({"before": before, "after": after}, held_out, 0.01)
    assert row["before_mm"] == pytest.approx(30) and row["after_mm"] == pytest.approx(10)
    assert row["closed"] == pytest.approx((9 - 1) / (9 - 1)) and not row["worse"]
    assert "closed" not in closing({"before": before, "after": after}, held_out, 0.0201)
    assert "closed" in closing({"before": before, "after": after}, held_out, 0.0199)  # from 1.5 floors on
    up = np.array([0.0, 1.0, 0.0])
    elsewhere = closing({"before": before + up, "after": after + up}, held_out | {"vertices": x + up}, 0.01)
    assert elsewhere == pytest.approx(row)
    assert closing({"before": after, "after": before}, held_out, 0.001)["worse"]
    nothing = {"before": after, "after": after}  # was carried over, though another's gap is to be closed
    assert "worse" not in closing(nothing, held_out, 0.001) and "worse" not in closing(nothing, held_out, 0.001, before_mm=5.0)
    assert closing({"before": before, "after": after}, held_out, 0.001, before_mm=5.0)["worse"]
    assert not closing({"before": before, "after": after}, held_out, 0.001, before_mm=10.0)["worse"]


def test_wilson_against_the_textbook():
    """Newcombe 1998, table I: 81 of 263 gives 0.2553 … 0.3662; and by Wilson's quadratic (p − q)² = z² q (1 − q)/n itself."""
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    for q in wilson(3, 7):
        assert (3 / 7 - q) ** 2 == pytest.approx(1.959964**2 * q * (1 - q) / 7)
    assert wilson(0, 32) == pytest.approx((0.0, 0.107), abs=1e-3)
    assert wilson(0, 5)[0] == 0.0 and wilson(5, 5)[1] == 1.0


def test_bootstrap_of_a_mean_has_the_width_of_the_normal():
    values = np.random.default_rng(0).normal(size=400)
    low, high = bootstrap(values)
    assert high - low == pytest.approx(2 * 1.96 * values.std() / 20, rel=0.05)


def test_calibration_error_of_ten_answers():
    rows = [{"confidence": 0.95, "right": k < 6} for k in range(10)]
    found = calibration_error(rows)
    half = 1.96 * np.sqrt(0.6 * 0.4 / 10)
    assert found["value"] == pytest.approx(0.35) and [found["low"], found["high"]] == pytest.approx([0.35 - half, 0.35 + half], abs=0.06)
    sure = [{"confidence": 1.0, "right": False}] * 2  # the last bin holds its end
    assert calibration_error([*rows, *sure])["value"] == pytest.approx(abs(12 * 0.95 + 0.1 - 6) / 12)


def test_who_is_asked_for_what():
    """Every stratum once seen and once too small, by an answer that is right in one place and wrong in the other."""
    both = answer("effect", [[DRAG], [HEM]], [([DRAG], 0.6), ([HEM], 0.4)])
    one = answer("effect", [[DRAG]], [([DRAG], 0.9), (["none"], 0.1)])
    no = answer("none", [], [(["none"], 1.0)])
    pair, single = {DRAG: 10.0, HEM: 1.0}, {DRAG: 10.0}
    rows = [
        score(truth(pair, stratum="pair", multiple=2.0), both),
        score(truth(pair, stratum="pair"), one),
        score(truth(pair, stratum="pair"), no),
        score(truth(pair, stratum="pair", multiple=1.9), no),
        score(truth(single, multiple=2.0), one),
        score(truth(single, multiple=1.9), no),
        score(truth(single, stratum="inseparable", multiple=1.0), one),
        score(truth({}, stratum="inseparable"), no),
        score(truth({}, stratum="null"), answer("outside_library", [], [(["outside_library"], 1.0)])),
    ]
    figures = {f["metric"]: (f["value"], f["cases"]) for f in summary(rows)}
    assert figures["top-1, single effects from 2x the floor"] == (1.0, 1)
    assert figures["pairs: both named"] == (pytest.approx(1 / 3), 3)
    assert figures["pairs: at least one named"] == (pytest.approx(2 / 3), 3)
    assert figures["inseparable by design: class right"] == (1.0, 1)  # density alone asks for no name
    assert figures["false attribution on nulls"] == (0.0, 2)
    assert figures["abstentions that are outside the library (precision)"] == (0.0, 1)
    assert figures["90 % answer sets that hold the truth"] == (pytest.approx(3 / 6), 6)  # of what is seen, or is no effect
    assert figures["mean size of 90 % answer sets"] == (pytest.approx(9 / 6), 6)
    assert figures["calibration error"][1] == 6
    assert figures["top-1, single effects near 2x the floor"] == (0.5, 2)


def test_the_table_of_confusion_calls_everything_by_its_name():
    rows = [
        score(truth({DRAG: 10.0}), answer("effect", [[DRAG, LINEAR]], [([DRAG, LINEAR], 1.0)])),
        score(truth({DRAG: 10.0, HEM: 1.0}, stratum="pair"), answer("outside_library", [], [(["outside_library"], 1.0)])),
        score(truth({DRAG: 10.0}, stratum="outside", withheld=(DRAG,)), answer("effect", [[HEM]], [([HEM], 1.0)])),
        score(truth({}, stratum="null"), answer("none", [], [(["none"], 1.0)])),
    ]
    truths, answers, table = confusion(rows)
    met = {(truths[i], answers[j]) for i, j in zip(*np.nonzero(table), strict=True)}
    assert met == {
        (DRAG, f"{LINEAR} | {DRAG}"),
        (f"{DRAG} + {HEM}", "outside_library"),
        (f"withheld: {DRAG}", HEM),
        ("none", "none"),
    }
    assert table.sum() == 4
    lines = list(confusions([*rows, rows[3]]))
    assert len(lines) == 2 + 4 and "| none | 2 | none 2 |" in lines  # head, rule, and a line per truth
    assert f"| {DRAG} | 1 | {LINEAR} or {DRAG} 1 |".replace("_", " ") in lines


def test_summary_and_page_hold_every_case():
    rows = [
        score(truth({DRAG: 10.0}), answer("effect", [[DRAG]], [([DRAG], 0.9), (["none"], 0.1)])),
        score(truth({}, stratum="null"), answer("effect", [[HEM]], [([HEM], 0.9), (["none"], 0.1)])),
        score(truth({DRAG: 1.0}, multiple=1.0), None),
    ]
    figures = {f["metric"]: f for f in summary(rows)}
    assert figures["false attribution on nulls"]["value"] == 1
    assert figures["top-1, single effects from 2x the floor"]["cases"] == 1
    assert figures["top-1, single effects near 1x the floor"]["value"] == 0
    result = OWN | {"cases": 3, "figures": summary(rows), "rivals": {}, "rows": [row | {"seed": 0} for row in rows]}
    text = page(result)
    assert text.count("<tr>") >= len(figures) + len(rows) and HEM in text and "Rivals" not in text
    assert "version 0123456789ab" in text and "href" not in text and "– …" not in text


def test_the_page_leads_to_what_an_answer_rests_on():
    """Of a pool of two seeds only to the page of the case that lies beside it."""
    row = score(truth({}, stratum="null"), answer("none", [], [(["none"], 1.0)]))
    result = OWN | {"cases": 2, "figures": summary([row]), "rivals": {}, "rows": [row | {"seed": 0}, row | {"seed": 1}]}
    text = page(result, {(1, row["number"]): "answers/case-0003/report.html"})
    assert text.count("href='answers/case-0003/report.html'>3<") == text.count("href") == 1


def test_abstaining_is_no_answer_of_none_and_a_doubtful_wrong_name_is_no_confident_one():
    """Of five whose cause nobody has: one abstains, two say none, two name, one of them surely."""
    unknown = truth({"wind_gusts": 1.0}, stratum="outside")
    said = [
        answer("outside_library", [], [(["outside_library"], 0.9)]),
        *[answer("none", [], [(["none"], 0.9)])] * 2,
        answer("effect", [[DRAG]], [([DRAG], 0.9)]),
        answer("effect", [[DRAG]], [([DRAG], 0.6)]),
    ]
    figures = {f["metric"]: f for f in summary([score(unknown, a) for a in said])}
    abstains, wrong = figures["outside the library: abstains (recall)"], figures["outside the library: confident wrong name"]
    assert abstains["value"] == wrong["value"] == 0.2
    assert (abstains["low"], abstains["high"]) == wilson(1, 5)
    assert figures["abstentions that are outside the library (precision)"]["value"] == 1


def test_a_prediction_is_worse_from_a_twentieth_on():
    x = np.zeros((3, 2, 3))
    held_out = {"vertices": x, "observed": np.ones((3, 2), bool), "boundary": np.array([], int)}
    before = np.full_like(x, 0.01)
    for share, worse in ((1.04, False), (1.06, True)):
        row = closing({"before": before, "after": before * share**0.5}, held_out, 0.001)
        assert row["worse"] is worse


def test_the_listing_says_of_every_case_what_was_planted_and_what_was_answered():
    named = score(
        truth({"air_normal_drag": 10.0}, multiple=2.5),
        answer("effect", [["air_normal_drag"]], [(["air_normal_drag"], 0.9), (["none"], 0.1)]),
    )
    lacking = score(
        truth({"air_lift": 10.0}, stratum="outside", withheld=("air_lift",)),
        answer("none", [], [(["none"], 0.8), (["outside_library"], 0.2)]),
    )
    failed = score(truth({}, stratum="null"), None)
    head, rule, *lines = listing([lacking | {"number": 9}, named | {"closed": 0.755}, failed | {"number": 12}])
    assert head == "| " + " | ".join(HEAD) + " |" and {text.count("|") for text in (head, rule, *lines)} == {len(HEAD) + 1}
    assert lines[0] == "| 3 | air_normal_drag (2.5) | air_normal_drag, 0.90 | 1 | 0.90 | 2 | 0.76 | 20 |"
    assert lines[1] == "| 9 | air_lift, which the library lacks (4.0) | none, 0.80 | 0 | 0.20 | 2 |  | 20 |"
    assert lines[2] == "| 12 | nothing, null | no answer | 0 | 0.00 |  |  |  |"


def test_rivals_stand_beside_the_diagnosis_on_their_own_cases():
    ours = [score(truth({DRAG: 10.0}), answer("effect", [[DRAG]], [([DRAG], 0.9), (["none"], 0.1)])), score(truth({DRAG: 1.0}), None)]
    theirs = score(truth({DRAG: 10.0}), answer("effect", [[HEM]], [([HEM], 1.0), (["none"], 0.0)]))
    seeded = [row | {"seed": seed} for seed, row in enumerate(ours)]  # both are of number 3
    slow = {"cases": 1, "figures": summary([theirs]), "ours": summary(ours[:1]), "rows": [theirs | {"seed": 0}]}
    late = slow | {"ours": summary(ours[1:]), "rows": [theirs | {"seed": 1}]}  # as many cases, another one
    result = OWN | {"cases": 2, "figures": summary(ours), "rows": seeded}
    result["rivals"] = {"quick": {"cases": 2, "figures": summary(ours), "ours": summary(ours), "rows": seeded}, "slow": slow, "late": late}
    result["rivals"]["patient"] = slow
    beside = columns(result)
    own = ["diagnosis (2)", "diagnosis, the cases of slow (1)", "diagnosis, the cases of late (1)"]
    assert list(beside) == [own[0], "quick (2)", own[1], "slow (1)", own[2], "late (1)", "patient (1)"]
    metric = "top-1, single effects from 2x the floor"
    assert [values[metric] for values in beside.values()] == [0.5, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0]
    text = page(result)
    assert "slow (1)" in text and text.count("class='m'") == 5


def test_eight_who_answered_can_be_read_in_eighty_columns(monkeypatch, capsys):
    names = [f"somebody_with_a_name_{k} (160)" for k in range(8)]
    metric = "top-1, single effects from 2x the floor"
    monkeypatch.setattr(cli_exam, "OUT", Console(width=80))
    cli_exam._show_beside({name: {metric: 0.125} for name in names}, [metric])
    told = capsys.readouterr().out
    assert [f"{letter}  {name}" in told for letter, name in zip("ABCDEFGH", names, strict=True)] == [True] * 8
    assert told.count("0.125") == 8 and len(told.splitlines()) <= 8 + 4


def test_summary_of_nothing_is_empty_and_does_not_fail():
    assert all(f["value"] is None for f in summary([]))


def test_of_another_engine_count_nulls_and_what_is_twice_as_large_as_they_leave_over():
    def row(expected, magnitude=None, before=None):
        return {"expected": expected, "magnitude_mm": magnitude, "before_mm": before}

    rows = {n: row("none", before=left) for n, left in enumerate([2.0, 3.0, 10.0])}
    rows |= {10: row("effect", 5.9), 11: row("effect", 6.1), 12: row("outside_library", 7.0)}
    kept, residual = counted(rows)
    assert residual == 3.0 and set(kept) == {0, 1, 2, 11, 12}
    assert counted({10: rows[10]}) == ({}, None)
    shown = {"engine": "mujoco", "cases": 5, "null_residual_mm": 3.0, "too_small": [10]}
    assert heading(shown) == (
        "cases of the mujoco engine: 5 count; the refitted base misses its nulls by 3 mm; smaller than twice that, and not counted: [10]"
    )


def test_the_demo_is_told_whether_what_was_planted_is_named_and_how_much_it_is_believed():
    """It leads in a class of two and stands beside another; frames kept out withdraw it or not."""
    ranking = [
        {"class": ["air_normal_drag", "air_linear_drag"], "probability": 0.6},
        {"class": ["air_normal_drag", "air_added_mass"], "probability": 0.25},
        {"class": ["none"], "probability": 0.15},
    ]
    still = np.zeros((2, 55, 3)), np.zeros((2, 55, 3))
    given = {"joints": still, "keypoint_joints": still[0], "vertices": still, "garment": {}, "fabric": {}, "true_fabric": {}}
    for named in ([["air_normal_drag", "air_linear_drag"]], []):
        verdict = {"verdict": {"class": named}, "ranking": ranking}
        found = demo_scores(**given, psnr=np.array([np.nan]), planted="air_normal_drag", verdict=verdict)
        told = {name: row["value"] for name, row in found.items() if "air_" in name}
        assert told == {
            "planted air_normal_drag is in the class named": float(bool(named)),
            "probability given to air_normal_drag": pytest.approx(0.85),
        }


def test_the_demo_with_what_was_planted_in_its_model_is_told_how_strong_it_was_found():
    """What is left has another name or none, which says nothing of the planted effect."""
    still = np.zeros((2, 55, 3)), np.zeros((2, 55, 3))
    verdict = {"verdict": {"class": []}, "ranking": [{"class": ["none"], "probability": 1.0}]}
    fabric = {"skirt": {"kappa_s_over_rho": {"value": 0.02}, "air_normal_drag": {"value": 22.0}}}
    true = {"skirt": {"kappa_s_over_rho": 0.01, "air_normal_drag": 20.0}}
    given = {"joints": still, "keypoint_joints": still[0], "vertices": still, "garment": {}, "fabric": fabric, "true_fabric": true}
    found = demo_scores(**given, psnr=np.array([np.nan]), planted="air_normal_drag", verdict=verdict)
    told = {name: row["value"] for name, row in found.items() if "joint" not in name}
    assert told == {"skirt: kappa_s_over_rho, estimate/truth": 2.0, "skirt: air_normal_drag, estimate/truth": pytest.approx(1.1)}
