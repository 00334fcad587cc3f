"""Two small demo actors, made and handed to the service: something to look at in the UI within minutes of its first start."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from flows.config import load
from flows.dataset import Sequence
from flows.service.deployed import SERVICE
from flows.service.hand_over import hand_over
from storage_schemas.store import Store

ACTORS = {"dora": 1, "dana": 2}  # name → seed
SIZE: dict[str, Any] = {"cameras": 4, "frames": 8, "size": 224, "spp": 4}
SETTINGS = ("cloth.iterations=1", "appearance.texture_size=128", "cloth.frames=7")


def demonstrate(home: Path, tell: Callable[[str], None]) -> None:
    """Make the recordings where they are missing, then ask for both, before any batch."""
    from tasks.capture.demo.plan import Request
    from tasks.capture.demo.recording import make_demo_recording

    data, cache = home / "demo" / "data", Path(os.environ.get("PHYSAVATAR_CACHE", "~/.cache/physavatar")).expanduser()
    settings = load(SETTINGS, places={"store": home / "demo" / "store", "data": data})
    store = Store(settings.store)
    for actor, seed in ACTORS.items():
        tell(f"{actor}: making a recording of {SIZE['cameras']} cameras and {SIZE['frames']} frames")
        truth = data / f"{actor}.truth"
        make_demo_recording(data, truth, cache=cache, actor=actor, sequence="Sequence1", request=Request(**SIZE, seed=seed))
        at = Sequence(actor, "Sequence1", data / actor / "Sequence1")
        run = hand_over(SERVICE.request(at, settings, store), store, wait=False)
        tell(f"{actor}: handed over as run {run}")
