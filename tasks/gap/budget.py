"""The gap as a budget: what the base refit, the discretisation and the named effects take from the misfit, and what is left.

Misfit is r_wᵀ C_w⁻¹ r_w per compared coordinate over the training windows: white noise of the stated size gives about 1. Every step is
judged on windows that its strengths were not fitted on. The steps and the rest add up to the misfit before all windows were fitted.

Limits: the first bar begins where the rough refit on a few windows ends (`screening.roughly_refitted`), for only from there on are all
windows followed, and with the start states' prior of that moment, which may be wider than the final one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from tasks.cloth.nuisances import without_nuisances
from tasks.gap.hypotheses import Fitted
from tasks.gap.screening import Screened
from tasks.gap.shapley import misfit_taken

Part = Literal["base", "numerics", "effect", "unexplained", "noise"]


@dataclass(frozen=True)
class Item:
    """One bar: its name, what kind of part it is, and its share of the misfit per coordinate (negative where it adds to the misfit)."""

    name: str
    part: Part
    misfit: float


def budget(screened: Screened, named: Fitted | None, simulated: Sequence[Fitted] = ()) -> tuple[Item, ...]:
    """From the base before its refit on all windows down to the noise; `named` after its refit with the simulator, or None; simulated: other
    hypotheses that were.
    """
    w = screened.windows
    count = sum(n.n for n in w.normals)
    start = screened.base.history[0]["misfit"]
    prior = replace(screened.prior, a=w.forcing)
    followed = [without_nuisances(e.normals, prior).c for e in screened.evidence if e.prediction.complete]
    numerics = (sum(followed) - sum(n.c for n in w.normals)) / count
    based = (w.base.misfits + w.noise).sum() / count
    items = [Item("base refit", "base", start - numerics - based), Item("numerics", "numerics", numerics)]
    rest = w.base.misfits.sum() / count
    if named is not None:
        taken = {name: value / count for name, value in misfit_taken(w, named, simulated).items()}
        items += [Item(name, "effect", value) for name, value in taken.items()]
        rest -= sum(taken.values())
    return (*items, Item("unexplained", "unexplained", rest), Item("noise floor", "noise", w.noise.sum() / count))
