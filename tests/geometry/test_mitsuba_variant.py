"""Mitsuba is one module with one variant per process, and Dr.Jit wants an LLVM that it knows."""

import pytest

from tasks.geometry.mitsuba_variant import find_llvm, load_mitsuba


def test_who_asks_for_no_variant_keeps_the_one_that_is_set() -> None:
    """A ray tracer made beside a path tracer on another variant must not take that one's scene away."""
    try:
        assert load_mitsuba("scalar_rgb").variant() == "scalar_rgb"
        assert load_mitsuba().variant() == "scalar_rgb"
    finally:
        assert load_mitsuba("llvm_ad_rgb").variant() == "llvm_ad_rgb"


def test_llvm_of_a_usable_version_is_preferred_and_absence_names_the_package(tmp_path) -> None:
    for name in ("libLLVM-14.so.1", "libLLVM-15.so.1", "libLLVM.so.19.1", "libLLVM-22.so"):
        (tmp_path / name).touch()
    assert find_llvm((str(tmp_path),)).name in {"libLLVM.so.19.1", "libLLVM-19.so"}


def test_without_llvm_the_package_is_named(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("pathlib.Path.glob", lambda self, pattern: iter([tmp_path / "libLLVM-14.so.1"]))
    with pytest.raises(RuntimeError, match=r"only version 14\). Install it with: sudo apt-get install libllvm19"):
        find_llvm((str(tmp_path),))
