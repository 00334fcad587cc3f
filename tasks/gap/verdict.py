"""From weighed hypotheses to a verdict: a class of effects, none, outside the library, or not testable; with probabilities.

Posterior weights beside 1 for "none": B π_e exp(T E_e) of a single effect with evidence E_e, B π_e π_f exp(T (E_e + E_f|e)) of the pair
that a second effect f makes with the leading one; B says what whole recordings make of it, replayed with the effect where it was simulated
and else that anything is missing (`replay.py`); a second effect that was simulated has what replays of both say beyond those of the first.
The temper T < 1 says how far evidence from simulations of a simulation may be trusted, and no evidence excludes an
effect by more than `EXCLUDED`: where the model errs in other ways, it errs about what is absent too. Effects within `TOGETHER` of the
leader's evidence, and those whose signatures are its own up to strength (|cos| ≥ `ALIKE`), form its class: this recording cannot tell them
apart. Those within as much of the second one form the second's.

"Outside the library" takes the place of "none", times B, by the doubt u that the best hypothesis leaves (`library_doubt.py`). A cause in
the library leaves nothing; by itself it weighs 1 − (1 − `OTHERWISE`) u of that. What motion kept out has vetoed (`confirmation.py`) has no
evidence, less `VETO`.

Source: Bayesian model comparison (Kass & Raftery 1995); answer sets as in error-domain model falsification (Goulet & Smith 2013). The
constants are chosen on open cases (README).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tasks.gap.confusability import Confusability
from tasks.gap.hypotheses import Fitted

Kind = Literal["effect", "none", "outside_library", "not_testable"]
Twins = frozenset[frozenset[str]]

SINGLE, PAIR = 1.0, 0.3  # prior weight of all singles, and of a second effect beside a first one, beside 1 for none
TEMPER = 0.8
EXCLUDED = 5.0  # of evidence against an effect
VETO = 4.6  # against an effect that does not help on motion kept out: a hundredth
BESIDE = 0.15  # weight of "outside the library" beside a named effect that leaves everything unexplained
OTHERWISE = 0.2  # weight of a cause that leaves everything unexplained, beside one that leaves nothing
TOGETHER = 1.5  # difference of evidence up to which names form a class
ALIKE = 0.97  # cosine of signatures from which they do whatever their strengths
LARGEST_CLASS = 4
SHARED = 0.9  # probability that an answer set must hold


@dataclass(frozen=True)
class Candidate:
    """Names that cannot be told apart, or a compound; their probability, the fitted hypothesis of the first, and those of the others."""

    names: tuple[str, ...]
    probability: float
    fitted: Fitted | None = None
    others: tuple[Fitted, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """kind; the named hypothesis; class of each of its effects; probability; candidates, likeliest first (always with none and
    outside_library, sum 1).

    Where motion kept out speaks against what leads, or cannot speak, the first candidate is not what is said.
    """

    kind: Kind
    named: Fitted | None
    classes: tuple[tuple[str, ...], ...]
    probability: float
    ranking: tuple[Candidate, ...]
    reason: str = ""

    @property
    def answer_set(self) -> list[str]:
        """Names that together hold 90 % of the probability."""
        names, total = [], 0.0
        for candidate in self.ranking:
            names += [n for n in candidate.names if n not in names]
            total += candidate.probability
            if total >= SHARED:
                break
        return names


def judge(
    singles: Sequence[Fitted],
    pairs: Sequence[Fitted] = (),
    *,
    unexplained: float,
    missing: float = 0.0,
    cosines: Confusability | None = None,
    vetoed: frozenset[str] = frozenset(),
) -> Verdict:
    """Weigh single effects, and pairs of which the first effect is that of the leading single. unexplained: share in 0..1 of doubt that
    anything in the library is the cause; missing: log Bayes factor that anything is; cosines: of the signatures of the effects weighed;
    vetoed: effects that did not help on motion kept out, which are not named and weigh at most a hundredth of their prior.
    """
    whole = with_replays(missing, vetoed)
    ranked = sorted(singles, key=whole, reverse=True)
    sole = 1.0 - (1.0 - OTHERWISE) * unexplained
    seconds = [p for p in pairs if p.effects[0] == ranked[0].effects[0] and not vetoed & {e.name for e in p.effects}]
    further = _beside_first(ranked[0])
    seconds.sort(key=lambda p: -further(p))
    single = [TEMPER * whole(h) for h in ranked]
    double = [single[0] + TEMPER * further(p) for p in seconds]
    most = max(0.0, missing, single[0], *double[:1])  # of exponents: the exponential of a thousand is no number
    weight = [sole * SINGLE / len(ranked) * float(np.exp(e - most)) for e in single]
    doubled = [PAIR / len(ranked) * sole * SINGLE / len(ranked) * float(np.exp(e - most)) for e in double]
    named = sum(weight) + sum(doubled[:1])
    none, outside = (1.0 - unexplained) * np.exp(-most), unexplained * (np.exp(missing - most) + BESIDE * named)
    total = none + outside + named
    candidates = [Candidate(("none",), none / total), Candidate(("outside_library",), outside / total)]
    alike = twins(cosines)
    candidates += _classes(ranked, weight, total, alike, whole)
    if doubled:
        both = _no_larger(_beside(ranked, whole, 0, alike), _beside(seconds, further, 1, alike))
        names = tuple(dict.fromkeys(n for c in both for n in c))
        candidates.append(Candidate(names, doubled[0] / total, seconds[0]))
    candidates.sort(key=lambda c: -c.probability)
    first = candidates[0]
    if first.fitted is None:
        return _unnamed(first, candidates)
    classes = both if len(first.fitted.effects) == 2 else (first.names,)
    return Verdict("effect", first.fitted, classes, first.probability, tuple(candidates))


def with_replays(missing: float, vetoed: frozenset[str] = frozenset()) -> Callable[[Fitted], float]:
    """Evidence of a hypothesis with what replays say in it, its own if it was simulated, else that anything is missing; those are not
    tempered. What motion kept out vetoes has no evidence for it: that it fitted was a coincidence.
    """

    def evidence(h: Fitted) -> float:
        whole = max(h.evidence, -EXCLUDED) + (missing if h.support is None else h.support) / TEMPER
        return min(whole, 0.0) - VETO / TEMPER if vetoed & {e.name for e in h.effects} else whole

    return evidence


def _beside_first(first: Fitted) -> Callable[[Fitted], float]:
    """Evidence of the second effect of a pair beside the first alone, with what replays say in it, if both were simulated."""

    def evidence(pair: Fitted) -> float:
        replays = 0.0 if pair.support is None or first.support is None else pair.support - first.support
        return pair.weights[1].evidence + replays / TEMPER

    return evidence


def _unnamed(said: Candidate, candidates: Sequence[Candidate]) -> Verdict:
    kind: Kind = "none" if said.names == ("none",) else "outside_library"
    return Verdict(kind, None, (), said.probability, tuple(candidates))


def _classes(
    ranked: Sequence[Fitted], weight: Sequence[float], total: float, alike: Twins, evidence: Callable[[Fitted], float]
) -> list[Candidate]:
    """Single effects in the order of their evidence, those that cannot be told from the first of each class joined."""
    found, left = [], dict(zip((h.name for h in ranked), zip(ranked, weight, strict=True), strict=True))
    while left:
        names = _beside([h for h, _ in left.values()], evidence, 0, alike)
        own = [left.pop(name) for name in names]
        found.append(Candidate(names, sum(w for _, w in own) / total, own[0][0], tuple(h for h, _ in own[1:])))
    return sorted(found, key=lambda c: -c.probability)


def _beside(hypotheses: Sequence[Fitted], evidence: Callable[[Fitted], float], place: int, alike: Twins) -> tuple[str, ...]:
    """Names at `place` of the first hypothesis, of its twins, and of those within `TOGETHER` of it."""
    first = hypotheses[0].effects[place].name
    twins = [h for h in hypotheses if frozenset((first, h.effects[place].name)) in alike]
    near = [h for h in hypotheses if h not in twins and evidence(hypotheses[0]) - evidence(h) < TOGETHER]
    return tuple(dict.fromkeys(h.effects[place].name for h in (hypotheses[0], *twins, *near)))[:LARGEST_CLASS]


def _no_larger(one: tuple[str, ...], other: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Classes of two causes, less the last of the longer one as long as there are more than `LARGEST_CLASS` names in all."""
    while len({*one, *other}) > LARGEST_CLASS:
        one, other = (one[:-1], other) if len(one) >= len(other) else (one, other[:-1])
    return one, other


def twins(cosines: Confusability | None) -> Twins:
    """Pairs of names whose signatures are the same up to strength, whichever their components."""
    if cosines is None:
        return frozenset()
    i, j = np.nonzero(np.triu(np.abs(cosines.least) >= ALIKE, 1))
    return frozenset(frozenset((cosines.names[a], cosines.names[b])) for a, b in zip(i, j, strict=True))


def told_apart(name: str, others: Iterable[str], alike: Twins) -> bool:
    """Whether it is none of the others, nor a twin of any."""
    return all(name != other and frozenset((name, other)) not in alike for other in others)


def first_alone(verdict: Verdict, alone: Fitted) -> Verdict:
    """Of two named causes the first: the second did not help on motion kept out, and what both weighed is the first's."""
    own = [c for c in verdict.ranking if c.fitted is not None and c.fitted.effects == alone.effects]
    names, others = (own[0].names, own[0].others) if own else ((alone.name,), ())
    rest = [c for c in verdict.ranking if c is not verdict.ranking[0] and c not in own]
    first = Candidate(names, verdict.probability + sum(c.probability for c in own), alone, others)
    ranking = sorted([first, *rest], key=lambda c: -c.probability)
    return Verdict("effect", alone, (names,), first.probability, tuple(ranking))


def abstained(verdict: Verdict) -> Verdict:
    """None, or outside the library, whichever is likelier, whatever else leads the ranking."""
    return _unnamed(next(c for c in verdict.ranking if c.fitted is None), verdict.ranking)


def nothing_needed(verdict: Verdict) -> Verdict:
    """None, whatever leads the ranking: there was nothing to explain."""
    return _unnamed(next(c for c in verdict.ranking if c.names == ("none",)), verdict.ranking)
