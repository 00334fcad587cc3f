"""The report of a diagnosis on files: written whole, one page without anything from outside, with the verdict and every figure."""

import json
import re

import numpy as np
import pytest

from flows import gap
from tasks.effects.library import library
from tasks.geometry.faults import BadInput
from tests.cloth.test_windows import swung
from tests.flows.test_gap import write

KEPT = ("air_normal_drag", "fabric_mass_damping", "gravity_tilt")
HEADINGS = (
    "Verdict",
    "Gap budget",
    "Where the gap lies",
    "When",
    "Frequencies and directions",
    "Evidence",
    "What this recording can tell apart",
)


@pytest.fixture(scope="module")
def track(tmp_path_factory):
    model, recording, *_ = swung(31, noise=1e-3)
    rest = model.subject.cloth.x_rest
    path = tmp_path_factory.mktemp("report") / "track.npz"
    return write(path, model, recording, uv=rest[:, np.ptp(rest, axis=0) > 0]), recording.observed


def report(track, page):
    without = tuple(n for n in library() if n not in KEPT)
    told, _ = gap.run(gap.Request((track,), quick=True, without=without, report=page))
    return told, page.read_text(), json.loads(page.with_suffix(".json").read_text())


@pytest.fixture(scope="module")
def reported(track):
    return report(track[0], track[0].with_name("page.html"))


def test_a_recording_too_short_to_test_has_a_page_that_says_so(track, tmp_path):
    path, x = track
    np.savez(tmp_path / "short.npz", **{**np.load(path), "vertices": x[:12]})
    told, html, whole = report(tmp_path / "short.npz", tmp_path / "page.html")
    assert told["verdict"]["kind"] == "not_testable" and told["verdict"]["sentence"] in html
    assert "<figure>" not in html and whole["evidence"]["budget"] == []


def test_the_page_holds_the_verdict_and_the_next_recording(reported):
    told, html, _ = reported
    assert told["verdict"]["sentence"] in html
    assert told["record_next"][1:] in html


def test_the_page_needs_nothing_from_outside(reported):
    _, html, _ = reported
    assert "http" not in html and "<script" not in html
    assert all(uri.startswith("data:image/") for uri in re.findall(r'src="([^"]*)"', html))


def test_every_section_has_its_figure(reported):
    _, html, _ = reported
    for heading in HEADINGS:
        assert f"<h2>{heading}</h2>" in html
    assert html.count("<figure>") >= len(HEADINGS) - 1


def test_the_json_is_the_answer_and_its_evidence(reported):
    told, _, whole = reported
    evidence = whole.pop("evidence")
    assert whole == told
    assert {"budget", "splits_mm", "compared_windows", "evidence", "confusability", "constancy", "spectra"} <= set(evidence)
    assert set(evidence["confusability"]["names"]) == set(KEPT)
    assert sum(item["misfit"] for item in evidence["budget"]) == pytest.approx(evidence["base_refit"]["history"][0]["misfit"])
    assert set(evidence["splits_mm"][0]["before"]) == {"all", "normal", "weft", "warp"}
    parts = [evidence["splits_mm"][0]["before"][d] for d in ("normal", "weft", "warp")]
    assert np.sqrt(np.sum(np.square(parts))) == pytest.approx(evidence["splits_mm"][0]["before"]["all"])


@pytest.mark.parametrize("name", ["page.pdf", "nowhere/page.html"])
def test_a_page_that_cannot_be_written_is_refused_at_once(tmp_path, name):
    (tmp_path / "track.npz").touch()
    with pytest.raises(BadInput, match="--report"):
        gap.run(gap.Request((tmp_path / "track.npz",), report=tmp_path / name))
