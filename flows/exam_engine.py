"""Another engine for the exam: MuJoCo in an environment of its own, which is made on first use and started once per run of a cloth.

The project does not depend on it, and it not on the project: numbers go to and fro as NPZ files.
"""

import fcntl
import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from flows.endings import Refused

PINNED = ("mujoco-core==4.0.0", "numpy==2.4.6")
SCRIPT = Path(__file__).parents[1] / "tasks" / "exam" / "engines" / "mujoco_flex.py"
LIMIT_S = 3600  # wall-clock seconds of one run of a cloth
LOST = 3  # exit code of the script where the cloth got lost


def environment() -> Path:
    """Where MuJoCo is installed, or would be."""
    cache = Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser()
    return cache / "engines" / "-".join(PINNED).replace("==", "-")


def ready() -> bool:
    """Whether the environment is there: its mark is written last."""
    return (environment() / "complete").exists()


def prepare(say: Callable[[str], None] = lambda line: None) -> None:
    """Make the environment if it is not there. Raises Refused, naming the commands that would."""
    place = environment()
    place.parent.mkdir(parents=True, exist_ok=True)
    with place.with_name(f"{place.name}.lock").open("w") as lock:  # several workers of a machine may come at once
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not ready():
            _install(place, say)


def _install(place: Path, say: Callable[[str], None]) -> None:
    say(f"installing {' '.join(PINNED)} in {place}")
    venv.create(place, with_pip=True, clear=True)
    command = [str(_python()), "-m", "pip", "install", "--disable-pip-version-check", "--quiet", *PINNED]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    if ended.returncode:
        wanted = f"{sys.executable} -m venv {place} && {' '.join(command)} && touch {place / 'complete'}"
        raise Refused(f"MuJoCo could not be installed: {ended.stderr.strip().splitlines()[-1]}\nWith a network: {wanted}")
    (place / "complete").touch()


def simulate(job: dict[str, Any], beside: dict[str, Any] | None = None) -> dict[str, Any]:
    """What `engines/mujoco_flex.py` makes of a job. Raises ArithmeticError where the cloth got lost."""
    with tempfile.TemporaryDirectory(prefix="physavatar-engine-") as place:
        files = [Path(place) / name for name in ("job.npz", "out.npz", "beside.npz")][: 2 if beside is None else 3]
        np.savez(files[0], **job)
        if beside is not None:
            np.savez(files[2], **beside)
        command = [_python(), "-I", SCRIPT, *files]  # there, because MuJoCo leaves a log where it runs
        ended = subprocess.run(command, cwd=place, capture_output=True, text=True, timeout=LIMIT_S, check=False)
        if ended.returncode == LOST:
            raise ArithmeticError(ended.stderr.strip())
        if ended.returncode:
            raise RuntimeError(f"MuJoCo ended with exit code {ended.returncode}: {ended.stderr}")
        return dict(np.load(files[1], allow_pickle=False))


def _python() -> Path:
    return environment() / "bin" / "python"
