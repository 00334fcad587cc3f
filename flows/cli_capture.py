"""`physavatar capture`: look at a recording before submitting it, and calibrate one that has no calibration."""

import json
import sys
from pathlib import Path

from cyclopts import App

app = App(name="capture", help="Recordings: check, calibrate.")


@app.command
def check(folder: Path, *, scale: str | None = None, deep: bool = False) -> int:
    """Check an ActorsHQ folder as a whole and report every fault; --deep decodes every picture."""
    from tasks.capture.actorshq import read_actorshq

    recording = read_actorshq(folder, scale=scale, deep=deep)
    found = {"cameras": len(recording.cameras), "frames": len(recording.frames), "fps": recording.fps, "warnings": recording.warnings}
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    return 0


