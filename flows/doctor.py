"""What this machine needs and whether it has it."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from flows.service import doctor as service

DISK_GB = 5.0


@dataclass(frozen=True)
class Finding:
    """One check: what was looked at, whether it is in order, what was found, and the remedy."""

    check: str
    ok: bool
    found: str
    remedy: str = ""


def examine(settings: Any) -> list[Finding]:
    """All checks, in the order in which to mend them."""
    return [
        *_guarded("python packages", _packages, "make setup"),
        *_guarded("LLVM for Mitsuba", _llvm, "apt-get install libllvm19"),
        *_guarded("sparse Cholesky", _cholmod, "apt-get install libsuitesparse-dev gcc; make setup"),
        *_guarded("model files", lambda: _models(settings), "set body.model and keypoints.model to files that exist"),
        *_guarded("store", lambda: _store(settings.store), "make the store folder writable, or set `store`"),
        *_guarded("disk", lambda: _disk(_local(settings.store)), "free space: physavatar artifacts gc"),
        *_guarded("clock", _clock, "set the system clock (leases and schedules rest on it)"),
        *(finding for name, look, remedy in service.checks(settings.service) for finding in _guarded(name, look, remedy)),
    ]


def _guarded(name: str, look: Callable[[], Iterator[str]], remedy: str) -> Iterator[Finding]:
    try:
        yield Finding(name, True, "; ".join(look()))
    except Exception as error:  # noqa: BLE001  a check that breaks is a finding
        yield Finding(name, False, f"{type(error).__name__}: {error}", remedy)


def _packages() -> Iterator[str]:
    for name in ("prefect", "zarr", "numba", "ipctk", "torch", "onnxruntime"):
        yield f"{name} {version(name)}"


def _llvm() -> Iterator[str]:
    from tasks.geometry.mitsuba_variant import load_mitsuba

    yield f"mitsuba {version('mitsuba')}, {load_mitsuba().variant()}"


def _cholmod() -> Iterator[str]:
    import scipy.sparse

    from tasks.geometry.cholmod_kernels import load_cholmod

    load_cholmod().cholesky(scipy.sparse.eye(3, format="csc"))
    yield f"scikit-sparse {version('scikit-sparse')}"


def _models(settings: Any) -> Iterator[str]:
    for stage, name in (("body", "model"), ("keypoints", "model")):
        path = getattr(getattr(settings, stage), name)
        if path is not None and not Path(path).is_file():
            raise FileNotFoundError(path)
        yield f"{stage}.{name} = {path or 'the demo body'}"


def _store(location: Path | str) -> Iterator[str]:
    from storage_schemas.object_store import open_store

    opened = open_store(location)
    probe = opened.root / f".doctor-{os.getpid()}"
    probe.write_text("")
    probe.unlink()
    opened.latest("doctor", "doctor", "capture")  # an object store must answer
    yield opened.location


def _local(location: Path | str) -> Path:
    return Path(location) if "://" not in str(location) else Path.home()


def _disk(root: Path) -> Iterator[str]:
    free = shutil.disk_usage(root if root.exists() else root.absolute().parent).free / 1e9
    if free < DISK_GB:
        raise OSError(f"{free:.1f} GB free, {DISK_GB:.0f} needed")
    yield f"{free:.0f} GB free"


def _clock() -> Iterator[str]:
    now = time.gmtime()
    if now.tm_year < 2024:
        raise ValueError(f"the clock says {time.strftime('%Y-%m-%d', now)}")
    yield time.strftime("%Y-%m-%d %H:%M UTC", now)
