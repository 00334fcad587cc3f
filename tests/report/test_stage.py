"""The page as the stage makes it, of a recording and nothing else."""

import pytest

from tasks.capture.stage import CaptureParameters, capture
from tasks.report.stage import ReportParameters, report
from tasks.stage import Job
from tests.flows.recordings import tiny_recording


@pytest.mark.parametrize("stages", [{}, {"body": {"seconds": 1.0, "key": "ab", "warnings": ["it did not settle in <3> frames"]}}])
def test_the_warnings_of_every_stage_are_on_the_page_once(tmp_path, stages):
    folder = tiny_recording(tmp_path)
    job = Job("ann", "one", folder, tmp_path, lambda fraction, text: None, lambda text: None)
    captured = capture.function(job, parameters=CaptureParameters(recording=folder)).model_copy(update={"warnings": ("two suns",)})
    of_the_recording = {"capture": {"seconds": 1.0, "key": "cd", "warnings": ["two suns"]}}
    html = report.function(job, captured, ReportParameters(stages=of_the_recording | stages)).files["report.html"].decode()
    assert html.count("two suns") == 1
    assert html.count("<li>body: it did not settle in &lt;3&gt; frames</li>") == len(stages)
