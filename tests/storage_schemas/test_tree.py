"""Files below a folder, as a plan and a digest see them."""

import hashlib
import os

import pytest

from storage_schemas import tree
from storage_schemas.tree import files_below, sha256_of, size_of, stats


def names(folder) -> list[str]:
    return [within for within, _ in files_below(folder)]


@pytest.fixture
def folder(tmp_path):
    for name in ("b/1", "b/c/2", "b.txt", "a"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    return tmp_path


def test_files_come_in_the_order_of_their_parts_like_sorted_paths(folder):
    assert names(folder) == ["a", "b/1", "b/c/2", "b.txt"]
    assert names(folder) == [p.relative_to(folder).as_posix() for p in sorted(folder.rglob("*")) if p.is_file()]


def test_a_link_to_a_file_counts_and_one_to_a_folder_is_not_followed(folder):
    (folder / "loop").symlink_to(folder)
    (folder / "broken").symlink_to(folder / "nowhere")
    (folder / "file").symlink_to(folder / "a")
    assert names(folder) == ["a", "b/1", "b/c/2", "b.txt", "file"]


def test_a_folder_that_goes_while_it_is_listed_has_no_files(folder, monkeypatch):
    def gone(path):
        if str(path).endswith("c"):
            raise FileNotFoundError(path)
        return os_scandir(path)

    os_scandir = os.scandir
    monkeypatch.setattr(tree.os, "scandir", gone)
    assert names(folder) == ["a", "b/1", "b.txt"]
    assert names(folder / "never") == []


def test_what_vanishes_between_the_listing_and_the_look_is_passed_over(folder, monkeypatch):
    def gone(path):
        if str(path).endswith("c/2"):
            raise FileNotFoundError(path)
        return os_stat(path)

    os_stat = os.stat
    monkeypatch.setattr(tree.os, "stat", gone)
    assert size_of(folder) == len("b/1") + len("b.txt") + len("a")
    assert [os.path.relpath(name, folder) for name, _ in stats(folder)] == [".", "a", "b", "b/1", "b/c", "b.txt"]
    assert size_of(folder / "b/c") == size_of(folder / "never") == 0
    assert size_of(folder / "b.txt") == 5


def test_the_digest_is_that_of_the_content(folder):
    assert sha256_of(folder / "a") == sha256_of(str(folder / "a")) == hashlib.sha256(b"a").hexdigest()
