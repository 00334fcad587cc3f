"""What Prefect costs per stage when the flow runs in the process that asks for it."""

import tempfile
import time
from pathlib import Path

from prefect import flow

from flows.actor import use_local_prefect
from flows.request import run_stage
from flows.runs import RunRecord
from flows.service.server import adopt
from storage_schemas.store import Store
from tests.service import tiny


def overhead_alone(sequences: int) -> float:
    """Seconds per stage beyond the stage's own, over this many sequences of the tiny line; the start of the ephemeral server not counted."""
    with tempfile.TemporaryDirectory(prefix="physavatar-alone-", ignore_cleanup_errors=True) as place:
        root = Path(place)
        store = Store(root / "store")
        use_local_prefect(store.root)
        adopt({})
        requests = []
        for n in range(sequences + 1):
            recording = tiny.recording(root / "data", "ann", f"take{n}")
            settings = {"store": str(store.root), "data": str(root / "data"), "capture": {"recording": str(recording)}}
            requests.append(tiny.SERVICE.open("ann", f"take{n}", "cloth", settings)[0])

        @flow(name="alone")
        def alone() -> float:
            beyond = []
            for request in requests:
                record = RunRecord(store.root, request.actor, request.sequence)
                start = time.perf_counter()
                request.line.walk("cloth", lambda stage, inputs, done, r=request, k=record: run_stage(r, store, k, stage, inputs, done))
                own = sum(entry["seconds"] for entry in record.stages.values())
                beyond.append((time.perf_counter() - start - own) / len(record.stages))
            return sum(beyond[1:]) / sequences  # the first one warms up

        return alone()
