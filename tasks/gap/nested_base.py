"""The base refitted once more, from the fabric in which the leading cause came to rest.

The base is every cause's model at strength zero, so at their best no base is better than a cause, and no cause gains but by its strength.
Each is fitted from a start of its own, though, and may come to rest elsewhere: where the base's fabric is not the best there is, a cause
that found a better one is credited with the difference. So the base starts from there too, and where it comes nearer so, everything is
weighed anew about it.

Source: Wilks 1938 (a likelihood ratio of nested models takes the maximum of each). Limits: one fabric is tried, the leader's.
"""

import numpy as np

from tasks.cloth.base_parameters import logarithms, with_fabric
from tasks.cloth.base_refit import PROMISE, BaseFit, nearer_by, refit
from tasks.cloth.shooting import Map
from tasks.cloth.state_modes import smooth_modes
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, jobs
from tasks.gap.refits import FAR_FABRIC
from tasks.gap.screening import FINAL, MODES
from tasks.simulator import Fabric


def nested_base(base: BaseFit, data: Gathered, fabric: Fabric, run: Map = map) -> Model | None:
    """The base where it comes to rest from `fabric`; None where that is near its own, or it comes no nearer to the windows of `data` than
    before, by what is worth a further round of its refit.
    """
    model = base.model
    if np.abs(logarithms(fabric) - logarithms(model.subject.fabric)).max() <= FAR_FABRIC:
        return None
    own = [e for e in base.evidence if e.prediction.window in data.windows]
    data = data.only(e.prediction.window for e in own)
    todo = jobs(with_fabric(model, fabric), data, smooth_modes(model.subject.cloth, MODES))
    other = refit(todo, noise=data.noise, iterations=FINAL, run=run)
    worth = PROMISE * sum(e.normals.n for e in own)
    return other.model if nearer_by(own, other.evidence, base.prior) > worth else None
