"""Trials: the leading hypotheses simulated and replayed, until the strength of the one that leads stands still.

Derivatives about the refitted base propose, and effects at strengths that show (`probes.py`); what counts is each hypothesis about its own
simulation. The leader is simulated again where its strength moved, from where it stands, and part of the way where the whole step makes it
weigh less; and where it leaves much unexplained, once in a fabric that is fitted afresh with it (`afresh.py`), as a scale is, too, that
observed lengths ask for (`observed_lengths.py`). Second causes beside the leader are proposed in both ways as well.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tasks.cloth.base_parameters import moved, with_fabric
from tasks.cloth.base_refit import BaseFit
from tasks.cloth.shooting import Evidence, Map
from tasks.effects.effect import Effect
from tasks.effects.model import Model
from tasks.gap.afresh import afresh
from tasks.gap.confusability import confusability
from tasks.gap.gathered import Gathered, restarted
from tasks.gap.held_out import floor_mm
from tasks.gap.hypotheses import Fitted
from tasks.gap.joint_estimate import foretold, joint
from tasks.gap.library_doubt import unexplained
from tasks.gap.nested_base import nested_base
from tasks.gap.probes import Probe, at_rest, probed
from tasks.gap.refits import (
    Refitted,
    as_simulated,
    by_contact,
    by_length,
    contenders,
    corrected_model,
    foretold_beside,
    least_worth,
    moved_on,
    part_way,
    refitted,
    replayed,
    searched,
    strengths_moved,
    taken_back,
    weighed_with,
)
from tasks.gap.replay import Replay, base_replays, mean, mean_normals, nearer, replayed_by
from tasks.gap.screening import Screened, compressed, ranked
from tasks.gap.verdict import TEMPER, told_apart, twins, with_replays
from tasks.side_by_side import side_by_side

LEADERS = 3  # contenders that are simulated: fewer would be compared with derivatives of the others
AGAIN = 4  # further simulations of whichever leads
SLACK = 1.0  # evidence that a further simulation may lose: it is found at the strength that was simulated, not foretold from another
PROMISING = 1.0  # log Bayes factor by replays, foretold, from which a first simulation takes the strength that they ask for too
SECOND = 3.0  # log Bayes factor, foretold, from which a second effect is simulated beside the leader: one of thirty, and rarer than a first
SECONDS = 2  # of these that are: derivatives do not tell a tilt beside drag from a wind in it
DOUBTFUL = 0.5  # doubt from which the fabric is fitted afresh with the leader in the model,
HARDLY = 0.1  # and from which a second cause is probed beside the leader
PROPOSED, HALF = 3, 0.5  # effects at most that come nearest at strengths that show, and the share of the nearest's gain that they have,
UNSURE = 0.3  # and the doubt from which as many again are simulated, whatever they gain
MATTERS = 6.0  # evidence behind the leader's from which a cause weighs less than a hundredth of it


class Trials:
    """What has been simulated so far. first: the model that the base refit began from; train: windows that the base could follow.

    quick: the leader once more at most; afresh only where lengths ask for a scale; no second cause. abreast: hypotheses that are simulated at
    a time, each from a thread of its own, which `run` must bear: of a single recording one replay would leave other cores idle.
    """

    def __init__(
        self,
        screened: Screened,
        first: Model,
        train: Gathered,
        effects: Sequence[Effect],
        run: Map,
        tell: Callable[[str], None],
        *,
        quick: bool,
        abreast: int = 1,
    ) -> None:
        self.screened, self.first, self.effects = screened, first, effects
        self.run, self.tell, self.quick, self.abreast = run, tell, quick, abreast
        self.train = train.only(e.prediction.window for e in screened.evidence)
        self.cosines = confusability(screened.windows, screened.windows.effects)
        self.alike = twins(self.cosines)
        self.after: dict[str, Refitted] = {}
        self.vetoed: frozenset[str] = frozenset()
        self._asked_afresh: set[str] = set()
        self.learnt: tuple[Fitted, ...] = ()  # single effects as windows kept out weigh them too, once they do
        self._weighed: set[str] = set()
        tell("replays")
        found = base_replays(screened.base.model, screened.windows.effects, self.train, run)
        self._told = mean_normals(found)
        self.base, self.replays = self._nearer_base(found)
        self.replayed = mean(self.replays)

    def _nearer_base(self, refitted: Sequence[Replay | None]) -> tuple[Model, Sequence[Replay | None]]:
        """The base in the fabric that windows and whole recordings together ask for, if replays come nearer so; else as it was refitted."""
        model = self.screened.base.model
        if self._told is None:
            return model, refitted
        asked = joint(self.screened.windows.base, self._told, mean(refitted))
        other = with_fabric(model, moved(model.subject.fabric, asked.base)[0])
        found = replayed_by(other, refitted, self.train, self.run)
        return (other, found) if nearer(found, refitted) else (model, refitted)

    def simulate(self, hypothesis: Fitted, start: Model | None = None) -> Refitted:
        """Refit and replay; start: the model that the hypothesis is linear about (default: the refitted base)."""
        self.tell(f"refit with {hypothesis.name}")
        first = self._first_of(hypothesis)
        found = refitted(self.screened, self.train, hypothesis, self.effects, start=start, beside=first, run=self.run)
        return replayed(found, self.replays, self.train, self.run, beside=first)

    def _first_of(self, hypothesis: Fitted) -> Refitted | None:
        """Of two causes the first alone, as it was simulated to the end."""
        first = hypothesis.effects[0].name
        return self.after[first] if len(hypothesis.effects) == 2 and self._stands(first) else None

    @property
    def singles(self) -> list[Fitted]:
        """Single effects as they weigh now."""
        return as_simulated(self.learnt or self.screened.hypotheses, self.after, self.alike)

    @property
    def leader(self) -> Fitted:
        """The strongest of them."""
        return max(self.singles, key=self._whole)

    def veto(self, effects: Sequence[Effect]) -> None:
        """These did not help on motion kept out, nor would their twins."""
        names = {e.name for e in effects}
        self.vetoed |= names | {n for pair in self.alike if pair & names for n in pair}

    def learn(self, kept: Gathered, before: Sequence[Evidence]) -> None:
        """Weigh single effects by further windows as well, all alike: those that were simulated, and matter, as they were simulated.

        before: the base's evidence of these windows, with the tangents of all effects.
        """
        s, strongest = self.screened, self._whole(self.leader)
        if not self.learnt:
            followed = [e for e in before if e.prediction.complete]
            windows = s.windows.beside(compressed(followed, s.prior, s.windows.effects, s.doubt))
            self.learnt = tuple(ranked(windows))
        for name, found in self.after.items():
            near = self._whole(found.hypothesis) > strongest - MATTERS
            if near and len(found.hypothesis.effects) == 1 and self._stands(name) and name not in self._weighed:
                self.after[name] = weighed_with(found, s, kept, before, self.run)
                self._weighed.add(name)

    def foretold(self) -> dict[str, tuple[Fitted, float]]:
        """name -> what windows and whole recordings together ask for, and its log Bayes factor by replays, as far as derivatives about the base tell."""
        return {} if self._told is None else {h.name: foretold(h, self._told, self.replayed) for h in self.screened.hypotheses}

    def settle(self) -> None:
        """Simulate the contenders and what probes propose, then whichever leads until it stands still, and a second cause beside it."""
        scaled = by_length(self.screened, self.train)
        by_derivatives = {h.name: h for h in self.screened.hypotheses}
        seen = scaled + by_contact(self.screened, self.train, self.effects, self.alike)
        missing = self.replayed.something_missing
        whole = self.foretold()
        promise = {name: support for name, (_, support) in whole.items()}

        def tried(h: Fitted) -> Refitted:
            if h in scaled:
                return self._stronger(self.simulate(by_derivatives[h.name]), self._afresh(h))
            together = h not in seen and promise.get(h.name, 0.0) > PROMISING
            return self.simulate(whole[h.name][0] if together else h)

        self._all(tried, contenders(self.screened.hypotheses, seen, LEADERS, self.alike, missing, promise))
        probes = [] if self.quick else self._probed(self._base, self.train, self.effects)
        self._from_probes(self._unknown(near(probes)))
        self._until_it_stands_still()
        if not self.quick:
            self._beside_and_beyond(probes)

    def _beside_and_beyond(self, probes: Sequence[Probe]) -> None:
        """Simulate second causes beside the leader, and further probes where even so much is left."""
        leader = self.leader.name
        self._with_seconds()
        if self.doubt(self.pairs()) > HARDLY:
            self._with_probed_seconds()
        if self.doubt(self.pairs()) > UNSURE:
            self._from_probes(self._unknown(probes)[:PROPOSED])
            if self.leader.name != leader:
                self._until_it_stands_still()
                self._with_seconds()

    def _all(self, simulated: Callable[[Fitted], Refitted], hypotheses: Sequence[Fitted]) -> None:
        """Simulate hypotheses that do not go by one another."""
        found = side_by_side(simulated, hypotheses, self.abreast)
        self.after.update(zip((h.name for h in hypotheses), found, strict=True))

    def _until_it_stands_still(self) -> None:
        """Simulate whichever leads, as long as it moves or was not simulated; once afresh, if it leaves much."""
        for _ in range(1 if self.quick else AGAIN):
            leader = self.leader
            now = self.after.get(leader.name)
            if now is None and leader.evidence < least_worth(self.replayed.something_missing):
                return
            if not self.quick and leader.name not in self._asked_afresh and self.doubt() > DOUBTFUL:
                other = self._afresh(leader)
                self.after[leader.name] = other if now is None else self._stronger(now, other)
            elif now is None:
                self.after[leader.name] = self.simulate(leader)
            elif now.windows is not None and moved_on(now):
                further = self.after[leader.name] = self._further(now)
                gain = self._whole(further.hypothesis) - self._whole(now.hypothesis)
                if gain < SLACK and not strengths_moved(further):  # a fabric that windows hardly know may wander on and on
                    return
            else:
                return

    def _stronger(self, one: Refitted, other: Refitted) -> Refitted:
        """Which of two simulations of one hypothesis weighs more; one that can be followed, if only one can."""
        return max(one, other, key=lambda r: (r.windows is not None, self._whole(r.hypothesis)))

    def _further(self, now: Refitted) -> Refitted:
        """Simulated where its last step led, or half-way where it weighs less there, if not `quick`; if there too, or where it cannot be
        followed so far, what was simulated before, without that step.
        """
        for share in (1.0,) if self.quick else (1.0, 0.5):
            found = self.simulate(part_way(now, share), now.model)
            if found.windows is None:
                break
            if self._whole(found.hypothesis) > self._whole(now.hypothesis) - SLACK:
                return found
        return taken_back(now, self.replays, beside=self._first_of(now.hypothesis))

    def _whole(self, h: Fitted) -> float:
        """Evidence with what replays say in it."""
        return with_replays(self.replayed.something_missing, self.vetoed)(h)

    @property
    def _base(self) -> BaseFit:
        """The refitted base in the windows that it could follow."""
        return replace(self.screened.base, evidence=self.screened.evidence)

    def _probed(self, about: BaseFit, data: Gathered, effects: Sequence[Effect]) -> list[Probe]:
        self.tell("probes")
        return probed(about, data, effects, self.alike, self.run)

    def _from_probes(self, probes: Sequence[Probe]) -> None:
        """Simulate them from where base and strength come to rest."""
        about = {p.effect.name: at_rest(self._base, self.train, p, self.run) for p in probes}
        hypotheses = [at_strengths_of(h, about[h.name]) for h in self.screened.hypotheses if h.name in about]
        self._all(lambda h: self.simulate(h, about[h.name]), hypotheses)

    def _unknown(self, probes: Sequence[Probe]) -> list[Probe]:
        """Those of effects of which neither they nor a twin was simulated."""
        return [probe for probe in probes if told_apart(probe.effect.name, self.after, self.alike)]

    def _with_probed_seconds(self) -> None:
        """Simulate second effects that come nearest beside the leader at strengths that show, where none was by derivatives."""
        first = self.after.get(self.leader.name)
        if first is None or first.windows is None:
            return
        followed = tuple(e for e in first.evidence if e.prediction.complete)
        about = replace(self._base, model=corrected_model(first), evidence=followed)
        data = restarted(about.model, self.train, self.run)
        pairs = {pair.effects[1].name: pair for pair in self.pairs()}
        known = [first.hypothesis.name, *(second for second, pair in pairs.items() if pair.name in self.after)]
        probes = self._probed(about, data, [e for e in self.effects if e.name in pairs and told_apart(e.name, known, self.alike)])
        models = {pairs[p.effect.name].name: at_rest(about, data, p, self.run) for p in near(probes)[:SECONDS]}
        asked = [at_strengths_of(pair, models[pair.name]) for pair in pairs.values() if pair.name in models]
        self._all(lambda pair: self._moved_once(self.simulate(pair, models[pair.name])), asked)

    def _moved_once(self, found: Refitted) -> Refitted:
        """Simulated once more where its strengths moved."""
        return self._further(found) if found.windows is not None and strengths_moved(found) else found

    def _with_seconds(self) -> None:
        """Simulate the likeliest second effects beside the leader, of those that windows and whole recordings together promise; of twins one."""
        first = self.after.get(self.leader.name)
        asked = [(pair, *foretold_beside(first, pair)) for pair in self.pairs()]
        promise = {pair.name: pair.weights[1].evidence + max(support, 0.0) / TEMPER for pair, _, support in asked}
        chosen: dict[str, Fitted] = {}
        for pair, both, support in sorted(asked, key=lambda each: -promise[each[0].name]):
            second = pair.effects[1].name
            if promise[pair.name] > SECOND and len(chosen) < SECONDS and told_apart(second, chosen, self.alike):
                chosen[second] = both if support > PROMISING else pair

        self._all(lambda pair: self._moved_once(self.simulate(pair, first.model)), list(chosen.values()))

    def _afresh(self, hypothesis: Fitted) -> Refitted:
        """Simulated in the fabric that is found with it in the model from the first round on."""
        self._asked_afresh.add(hypothesis.name)
        self.tell(f"fabric afresh with {hypothesis.name}")
        return self.simulate(*afresh(self.screened, self.first, self.train, hypothesis, self.run))

    def nested_base(self) -> Model | None:
        """The base that the leader's fabric leads to, if it comes nearer than the one that all was weighed about; None of a quick diagnosis."""
        now = self.after.get(self.leader.name)
        if self.quick or now is None or now.windows is None:
            return None
        self.tell(f"base in the fabric of {now.hypothesis.name}")
        return nested_base(self.screened.base, self.train, corrected_model(now).subject.fabric, self.run)

    def pairs(self) -> tuple[Fitted, ...]:
        """Second effects beside the leader, if it was simulated; as simulated where they were too."""
        leader = self.leader
        found = searched(self.after[leader.name]) if leader.name in self.after and not self.quick else ()
        return tuple(self.after[pair.name].hypothesis if self._stands(pair.name) else pair for pair in found)

    def _stands(self, name: str) -> bool:
        """Whether it was simulated, to the end."""
        return name in self.after and self.after[name].windows is not None

    def doubt(self, pairs: Sequence[Fitted] = ()) -> float:
        """The doubt that the hypothesis of most evidence leaves, in windows and over whole recordings."""
        best = max((self.screened.windows.base, *self.singles, *pairs), key=with_replays(0.0, self.vetoed))
        simulated = next((self.after[name] for name in (best.name, *(e.name for e in best.effects[:1])) if self._stands(name)), None)
        left = self.replayed if simulated is None or not np.isfinite(simulated.replayed.gap) else simulated.replayed
        return unexplained(self.screened, best, simulated, floor_mm(self.screened.evidence, self.train.recordings), left.ratio2)


def near(probes: Sequence[Probe]) -> list[Probe]:
    """Those that gain nearly as much as the nearest."""
    return [probe for probe in probes[:PROPOSED] if probe.nearer > HALF * probes[0].nearer]


def at_strengths_of(hypothesis: Fitted, model: Model) -> Fitted:
    """The hypothesis at the strengths that a model has, in whose fabric."""
    return replace(hypothesis, base=np.zeros_like(hypothesis.base), strengths=model.by_column(hypothesis.effects))
