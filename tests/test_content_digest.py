"""The digest of a folder is that of its content, remembered only while nothing has changed."""

import hashlib
import os
import shutil
import time

import pytest

from tasks import content_digest as module
from tasks.content_digest import content_digest

LONG_AGO = time.time() - 3600


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("PHYSAVATAR_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "recording"
    (folder / "a").mkdir(parents=True)
    for name in ("a/one.jpg", "two.csv"):
        (folder / name).write_bytes(name.encode())
        os.utime(folder / name, (LONG_AGO, LONG_AGO))
    return folder


def read(monkeypatch) -> list:
    """Every file whose content is read from now on."""
    seen, whole = [], module._digest
    monkeypatch.setattr(module, "_digest", lambda path: (seen.append(path), whole(path))[1])
    return seen


def slowly(folder) -> str:
    lines = [f"{n}\0{hashlib.sha256((folder / n).read_bytes()).hexdigest()}\n" for n in ("a/one.jpg", "two.csv")]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def test_it_is_read_once_while_nothing_changes(folder, monkeypatch):
    seen = read(monkeypatch)
    assert content_digest(folder) == content_digest(folder) == slowly(folder)
    assert seen.count(folder) == 1


@pytest.mark.parametrize("change", ["content", "name", "time"])
def test_any_change_is_read_again(folder, monkeypatch, change):
    before = content_digest(folder)
    if change == "content":
        (folder / "two.csv").write_bytes(b"twO.csv")  # the same size
    elif change == "name":
        (folder / "two.csv").rename(folder / "too.csv")
    else:
        os.utime(folder / "two.csv", (LONG_AGO + 1, LONG_AGO + 1))
    seen = read(monkeypatch)
    assert (content_digest(folder) == before) == (change == "time")
    assert folder in seen


def test_what_changed_just_now_is_not_remembered(folder, monkeypatch):
    os.utime(folder / "two.csv")
    content_digest(folder)
    seen = read(monkeypatch)
    content_digest(folder)
    assert folder in seen


@pytest.mark.parametrize("inside", ["", "a/"])
def test_a_folder_behind_a_link_counts_as_the_folder_itself(folder, tmp_path, inside):
    """A recording may keep its pictures on another disk."""
    whole = content_digest(folder)
    (folder / "a").rename(tmp_path / "disk")
    (folder / "a").symlink_to(tmp_path / "disk")
    (tmp_path / "other").mkdir()
    (folder / inside / "z").symlink_to(tmp_path / "other")
    assert content_digest(folder) == whole
    (tmp_path / "other/three.jpg").write_bytes(b"3")
    (tmp_path / "disk/one.jpg").write_bytes(b"a/onE.jpg")
    changed = content_digest(folder)
    (folder / "a").unlink(), shutil.copytree(tmp_path / "disk", folder / "a", symlinks=True)
    assert content_digest(folder) == changed != whole


def test_links_that_lead_back_add_nothing_and_end(folder, tmp_path):
    whole = content_digest(folder)
    (folder / "a/up").symlink_to(folder)
    (folder / "a/here").symlink_to(folder / "a")
    assert content_digest(folder) == whole
    (tmp_path / "one").mkdir(), (tmp_path / "two").mkdir()
    (tmp_path / "one/b").symlink_to(tmp_path / "two")
    (tmp_path / "two/c").symlink_to(tmp_path / "one")
    assert content_digest(tmp_path / "one") == hashlib.sha256().hexdigest()


def test_a_damaged_memory_or_a_read_only_home_costs_time_only(folder, tmp_path, monkeypatch):
    digest = content_digest(folder)
    memory = next((tmp_path / "cache").rglob("*.json"))
    memory.write_text("{")
    assert content_digest(folder) == digest
    monkeypatch.setenv("PHYSAVATAR_CACHE", "/proc/nowhere")
    assert content_digest(folder) == digest
