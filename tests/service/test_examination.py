"""The exam as runs of workers: what is dispatched, what is not, and what happens when one fails."""

import asyncio
import json
from dataclasses import replace

import numpy as np
import pytest

from flows import exam
from flows.endings import Refused
from flows.service import deployed, examination
from flows.service.dispatch import WorkFailed
from tasks.exam.generator.recording import Made

COUNT = 4


@pytest.fixture
def wanted(tmp_path):
    """Four cases, the second of which cannot be made, the third of which is answered."""
    sitting = exam.Exam(exam.Folder(tmp_path / "exam"), COUNT, 0, "open")
    wanted = sitting.tasks()
    x = np.zeros((3, 2, 3))
    arrays = {"vertices": x, "observed": np.ones((3, 2), bool), "boundary": np.zeros(0, np.int32)}
    folder = sitting.folder
    folder.write(wanted[2].question, Made((arrays, arrays), arrays, arrays, {}))
    for file in (folder.left_out(1), folder.answer(2) / "answer.json"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("null")
    assert [task.done for task in wanted] == [False, True, True, False]
    return wanted


@pytest.fixture
def dispatched(monkeypatch):
    """Work that would have gone to the server; what is named in `fails` fails."""
    sent, fails = [], set()

    async def dispatch(work):
        sent.append(work)
        await asyncio.sleep(0)
        if work.name in fails:
            raise WorkFailed(f"{work.name}: it crashed")

    monkeypatch.setattr(examination, "dispatch", dispatch)
    return sent, fails


def test_one_run_per_case_that_is_not_done(wanted, dispatched):
    sent, _ = dispatched
    asyncio.run(examination.conduct(examination.order(wanted), 2))
    assert [work.parameters["number"] for work in sent] == [0, 3]
    assert {work.deployment for work in sent} == {"case/service"} and {work.queue for work in sent} == {"batch"}
    assert len({work.key for work in sent}) == 2
    json.dumps([work.parameters for work in sent])


def test_a_failure_does_not_stop_the_others_and_is_told(wanted, dispatched):
    sent, fails = dispatched
    fails.add("exam: case 0")
    with pytest.raises(WorkFailed, match="1 cases failed; the first: exam: case 0: it crashed"):
        asyncio.run(examination.conduct(examination.order(wanted), 1))
    assert [work.parameters["number"] for work in sent] == [0, 3]


def test_the_exam_is_handed_over_once_and_not_at_all_when_done(wanted, dispatched):
    sent, _ = dispatched
    for _ in range(2):
        examination.over_workers(3)(wanted, lambda line: None)
    assert [work.deployment for work in sent] == 2 * ["exam/service"] and sent[0].key == sent[1].key
    examination.over_workers(3)([wanted[1], wanted[2]], lambda line: None)
    assert len(sent) == 2


def test_a_worker_makes_the_same_task_again_and_refuses_another_version(wanted, monkeypatch):
    done = []
    monkeypatch.setattr(examination, "do", lambda task, say: done.append(task))
    order = json.loads(json.dumps(examination.order(wanted)))
    deployed.case.fn(order, 3)
    assert done[0].question == wanted[3].question and done[0].exam.folder.root == wanted[3].exam.folder.root.resolve()
    with pytest.raises(Refused, match="install the same on both"):
        deployed.case.fn(order | {"version": "0" * 64}, 3)


def test_a_worker_does_what_is_left_of_a_task(wanted):
    """Who answered before, in another folder or on another day, does not answer again."""
    left = [replace(wanted[3], diagnosed=False, rivals=("chance",))]
    (again,) = examination.tasks(json.loads(json.dumps(examination.order(left))))
    assert again.question.number == 3 and again.candidates == ("chance",)
