"""The dataset flow: plans, submits what is new or changed, a few at a time, goes on past failures, and tells how each ended."""

import asyncio
import json
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from prefect import Flow, flow
from prefect.logging import get_logger

from flows.dataset import DatasetParameters, Sequence, Standing, find_sequences, plan_dataset
from flows.request import Request
from flows.service.board import Board
from flows.service.cancellation import cancel_children
from flows.service.dispatch import Work, WorkFailed, digest, dispatch
from flows.service.hand_over import actor_work
from flows.service.order import Service
from flows.service.settings import json_settings, placed
from flows.service.survey import survey
from storage_schemas.durable import make_folders, replace_file
from storage_schemas.faults import DiskFull
from storage_schemas.object_store import open_store
from storage_schemas.store import Store

GPU_POOLS = frozenset({"tracking", "rendering"})
FOLDER = ".datasets"
SHOW_EVERY_S, ROWS_SHOWN = 10.0, 500
FULL_DISK_PAUSES_S = (5.0, 20.0, 60.0)
ORDER = ("failed", "over quota", "refused", "running", "completed", "queued")  # what somebody must look at stands first


@dataclass
class Row:
    """How one sequence of a campaign fared."""

    actor: str
    sequence: str
    state: str
    seconds: float = 0.0
    why: str = ""


@dataclass
class Campaign:
    """One run over a dataset, kept as JSON in <store>/.datasets so that it can be followed without a server."""

    store: Path
    id: str = field(default_factory=lambda: f"{datetime.now(UTC):%Y%m%d-%H%M%S}")
    started: float = field(default_factory=time.time)
    state: str = "running"
    gpu_seconds: float = 0.0
    rows: dict[str, Row] = field(default_factory=dict)

    def set(self, standing: Standing, state: str, seconds: float = 0.0, why: str = "") -> None:
        """One sequence has come further."""
        self.rows[f"{standing.actor}/{standing.sequence}"] = Row(standing.actor, standing.sequence, state, round(seconds, 1), why)

    def counts(self) -> dict[str, int]:
        """How many sequences are in each state."""
        states = [row.state for row in self.rows.values()]
        return {state: states.count(state) for state in sorted(set(states))}

    def ending(self) -> str:
        """How it ended, once all sequences were looked at."""
        counts = self.counts()
        return next((state for state in ("failed", "over quota") if state in counts), "completed")

    def write(self) -> None:
        """Put it on disk, whole or not at all; a full disk must not end the campaign, it is tried again."""
        folder = self.store / FOLDER
        with suppress(OSError):
            make_folders(folder)
            replace_file(folder / f"{self.id}.json", json.dumps(self.as_json()).encode())

    def as_json(self) -> dict[str, Any]:
        """What `dataset status --json` prints."""
        rows = [asdict(row) for row in self.rows.values()]
        return {
            "id": self.id,
            "state": self.state,
            "started": self.started,
            "gpu_hours": round(self.gpu_seconds / 3600, 3),
            "counts": self.counts(),
            "rows": rows,
        }


def dataset_flow(service: Service) -> Flow:
    """The flow `dataset`. Without settings, as when cron starts it, the worker's own configuration counts."""

    @flow(name="dataset", persist_result=False, on_cancellation=[cancel_children])
    async def dataset(settings: dict[str, Any] | None = None) -> None:
        parsed: Any = service.settings.model_validate(settings) if settings is not None else service.load()
        await run_campaign(service, parsed, find_sequences(Path(parsed.data)))

    return dataset


async def run_campaign(service: Service, settings: Any, sequences: Iterable[Sequence]) -> Campaign:
    """Process the sequences; the campaign as it ended. Raises WorkFailed at the end if any of them failed."""
    store = await _opened(settings.store)
    campaign = Campaign(store.root)
    wishes: DatasetParameters = settings.dataset

    def request_of(at: Sequence) -> Request:
        return service.request(at, settings, store)

    due = await asyncio.to_thread(_plan, campaign, sequences, request_of, store)
    campaign.write()
    board = Board()
    show = asyncio.create_task(_keep_shown(campaign, board))
    waiting = iter(due)
    ending = "interrupted"
    try:
        await asyncio.gather(*(_worker(waiting, campaign, wishes, request_of, store) for _ in range(max(1, wishes.in_flight))))
        ending = campaign.ending()
    finally:
        show.cancel()
        campaign.state = ending
        campaign.write()
    await _show(campaign, board)
    if failed := [row for row in campaign.rows.values() if row.state == "failed"]:
        first = f"{failed[0].actor} {failed[0].sequence}: {failed[0].why}"
        raise WorkFailed(f"{len(failed)} of {len(due)} sequences failed; the first: {first}")
    return campaign


def _plan(
    campaign: Campaign, sequences: Iterable[Sequence], request_of: Callable[[Sequence], Request], store: Store
) -> list[tuple[Sequence, Standing]]:
    """What is to be done; every sequence gets its row."""
    due: list[tuple[Sequence, Standing]] = []
    for at in sequences:
        standing = _standing(at, request_of, store)
        if standing.state in ("finished", "refused"):
            campaign.set(standing, standing.state, why=standing.why)
        else:
            campaign.set(standing, "queued", why=standing.why)
            due.append((at, standing))
    return due


def _standing(at: Sequence, request_of: Callable[[Sequence], Request], store: Store) -> Standing:
    try:
        return next(plan_dataset([at], request_of, store))
    except Exception as error:  # noqa: BLE001  whatever is wrong with one recording, the others are looked at; its own run will say it again
        return Standing(at.actor, at.sequence, "unfinished", _reason(error))


async def _opened(location: Any) -> Store:
    """The store. A new one is founded, for which a full disk may leave no room: somebody may free some before the campaign is given up."""
    for pause in FULL_DISK_PAUSES_S:
        try:
            return open_store(location)
        except DiskFull as full:
            get_logger(__name__).warning("%s Tried again in %.0f s.", full, pause)
            await asyncio.sleep(pause)
    return open_store(location)


async def _worker(
    waiting: Iterator[tuple[Sequence, Standing]],
    campaign: Campaign,
    wishes: DatasetParameters,
    request_of: Callable[[Sequence], Request],
    store: Store,
) -> None:
    for at, standing in waiting:
        start = time.monotonic()
        try:
            if (reason := over_quota(campaign, wishes, store)) is not None:
                campaign.set(standing, "over quota", why=reason)
                continue
            campaign.set(standing, "running")
            request = request_of(at)
            await dispatch(actor_work(request, store, "batch"))
            campaign.gpu_seconds += await asyncio.to_thread(_gpu_seconds, request, store, campaign.started)
        except Exception as error:  # noqa: BLE001  whatever befalls one sequence, the others go on
            campaign.set(standing, "failed", time.monotonic() - start, _reason(error))
        else:
            campaign.set(standing, "completed", time.monotonic() - start)


def _reason(error: Exception) -> str:
    return str(error) if isinstance(error, WorkFailed) else f"{type(error).__name__}: {error}"


def dataset_work(settings: Any) -> Work:
    """The dataset as this configuration sees it, as work for the service."""
    absolute = placed(settings, open_store(settings.store))
    parameters = json_settings(absolute) | {"dataset": settings.dataset.model_dump(mode="json")}
    return Work("dataset/service", {"settings": parameters}, f"dataset-{digest(parameters)}", f"dataset {absolute.data.name}")


def over_quota(campaign: Campaign, wishes: DatasetParameters, store: Store) -> str | None:
    """Why nothing more may be submitted, if so."""
    if wishes.gpu_hours is not None and campaign.gpu_seconds >= 3600 * wishes.gpu_hours:
        return f"{campaign.gpu_seconds / 3600:.2f} of {wishes.gpu_hours} GPU hours are used"
    free = shutil.disk_usage(store.root).free / 1e9
    if free < wishes.keep_free_gb:
        return f"{free:.1f} GB free, {wishes.keep_free_gb} are kept"
    if wishes.store_gb is not None and (size := store.size() / 1e9) > wishes.store_gb:
        return f"the store holds {size:.2f} of {wishes.store_gb} GB"
    return None


def _gpu_seconds(request: Request, store: Store, since: float) -> float:
    """What this campaign's artifacts of the GPU pools took."""
    own = [ref for stage, ref in survey(request, store).done.items() if request.line.stages[stage].pool in GPU_POOLS]
    made = [store.provenance(ref) for ref in own]
    return sum(origin.seconds for origin in made if origin.started.timestamp() >= since)


async def _keep_shown(campaign: Campaign, board: Board) -> None:
    while True:
        campaign.write()
        await _show(campaign, board)
        await asyncio.sleep(SHOW_EVERY_S)


async def _show(campaign: Campaign, board: Board) -> None:
    counts, total = campaign.counts(), max(len(campaign.rows), 1)
    left = counts.get("queued", 0) + counts.get("running", 0)
    told = sorted((row for row in campaign.rows.values() if row.state != "finished"), key=lambda row: ORDER.index(row.state))
    said = f"{campaign.id}: " + ", ".join(f"{count} {state}" for state, count in counts.items())
    await board.show(100 * (1 - left / total), [asdict(row) for row in told[:ROWS_SHOWN]], said)
