"""A stage group: all stages of one worker pool that have their inputs, for one sequence, in one process on one worker."""

from typing import Any

from prefect import Flow, flow
from prefect.client.schemas.objects import State
from prefect.runtime import flow_run as this_run
from prefect.states import Failed

from flows.endings import TIMED_OUT, ending_of, state_of
from flows.line import present
from flows.request import Request, run_stage
from flows.runs import RunRecord
from flows.service.joining import ask_for_helpers
from flows.service.leftovers import end_orphans
from flows.service.order import Service
from flows.service.results import refuse_foreign_records
from flows.service.shown import Shown
from storage_schemas.reference import ArtifactRef
from storage_schemas.store import Store
from tasks.stage import Stage


def group_flow(service: Service, pool: str) -> Flow:
    """The flow that workers of `pool` run."""

    @flow(name=pool, persist_result=False)  # whoever dispatches names the run after its stages
    def group(actor: str, sequence: str, settings: dict[str, Any], until: str = "report", helpers: int = 0) -> State | None:
        refuse_foreign_records()
        end_orphans()
        request, store = service.open(actor, sequence, until, settings)
        try:
            advance(request, store, pool, helpers)
        except Exception as error:
            code, said = ending_of(error)
            if code != TIMED_OUT:
                raise
            return Failed(name="TimedOut", message=said)

    return group


def advance(request: Request, store: Store, pool: str, helpers: int = 0) -> dict[str, ArtifactRef]:
    """Take what is in the store, compute what belongs to `pool`, stop where another pool must come first; returns what is done.

    helpers: how many are asked for at a stage that spreads.
    """
    from flows.service.pictures import show  # meshes are drawn with numba: not for runs that only wait or sweep

    shown = Shown(request.actor, request.sequence)
    record = RunRecord(store.root, request.actor, request.sequence, listen=shown, flow_run=this_run.id)

    def bring(stage: Stage, inputs: dict[str, ArtifactRef | None], done: dict[str, ArtifactRef]) -> ArtifactRef | None:
        ready = present(inputs)
        if ready is None:
            return None
        key = stage.key(ready, request.parameters(stage, done, store))
        ref = store.find(request.actor, request.sequence, stage.name, key)
        if ref is None and stage.pool == pool:
            shared = helpers > 0 and stage.spreads
            if shared:
                ask_for_helpers(request, stage, key, helpers)
            ref = run_stage(request, store, record, stage, ready, done, shared=shared)
            show(store, stage, ref, done, request.recording)
        return ref

    try:
        done = request.line.walk(request.until, bring)
    except BaseException as error:
        record.end(state_of(error), f"{type(error).__name__}: {error}".splitlines()[0])
        raise
    record.end("completed")
    return done
