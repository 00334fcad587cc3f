"""An examined process: a command that runs apart, without the user's settings, and what its end means.

A process that fails has answered wrongly. One that cannot start, or that somebody ends, has not been asked. What cannot start for one case
starts for none: there the exam stops.
"""

import os
import signal
import subprocess
from pathlib import Path

from flows.endings import CANCELLED
from flows.exam_candidate import UNSTARTED

ROOT = Path(__file__).parents[1]
LIMIT_S = 7200  # wall-clock seconds, on a machine that may do other things
UNASKED = {  # by exit code
    UNSTARTED: "could not be started",
    CANCELLED: "was cancelled",
    -signal.SIGTERM: "was ended from outside",
    -signal.SIGKILL: "was killed",  # by somebody, by a container that stops, or where memory runs short
}


class Unstarted(RuntimeError):
    """What would answer cannot be imported; the text holds why."""


def run_apart(command: list[str], place: Path) -> tuple[str, str, int]:
    """stdout, stderr and exit code of a command run in `place`; 5 when it takes too long.

    Raises RuntimeError where nobody was asked, Unstarted where nobody can be.
    """
    known = {
        "PATH",
        "HOME",
        "PHYSAVATAR_CACHE",
        "LANG",
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "NUMBA_CACHE_DIR",
        "VIRTUAL_ENV",
    }
    environment = {k: v for k, v in os.environ.items() if k in known} | {"PYTHONPATH": str(ROOT)}
    try:
        ended = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return "", f"no answer within {LIMIT_S} s", 5
    if ended.returncode in UNASKED:
        ending = Unstarted if ended.returncode == UNSTARTED else RuntimeError
        raise ending(f"{' '.join(command)}: it {UNASKED[ended.returncode]}, and has not answered: {ended.stderr}")
    return ended.stdout, ended.stderr, ended.returncode
