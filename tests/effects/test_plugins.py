"""Effects of a folder that the user names: they serve as the library's own do, in other processes too."""

import pickle
import sys
from operator import attrgetter

import pytest

from tasks.child_process import Pool
from tasks.effects.library import library
from tasks.geometry.faults import BadInput

MAGNET = """
from tasks.effects.effect import Effect, Strength


class Magnet(Effect):
    name = "contact_magnet"
    kind = "potential"
    strengths = (Strength("B", "T", 0.1, 0.0, 1.0),)
    field = 0.1


EFFECT = Magnet()
"""
WITH_A_DATACLASS = """
from __future__ import annotations
from dataclasses import dataclass


@dataclass
class Field:
    tesla: float
"""


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "my effects"
    folder.mkdir()
    (folder / "magnet.py").write_text(MAGNET)
    return folder


def test_a_worker_process_has_it_though_its_file_is_edited_meanwhile(folder):
    magnet = library(folder)["contact_magnet"]
    (folder / "magnet.py").write_text(MAGNET.replace("field = 0.1", "field = 0.2"))
    with Pool(limit_s=60, at_once=1) as pool:
        assert pool.map(attrgetter("name", "field"), [magnet, magnet]) == [("contact_magnet", 0.1)] * 2
    assert library(folder)["contact_magnet"].field == 0.2


def test_it_is_made_once_however_often_it_is_sent(folder):
    sent = pickle.dumps(library(folder)["contact_magnet"])
    assert pickle.loads(sent) is pickle.loads(sent)


def test_it_may_have_dataclasses_whose_annotations_are_text(folder):
    (folder / "magnet.py").write_text(WITH_A_DATACLASS + MAGNET)
    assert library(folder)["contact_magnet"].field == 0.1


def test_a_file_that_fails_leaves_no_module(folder):
    (folder / "broken.py").write_text("EFFECT = 1 / 0")
    with pytest.raises(BadInput, match=r"broken.py: it cannot be imported: ZeroDivisionError"):
        library(folder)
    assert "effect_broken" not in sys.modules
