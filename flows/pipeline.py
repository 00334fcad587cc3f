"""The order of the stages, and nothing else. What running a stage means (compute, plan, dispatch) is the caller's business."""

from flows.line import Line, Run
from tasks.appearance.stage import appearance
from tasks.body.stage import body
from tasks.capture.stage import capture
from tasks.cloth.stage import cloth
from tasks.gap.stage import gap
from tasks.keypoints.stage import keypoints
from tasks.registration.stage import registration
from tasks.report.stage import report
from tasks.skinning.stage import skinning
from tasks.tracking.stage import tracking


def pipeline(run: Run) -> None:
    """From a recording to an avatar and to where its physics differs from the recording. The report on whatever was reached comes after."""
    recording = run(capture)
    points = run(keypoints, capture=recording)
    person = run(body, capture=recording, keypoints=points)
    surface = run(tracking, capture=recording, body=person)
    inside = run(registration, capture=recording, keypoints=points, body=person, tracking=surface)
    skin = run(skinning, body=inside, tracking=surface)
    garments = run(cloth, capture=recording, body=inside, tracking=surface, skinning=skin)
    run(gap, capture=recording, tracking=surface, body=inside, cloth=garments)
    run(appearance, capture=recording, tracking=surface, body=inside, skinning=skin)


AVATAR = Line(
    {s.name: s for s in (capture, keypoints, body, tracking, registration, skinning, cloth, gap, appearance, report)},
    pipeline,
    closing="report",
)
STAGES = AVATAR.stages
