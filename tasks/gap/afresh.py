"""Fabric and the strength of a cause fitted together from the fabric that the base refit began with, as if the cause had been in the model
all along.

A base that lacks a cause may bend its fabric so far that no step leads back: seen through cameras whose scale is wrong by 4.0 %, a curtain
was fitted with a twenty-sixth of its κ_s/ρ and with κ_b at its bound, and steps from there ended at 2.3 %. So the rounds of the base refit
are gone through once more with the cause in the model (`cloth/joint_refit.py`): a few short windows, from which a fabric far off finds
back, then all that are compared. There: 3.3 %, κ_b 1.04 times the truth, κ_s a third of it, for something else was missing too.

Limits: begins at the strength that was found about the base.
"""

from dataclasses import replace

import numpy as np

from tasks.cloth.joint_refit import refit_jointly
from tasks.cloth.shooting import Map
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import SHORT_S, Window
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, jobs, restarted
from tasks.gap.hypotheses import Fitted
from tasks.gap.screening import FINAL, ITERATIONS, ROUGH, Screened

STARTING = 12  # modes of a window's start


def afresh(screened: Screened, first: Model, data: Gathered, hypothesis: Fitted, run: Map) -> tuple[Fitted, Model]:
    """The hypothesis where fabric and strengths come to rest, and the model; first: the model that the base refit began from, data: the
    windows compared.
    """
    model = screened.base.model
    model = replace(model, subject=replace(model.subject, fabric=first.subject.fabric))
    model = model.joined([], {e.name: hypothesis.θ(e) for e in hypothesis.effects})
    effects = (*model.effects, *hypothesis.effects)
    offsets = {e.prediction.window: e.offsets for e in screened.evidence}
    for windows, iterations in ((_few_short(data, model.subject.fps), ITERATIONS), (data, FINAL)):
        φ = smooth_modes(model.subject.cloth, STARTING)
        found = jobs(model, restarted(model, windows, run), φ)
        todo = [replace(job, recording=job.recording.forgetful, offsets=offsets.get(job.window, {})) for job in found]
        model = refit_jointly(replace(screened.base, model=model), todo, effects, noise=data.noise, iterations=iterations, run=run).model
    return replace(hypothesis, base=np.zeros_like(hypothesis.base), strengths=model.by_column(hypothesis.effects)), model


def _few_short(data: Gathered, fps: float) -> Gathered:
    """A few short windows within those of `data`."""
    short = [w for w in data.cut(SHORT_S, fps).windows if any(_within(w, own) for own in data.windows)] or data.windows
    return data.only(short[:: max(1, len(short) // ROUGH)])


def _within(w: Window, own: Window) -> bool:
    return w.recording == own.recording and own.start <= w.start and w.start + w.length <= own.start + own.length
