"""What the refit begins from; what computing otherwise changes is told about the states themselves, wherever derivatives are then taken."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.cloth import likeliest_errors, shooting
from tasks.cloth.numerics import MESH, offsets
from tasks.cloth.shooting import Job, follow
from tasks.cloth.start_state import States
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Prediction, Window
from tasks.effects.library import library
from tasks.gap import screening
from tasks.gap.diagnosis import diagnose
from tasks.gap.screening import ROUGH, _otherwise, roughly_refitted
from tests.cloth.test_windows import FABRIC, swung
from tests.gap.test_gathered import data

LIBRARY = library()


@pytest.mark.parametrize("followed_from", [{}, {"x 0 x": 2e-3, "v 1 z": 0.1}])
def test_a_start_that_was_moved_has_no_part_in_what_another_mesh_does(followed_from):
    model, recording, x, v = swung(12)
    φ = smooth_modes(model.subject.cloth, 6)
    off = States(x + 1e-3 * φ[0][:, None], v, "converged")
    job = Job(model, recording, Window(0, 4, 4), off, φ)
    start, changed = _otherwise((job, follow(replace(job, start=followed_from))))
    assert start and max(map(abs, start.values())) > 1e-5
    expected = offsets(job, follow(job).prediction.x, (MESH,))
    np.testing.assert_array_equal(changed[MESH.name], expected[MESH.name])
    assert np.abs(changed[MESH.name]).max() > 1e-6


@pytest.mark.parametrize("searched", [False, True])
def test_long_windows_begin_with_the_nearest_of_fabrics_far_apart(monkeypatch, searched):
    """In a few of the longest windows, once: of what short ones led to, and of fabrics about the one that was given."""
    model, *_ = swung(2)
    short, nearest = (replace(FABRIC, bending=b) for b in (7.0, 11.0))
    begun, asked = [], []

    def refitted(jobs, **_):
        begun.append(jobs[0].model.subject.fabric)
        return SimpleNamespace(model=replace(model, subject=replace(model.subject, fabric=short)), prior=None)

    def chosen(jobs, first, *, noise, run):
        asked.append((len(jobs), max(job.window.length for job in jobs), jobs[0].model.subject.fabric, first))
        return nearest

    monkeypatch.setattr(screening, "refit", refitted)
    monkeypatch.setattr(screening.nearest_fabric, "searched", chosen)
    monkeypatch.setattr(screening, "estimated_correlation", lambda *_: SimpleNamespace(share=0.0, length=0.1, memory=0.0))
    each = [data(200, length_s=s) for s in (0.2, 0.33)]
    roughly_refitted(model, each, searched=searched)
    assert begun == [FABRIC, nearest if searched else short]
    assert len(asked) == searched
    for windows, length, own, first in asked:
        assert windows <= ROUGH + 1 and length == max(w.length for w in each[1].windows)
        assert (own, first) == (short, FABRIC)


def test_where_no_window_can_be_followed_shorter_ones_are_asked_and_then_it_is_said(monkeypatch):
    """A motion that is blocked everywhere had ended the diagnosis with an error of indices."""
    model, recording, *_ = swung(46, noise=1e-3)
    for module in (shooting, screening, likeliest_errors):
        monkeypatch.setattr(
            module, "predict", lambda model, recording, w, s, **_: Prediction(w, s.x[w.start : w.start + 1], {}, "blocked", 0)
        )
    told = []
    found = diagnose(model, [recording], [LIBRARY["air_normal_drag"]], quick=True, tell=told.append).verdict
    assert [text for text in told if "windows of" in text] == ["8 windows of 0.19 s", "9 windows of 0.18 s"]
    assert found.kind == "not_testable" and found.reason == "the simulation can follow only 0 windows of the recording"


def test_where_recordings_held_out_cannot_be_had_no_claim_is_made():
    model, recording, *_ = swung(46, noise=1e-3)
    found = diagnose(model, [recording], [LIBRARY["air_normal_drag"]], quick=True, held_out=list)
    assert found.verdict.kind in ("effect", "none", "outside_library") and not found.shrinkage.held_out
