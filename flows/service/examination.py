"""The exam over workers: one run per case in the simulation pool, dispatched by a parent, which goes on past failures.

Workers need the exam's folder, as a dataset's need the store, and the same examined code: a run refuses another version.
"""

import asyncio
import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from prefect import Flow, flow

from flows import exam_engine
from flows.endings import Refused
from flows.exam import Exam, Folder, Say, Spread, Task, do, version
from flows.exam_rival import chosen
from flows.service.cancellation import cancel_children
from flows.service.dispatch import Work, WorkFailed, dispatch


def exam_flow() -> Flow:
    """The flow `exam`: all cases that are not done, `in_flight` at a time."""

    @flow(name="exam", persist_result=False, on_cancellation=[cancel_children])
    async def exam(order: dict[str, Any], in_flight: int = 4) -> None:
        await conduct(order, in_flight)

    return exam


def case_flow() -> Flow:
    """The flow `case`: one case made, diagnosed, and answered by rivals."""

    @flow(name="case", persist_result=False)
    def case(order: dict[str, Any], number: int) -> None:
        if order["engine"] != "own":
            exam_engine.prepare()
        do(next(task for task in tasks(order) if task.question.number == number), lambda line: None)

    return case


def over_workers(in_flight: int) -> Spread:
    """Tasks as runs of the service's workers."""

    def spread(wanted: Sequence[Task], say: Say) -> None:
        if all(task.done for task in wanted):
            return
        work = exam_work(order(wanted), in_flight)
        say(f"{work.name}: handed to the service")
        asyncio.run(dispatch(work))

    return spread


async def conduct(order: dict[str, Any], in_flight: int) -> None:
    """Dispatch what is not done. Raises WorkFailed, once nothing more is under way, if any case failed."""
    waiting, failures = iter([task for task in tasks(order) if not task.done]), []

    async def worker() -> None:
        for task in waiting:
            try:
                await dispatch(case_work(order, task.question.number))
            except WorkFailed as failed:
                failures.append(str(failed))

    await asyncio.gather(*(worker() for _ in range(max(1, in_flight))))
    if failures:
        raise WorkFailed(f"{len(failures)} cases failed; the first: {failures[0]}")


def order(wanted: Sequence[Task]) -> dict[str, Any]:
    """JSON from which a worker makes the same tasks again."""
    exam = wanted[0].exam
    rivals = sorted({rival for task in wanted for rival in task.rivals})
    place = {"folder": str(exam.folder.root.resolve()), "split": exam.split, "engine": exam.engine}
    asked = {str(task.question.number): list(task.candidates) for task in wanted}
    return place | {"count": exam.count, "seed": exam.seed, "rivals": rivals, "asked": asked, "version": version()}


def tasks(order: dict[str, Any]) -> Iterator[Task]:
    """The tasks of an order. Raises Refused where the examined code is another one here."""
    if version() != order["version"]:
        raise Refused(f"this worker's code is version {version()[:12]}, the exam is of {order['version'][:12]}: install the same on both")
    exam = Exam(Folder(Path(order["folder"])), order["count"], order["seed"], order["split"], order["engine"])
    for task in exam.tasks(chosen(order["rivals"])):
        asked = order["asked"].get(str(task.question.number))
        if asked is not None:
            yield task.by(asked)


def exam_work(order: dict[str, Any], in_flight: int) -> Work:
    """The whole exam as work for the service; asking again follows the run there is."""
    return Work("exam/service", {"order": order, "in_flight": in_flight}, f"exam-{_digest(order)}", f"exam of {order['count']} cases")


def case_work(order: dict[str, Any], number: int) -> Work:
    """One case as work for the simulation pool, after whatever a person waits for."""
    key = f"case-{_digest(order)}-{number}"
    return Work("case/service", {"order": order, "number": number}, key, f"exam: case {number}", "batch")


def _digest(order: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(order, sort_keys=True).encode()).hexdigest()[:32]
