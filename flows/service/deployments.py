"""From deploy/prefect.yaml to pools, queues and deployments on the server. Safe to repeat: what exists is brought up to date."""

from copy import deepcopy
from pathlib import Path
from typing import Any

import yaml
from prefect.client.orchestration import PrefectClient
from prefect.client.schemas.actions import DeploymentScheduleCreate, WorkPoolCreate, WorkPoolUpdate
from prefect.client.schemas.schedules import SCHEDULE_TYPES, CronSchedule, IntervalSchedule
from prefect.exceptions import ObjectAlreadyExists, ObjectNotFound
from prefect.flows import load_flow_from_entrypoint
from prefect.utilities.callables import parameter_schema
from prefect.workers.utilities import get_default_base_job_template_for_infrastructure_type

from flows.endings import Refused

DEPLOY = Path(__file__).parents[2] / "deploy"
PREFECT_FILE, POOLS_FILE = DEPLOY / "prefect.yaml", DEPLOY / "pools.yaml"


def read(file: Path = PREFECT_FILE) -> dict[str, Any]:
    """The content of a prefect.yaml."""
    return yaml.safe_load(file.read_text())


def with_parameter(described: dict[str, Any], name: str, value: Any) -> dict[str, Any]:
    """The same file with this value in every deployment that has a default for the parameter."""
    changed = [
        d | {"parameters": d["parameters"] | {name: value}} if name in d.get("parameters", {}) else d for d in described["deployments"]
    ]
    return described | {"deployments": changed}


def job_variables(kind: str, file: Path = POOLS_FILE) -> dict[str, dict[str, Any]]:
    """Pool → defaults of its jobs (image, GPU, memory …) for a kind of pool, from deploy/pools.yaml. Raises Refused."""
    kinds = yaml.safe_load(file.read_text())
    if kind not in kinds:
        raise Refused(f"there is no kind of pool {kind!r}; there are {', '.join(kinds)}")
    return kinds[kind]


async def deploy(client: PrefectClient, described: dict[str, Any], *, kind: str, variables: dict[str, dict[str, Any]]) -> None:
    """Make all pools of one `kind` (process, docker, kubernetes), with `variables` by pool as defaults of their jobs; then all deployments."""
    for name, pool in described["pools"].items():
        await _pool(client, name, kind, variables.get(name, {}))
        for queue, wanted in pool["queues"].items():
            await _queue(client, name, queue, **wanted)
    for deployment in described["deployments"]:
        await _deployment(client, deployment)


def with_defaults(template: dict[str, Any], variables: dict[str, Any]) -> dict[str, Any]:
    """A pool's job template with these defaults. `gpus` is no variable of Prefect's for Kubernetes: it goes into the container's limits."""
    template, defaults = deepcopy(template), dict(variables)
    if gpus := defaults.pop("gpus", 0):
        container = template["job_configuration"]["job_manifest"]["spec"]["template"]["spec"]["containers"][0]
        container["resources"]["limits"]["nvidia.com/gpu"] = gpus
    for variable, value in defaults.items():
        template["variables"]["properties"].setdefault(variable, {})["default"] = value
    return template


async def _pool(client: PrefectClient, name: str, kind: str, variables: dict[str, Any]) -> None:
    process = {"env": {}} | _process_defaults() if kind == "process" else {}
    bare = await get_default_base_job_template_for_infrastructure_type(kind)
    if bare is None:
        raise Refused(f"Prefect knows no work pools of kind {kind!r} here: install its integration")
    template = with_defaults(bare, process | variables)
    try:
        await client.create_work_pool(WorkPoolCreate(name=name, type=kind, base_job_template=template))
    except ObjectAlreadyExists:
        await client.update_work_pool(name, WorkPoolUpdate(base_job_template=template))


def _process_defaults() -> dict[str, Any]:
    """A command spares the worker two more interpreters per run, which it would start to look for dependencies."""
    return {"command": "python -m flows.service"}  # that of the worker: its PATH begins with its own environment


async def _queue(client: PrefectClient, pool: str, name: str, priority: int, limit: int | None = None) -> None:
    try:
        queue = await client.read_work_queue_by_name(name, work_pool_name=pool)
    except ObjectNotFound:
        queue = await client.create_work_queue(name, work_pool_name=pool)
    await client.update_work_queue(queue.id, priority=priority, concurrency_limit=limit)


async def _deployment(client: PrefectClient, described: dict[str, Any]) -> None:
    flow = load_flow_from_entrypoint(described["entrypoint"])
    limit = described.get("concurrency_limit") or {}
    switched = await _switched(client, f"{flow.name}/{described['name']}")
    await client.create_deployment(
        flow_id=await client.create_flow(flow),
        name=described["name"],
        description=described.get("description"),
        tags=described.get("tags", []),
        entrypoint=described["entrypoint"],
        work_pool_name=described["work_pool"]["name"],
        work_queue_name=described["work_pool"]["work_queue_name"],
        parameters=described.get("parameters", {}),
        parameter_openapi_schema=parameter_schema(flow).model_dump_for_openapi(),
        schedules=[_schedule(schedule, switched) for schedule in described.get("schedules", [])],
        enforce_parameter_schema=True,
        **(
            {"concurrency_limit": limit["limit"], "concurrency_options": {"collision_strategy": limit["collision_strategy"]}}
            if limit
            else {}
        ),
    )


async def _switched(client: PrefectClient, deployment: str) -> dict[str, bool]:
    """Whether each schedule that the server has is on: Prefect makes all of them anew."""
    try:
        known = await client.read_deployment_by_name(deployment)
    except ObjectNotFound:
        return {}
    return {_times(kept.schedule): bool(kept.active) for kept in known.schedules}


def _times(schedule: SCHEDULE_TYPES) -> str:
    """When it starts runs; an interval counts from a date that is another one each time it is made."""
    return repr(schedule.interval) if isinstance(schedule, IntervalSchedule) else repr(schedule)


def _schedule(described: dict[str, Any], switched: dict[str, bool]) -> DeploymentScheduleCreate:
    times = (
        CronSchedule(cron=described["cron"], timezone=described.get("timezone", "UTC"))
        if "cron" in described
        else IntervalSchedule(interval=described["interval"])
    )
    active = bool(switched.get(_times(times), described["active"]))
    return DeploymentScheduleCreate(schedule=times, active=active, parameters=described.get("parameters", {}))
