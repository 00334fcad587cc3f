"""Refits of hypotheses with the simulator: which are worth one, the refit, and what a second effect would add beside it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tasks.cloth.base_parameters import moved, with_fabric
from tasks.cloth.numerics import with_tangents
from tasks.cloth.shooting import Evidence, Map, follow_nearer
from tasks.cloth.state_modes import smooth_modes
from tasks.cloth.windows import Normals
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.gathered import Gathered, enough, jobs, restarted
from tasks.gap.hypotheses import NOWHERE, Fitted, Windows
from tasks.gap.interpenetration import cleared
from tasks.gap.joint_estimate import disagreement, foretold, joint
from tasks.gap.observed_lengths import SCALES, observed_scale
from tasks.gap.replay import Replay, Replayed, lost, mean, mean_normals, parted, replayed_by, replayed_by_each, supported
from tasks.gap.screening import MODES, Screened, compressed
from tasks.gap.verdict import TEMPER, Twins, told_apart

Array = NDArray[np.float64]

FAR, FAR_FABRIC = 0.1, 0.25  # change of the leading strength, and of a stiffness' logarithm, by a refit that is worth another one
WORTH = 1.0  # least evidence of one that is,
CONTENDER, SHARE = 4.0, 0.3  # and how far behind the strongest: whichever of the difference and of the share of its evidence is more
TWIN = 0.01  # of evidence, so that of two that are the same the one that was simulated leads


@dataclass(frozen=True)
class Refitted:
    """A hypothesis after a refit with the simulator: its model, how it fits, the evidence of its windows, those of them that could be
    followed linear about it (`windows`; None where these are too few) and, linear about the base, what they are compared with (`against`),
    its replays, and those of it as it was simulated.
    """

    hypothesis: Fitted
    model: Model
    evidence: tuple[Evidence, ...]
    windows: Windows | None
    replays: tuple[Replay | None, ...] = ()
    replays_as_simulated: tuple[Replay | None, ...] = ()
    against: Windows | None = None

    @property
    def replayed(self) -> Replayed:
        """How near its replays come, mean over recordings."""
        return mean(self.replays)

    @property
    def told(self) -> Normals | None:
        """What replays as it was simulated tell of every effect (`Replay.normals`, mean); None where it was not replayed."""
        return mean_normals(self.replays_as_simulated)


def refitted(
    screened: Screened,
    data: Gathered,
    hypothesis: Fitted,
    effects: Sequence[Effect],
    *,
    start: Model | None = None,
    beside: "Refitted | None" = None,
    run: Map = map,
) -> Refitted:
    """The training windows followed once more with the hypothesis' effects at their strengths, and what a last linear step adds.

    start: the model that the hypothesis was linear about (default: the refitted base); beside: of two causes the first alone, as it was
    simulated: the second is weighed by how windows of both compare with that one's. All effects keep their tangents. Where too few windows
    can be followed so far from there, half-way.
    """
    for model in _on_the_way(screened.base.model.joined(effects, {}), start or screened.base.model, hypothesis):
        evidence = _simulated(model, screened, data, screened.evidence, run)
        known = evidence if beside is None else beside.evidence
        followed = [k for k, pair in enumerate(zip(evidence, known, strict=True)) if all(e.prediction.complete for e in pair)]
        if enough(len(followed), len(evidence)):
            against = screened.windows.only(followed)
            both = compressed([evidence[k] for k in followed], screened.prior, effects, screened.doubt)
            alone = None if beside is None else _alone(beside, screened, followed, effects)
            about = against.about(both, hypothesis.effects, model.by_column(hypothesis.effects), alone)
            return Refitted(about.fit(hypothesis.effects), model, evidence, about, against=against)
    return Refitted(replace(hypothesis, weights=()), model, evidence, None)


def _alone(first: Refitted, screened: Screened, followed: Sequence[int], effects: Sequence[Effect]) -> Windows:
    """Some windows as they were simulated with a first cause alone."""
    normals = compressed([first.evidence[k] for k in followed], screened.prior, effects, screened.doubt)
    return Windows(normals, screened.windows.effects, first.model.by_column(first.hypothesis.effects))


def _on_the_way(model: Model, start: Model, hypothesis: Fitted) -> Iterator[Model]:
    """The model in the fabric and with the strengths of the hypothesis, then half-way to them from those of `start`, if these are others."""
    asked = {e.name: (start.strength(e), hypothesis.θ(e)) for e in hypothesis.effects}
    moves = np.any(hypothesis.base) or any(np.any(now != then) for now, then in asked.values())
    for share in (1.0, 0.5) if moves else (1.0,):
        fabric = moved(start.subject.fabric, share * hypothesis.base)[0]
        yield with_fabric(model.joined([], {name: (1 - share) * now + share * then for name, (now, then) in asked.items()}), fabric)


def weighed_with(named: Refitted, screened: Screened, data: Gathered, before: Sequence[Evidence], run: Map = map) -> Refitted:
    """A hypothesis weighed by further windows of `data` as well, with tangents of all effects in `before`, the base's evidence of them; its
    strengths stay.
    """
    taught, effects = named.windows, named.windows.effects
    evidence = _simulated(named.model, screened, data, before, run)
    both = [pair for pair in zip(before, evidence, strict=True) if all(e.prediction.complete for e in pair)]
    base, own = (compressed([pair[k] for pair in both], screened.prior, effects, screened.doubt) for k in (0, 1))
    against = named.against.beside(base)
    windows = against.about([*taught.given, *own], named.hypothesis.effects, taught.origin)
    hypothesis = replace(named.hypothesis, weights=windows.fit(named.hypothesis.effects).weights)
    return replace(named, hypothesis=hypothesis, windows=windows, against=against)


def _simulated(model: Model, screened: Screened, data: Gathered, before: Sequence[Evidence], run: Map) -> tuple[Evidence, ...]:
    """The windows of `before` followed with a model whose effects have strengths, each about the start that it asks for itself, as those of
    `before` are: from the base's start another model has further to go. All effects keep their tangents.
    """
    φ = smooth_modes(model.subject.cloth, MODES)
    data = restarted(model, data.only(e.prediction.window for e in before), run, φ)
    todo = jobs(with_tangents(model), data, φ, columns=True, forced=True, prior=screened.base.prior)
    return tuple(run(follow_nearer, [replace(job, offsets=e.offsets) for job, e in zip(todo, before, strict=True)]))


def replayed(named: Refitted, base: Sequence[Replay | None], data: Gathered, run: Map = map, *, beside: Refitted | None = None) -> Refitted:
    """The same as windows and whole recordings together ask for it, weighed by how its replays compare with the base's.

    It is replayed as it was simulated; where what both together ask for is far from that, so once more, and where what windows alone ask
    for is far from either, so too. Of these the one counts with which windows and replays disagree least (`joint_estimate.py`). beside: of
    two causes the first alone, as it was simulated: the second is weighed by how replays of both compare with that one's.
    """
    if named.windows is None:
        return named
    here = replayed_by(named.model, base, data, run, columns=True)
    told = mean_normals(here)
    if told is None:
        return named
    alone = replace(named, replays=here, replays_as_simulated=here)
    together = replace(alone, hypothesis=joint(named.hypothesis, told, mean(here), named.windows.origin))
    found = alone if moved_on(together) else together
    apart = _apart(together.hypothesis, alone.hypothesis)
    asked = [each for each in ((together, alone) if apart else (together,)) if moved_on(each)]
    models = [corrected_model(each) for each in asked]
    for each, replays in zip(asked, replayed_by_each(models, base, data, run), strict=True):
        there = replace(each, replays=replays)
        found = there if _agrees_more(there, found, named.hypothesis) else found
    return replace(found, hypothesis=replace(found.hypothesis, support=_support(found, base, beside)))


def taken_back(named: Refitted, base: Sequence[Replay | None], *, beside: Refitted | None = None) -> Refitted:
    """A hypothesis without its last step: at the strengths with which it was simulated, weighed by replays of just that."""
    here = replace(named, hypothesis=part_way(named, 0.0), replays=named.replays_as_simulated)
    return replace(here, hypothesis=replace(here.hypothesis, support=_support(here, base, beside))) if here.replays else here


def _agrees_more(one: Refitted, other: Refitted, windows: Fitted) -> bool:
    """Whether windows and replays disagree less about it, and no replay was lost."""
    if lost(one.replays, other.replays):
        return False
    mine, theirs = (disagreement(each.hypothesis, windows, each.replayed) for each in (one, other))
    return mine < theirs


def _support(named: Refitted, base: Sequence[Replay | None], beside: Refitted | None) -> float:
    """Log Bayes factor against the base by replays."""
    if beside is None or beside.hypothesis.support is None:
        return supported(mean(base), named.replayed)
    apart = parted(named.replays, beside.replays)
    return beside.hypothesis.support + supported(beside.replayed, replace(named.replayed, apart=apart))


def comes_nearer(named: Refitted, base: Replayed) -> bool:
    """Whether whole recordings replayed with it come as near as the base's; what cannot be replayed is not held against it."""
    return not named.replayed.gap > base.gap


def searched(named: Refitted) -> tuple[Fitted, ...]:
    """Second effects beside a single one that was simulated: what it leaves, they may explain. Whole recordings say of them what they say of the first."""
    if named.windows is None or len(named.hypothesis.effects) != 1:
        return ()
    own = named.hypothesis.effects[0]
    both = (named.windows.fit([own, e]) for e in named.windows.effects if e.name != own.name)
    return tuple(replace(pair, support=named.hypothesis.support) for pair in both)


def foretold_beside(named: Refitted, pair: Fitted) -> tuple[Fitted, float]:
    """A second effect beside the one that was simulated, as windows and whole recordings together ask for both, and the log Bayes factor of
    it by replays, as far as derivatives about the first one's tell.
    """
    if named.told is None:
        return pair, 0.0
    here = replace(named.replayed, gap=named.told.c)
    return foretold(pair, named.told, here, named.windows.origin)


def moved_on(named: Refitted) -> bool:
    """Whether strengths or fabric after a refit are far from those it was simulated with: what curvature leaves, a second effect would be blamed for."""
    return strengths_moved(named) or _fabric_moved(named.hypothesis.base)


def strengths_moved(named: Refitted) -> bool:
    """Whether strengths alone are."""
    before = np.concatenate([named.model.strength(e) / e.typical for e in named.hypothesis.effects])
    return _far(before, _sizes(named.hypothesis))


def part_way(named: Refitted, share: float) -> Fitted:
    """The hypothesis after so much of the step from what was simulated to what that asks for."""
    h, here = named.hypothesis, named.model.by_column(named.hypothesis.effects)
    strengths = {c: here[c] + share * (θ - here[c]) for c, θ in h.strengths.items()}
    return replace(h, base=share * h.base, strengths=strengths)


def _apart(one: Fitted, other: Fitted) -> bool:
    """Whether two estimates of one hypothesis are as far from one another."""
    return _far(_sizes(one), _sizes(other)) or _fabric_moved(other.base - one.base)


def _sizes(h: Fitted) -> Array:
    """Strengths, in typical ones."""
    return np.concatenate([h.θ(e) / e.typical for e in h.effects])


def _far(before: Array, after: Array) -> bool:
    return bool(np.linalg.norm(after - before) > FAR * np.linalg.norm(after))


def _fabric_moved(step: Array) -> bool:
    return bool(np.abs(step).max() > FAR_FABRIC)


def as_simulated(singles: Sequence[Fitted], after: Mapping[str, Refitted], alike: Twins) -> list[Fitted]:
    """Hypotheses as they weigh after the refits: a twin of one that was simulated weighs as that one less `TWIN`, for its own simulation
    would be the same.
    """
    found = []
    for h in singles:
        own = after.get(h.name)
        other = next((r for name, r in after.items() if own is None and frozenset((name, h.name)) in alike), None)
        if other is not None and other.hypothesis.weights:
            (weight,) = other.hypothesis.weights
            weights = (replace(weight, prior=weight.prior - TWIN),)
            h = replace(h, weights=weights, forcing=other.hypothesis.forcing, support=other.hypothesis.support)
        found.append(h if own is None else own.hypothesis)
    return found


def by_contact(screened: Screened, train: Gathered, effects: Sequence[Effect], alike: Twins) -> list[Fitted]:
    """Effects on the body that cloth seen inside it asks for, at the strength that clears it: derivatives cannot tell of them. Of twins, one."""
    linear, chosen = {h.name: h for h in screened.hypotheses}, []
    for name, θ in cleared(screened.base.model, train.compared(), effects, train.noise).items():
        if told_apart(name, (c.name for c in chosen), alike):
            chosen.append(replace(linear[name], strengths={name: θ}))
    return chosen


def by_length(screened: Screened, train: Gathered) -> list[Fitted]:
    """The scale of pattern or cameras that observed lengths ask for, where they ask for one."""
    s = observed_scale(screened.base.model, train.compared())
    chosen = [h for name in SCALES for h in screened.hypotheses if h.name == name and s][:1]
    return [
        replace(
            h, strengths={c: float(np.clip(s, r.low, r.high)) for c, r in zip(h.effects[0].columns, h.effects[0].strengths, strict=True)}
        )
        for h in chosen
    ]


def contenders(
    singles: Sequence[Fitted], seen: Sequence[Fitted], most: int, alike: Twins, missing: float, whole: Mapping[str, float] = NOWHERE
) -> list[Fitted]:
    """Hypotheses worth a refit with the simulator: those `seen` otherwise, then those whose evidence, linear about the base, is near the
    strongest.

    Of twins one is enough. At most `most`, of the others at least one. missing: log Bayes factor that anything is, by replays: where it is
    negative, more evidence is asked for. whole: name -> the same of a hypothesis as far as derivatives foretell it, which adds to its
    evidence.
    """
    promise = {h.name: h.evidence + max(whole.get(h.name, 0.0), 0.0) / TEMPER for h in singles}
    strongest, least = max(promise.values()), least_worth(missing)
    near = [h for h in singles if promise[h.name] > max(least, strongest - max(CONTENDER, SHARE * strongest))]
    chosen = list(seen)
    for h in sorted(near, key=lambda h: -promise[h.name]):
        if len(chosen) < max(most, len(seen) + 1) and told_apart(h.name, (c.name for c in chosen), alike):
            chosen.append(h)
    return chosen


def least_worth(missing: float) -> float:
    """Evidence from which a hypothesis is worth a refit; missing: log Bayes factor that anything is, by replays."""
    return WORTH - min(missing, 0.0) / TEMPER


def corrected_model(named: Refitted) -> Model:
    """The model of a refit after its last linear step."""
    h, model = named.hypothesis, _acting(named.model)
    fabric = moved(model.subject.fabric, h.base)[0]
    return with_fabric(replace(model, strengths={**model.strengths, **{e.name: h.θ(e) for e in h.effects}}), fabric)


def _acting(model: Model) -> Model:
    """The model without the effects that are there for their tangents only."""
    return replace(model, effects=tuple(e for e in model.effects if e.name in model.strengths))
