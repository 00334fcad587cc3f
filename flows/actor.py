"""One actor, now: the pipeline as a Prefect flow in this process."""

import os
from pathlib import Path
from typing import Any

from flows.line import present
from flows.orphans import end_orphaned_servers
from flows.request import Request, run_stage
from flows.runs import RunRecord
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from tasks.stage import Stage


def run_actor(request: Request, store: Store, record: RunRecord) -> dict[str, ArtifactRef]:
    """Run the pipeline as a Prefect flow in this process, on Prefect's own ephemeral API; returns the artifact of each stage."""
    use_local_prefect(store.root)
    end_orphaned_servers(Path(os.environ["PREFECT_HOME"]))
    from prefect import flow

    @flow(name="actor", flow_run_name=f"{request.actor} {request.sequence}", log_prints=False, validate_parameters=False)
    def actor(actor: str, sequence: str) -> dict[str, Any]:
        def bring(stage: Stage, inputs: dict[str, ArtifactRef | None], done: dict[str, ArtifactRef]) -> ArtifactRef:
            ready = present(inputs)
            assert ready is not None  # every stage before this one has run
            return run_stage(request, store, record, stage, ready, done)

        done = request.line.walk(request.until, bring)
        return {name: ref.model_dump(mode="json") for name, ref in done.items()}

    finished = actor(request.actor, request.sequence)
    return {name: ArtifactRef.model_validate(ref) for name, ref in finished.items()}


def use_local_prefect(root: Path) -> None:
    """Prefect's database and results beside the store, its server in this process group, nothing sent anywhere.

    A server, a home or a database that the user's environment or profile names is another Prefect's: of those nothing is taken over.
    """
    os.environ["PREFECT_HOME"] = str(root.resolve() / ".prefect")
    for name in ("PREFECT_API_URL", "PREFECT_SERVER_DATABASE_CONNECTION_URL"):
        os.environ.pop(name, None)
    for name, value in {
        "PREFECT_SERVER_ALLOW_EPHEMERAL_MODE": "true",
        "PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS": "150",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        # nobody reads events or has automations here, and SQLite, which writers keep from one another (PrefectHQ/prefect#18934), has fewer
        "PREFECT_SERVER_SERVICES_EVENT_PERSISTER_ENABLED": "false",
        "PREFECT_SERVER_SERVICES_TRIGGERS_ENABLED": "false",
        "PREFECT_SERVER_SERVICES_DB_VACUUM_ENABLED": "false",
        "PREFECT_RESULTS_DEFAULT_SERIALIZER": "json",
        "PREFECT_LOGGING_LEVEL": "WARNING",
        "PREFECT_SERVER_LOGGING_LEVEL": "ERROR",
        "PREFECT_LOGGING_TO_API_ENABLED": "false",
        "DO_NOT_TRACK": "1",
    }.items():
        os.environ.setdefault(name, value)
