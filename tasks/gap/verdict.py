"""From scored hypotheses to a verdict: a class of effects, none, outside the library, or not testable; with probabilities.

The leading effect is weighed against "none" by its own likelihood ratio L, and against every other effect by the ratio of the paired
differences of their gains, so that effects which help in the same windows by the same amount share the probability; no effect weighs more than
its own L against "none". Those that the recording
cannot tell from the leader form its class. A second effect is added when it lowers the misfit of windows that the first one leaves.

"Outside the library" is what is left when the misfit is large beside noise and discretisation and no effect takes most of it away.

Source: gap budget and answer sets as in error-domain model falsification (Goulet & Smith 2013). The constants are calibrated on open cases.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tasks.gap.hypotheses import Fitted, likelihood_ratio

Array = NDArray[np.float64]
Kind = Literal["effect", "none", "outside_library", "not_testable"]

SINGLE, PAIR = 0.5, 0.1  # prior weight of all singles, and of a second effect, beside 1 for none
FACTOR = 3.0
BESIDE = 0.25  # weight of "outside the library" beside a named effect that leaves everything unexplained
TOGETHER = 1.5  # effects whose likelihoods differ by less than e^this form a class
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
    """kind; the named hypothesis; class of each of its effects; probability; candidates (always with none and outside_library, sum 1)."""

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


@dataclass(frozen=True)
class Search:
    """What was found about a named effect's simulation: the effect alone, and with each second one."""

    alone: Fitted
    pairs: tuple[Fitted, ...]


def judge(hypotheses: Sequence[Fitted], *, unexplained: float, search: Search | None = None) -> Verdict:
    """Weigh hypotheses (singles and pairs). unexplained: share in 0..1 of doubt that anything in the library is the cause.

    search: pairs about the simulation with the leading effect, which then replace those of `hypotheses`.
    """
    singles = [h for h in hypotheses if len(h.effects) == 1]
    leader = max(singles, key=lambda h: (h.score + plausibility(h), h.gains.mean()))
    behind = {h.effects[0].name: max(likelihood_ratio(leader.gains - h.gains), leader.score - h.score) for h in singles}
    prior = np.log(SINGLE / len(singles))
    fitted = {h.effects[0].name: h for h in singles}
    weight = {name: np.exp(prior + leader.score - lost + plausibility(fitted[name])) for name, lost in behind.items()}
    if search is None or search.alone.effects != leader.effects:
        search = Search(leader, tuple(h for h in hypotheses if len(h.effects) == 2 and leader.effects[0] in h.effects))
    second = _second(leader, search, len(singles))
    named = sum(weight.values()) + (second[1] if second else 0.0)
    none, outside = 1.0 - unexplained, unexplained * (1.0 + BESIDE * named)
    total = none + outside + named
    ranking = [Candidate(("none",), none / total), Candidate(("outside_library",), outside / total)]
    ranking += _classes(weight, behind, fitted, total)
    if second:
        ranking.append(Candidate(tuple(e.name for e in second[0].effects), second[1] / total, second[0]))
    ranking = sorted(ranking, key=lambda c: -c.probability)
    return _verdict(ranking, behind, second)


def plausibility(fitted: Fitted) -> float:
    """Log prior of the strengths: log-normal about the typical ones, a factor of `FACTOR` being one standard deviation.

    A cause of a hundredth of its usual strength is more often the mesh, the tracker or a rounding of the pattern.
    """
    total = 0.0
    for effect in fitted.effects:
        share = float(np.linalg.norm(fitted.θ(effect) / effect.typical)) / np.sqrt(len(effect.strengths))
        total -= 0.5 * (np.log(max(share, 1e-6)) / np.log(FACTOR)) ** 2
    return total


def _classes(weight: dict[str, float], behind: dict[str, float], fitted: dict[str, Fitted], total: float) -> list[Candidate]:
    """Effects in the order of their weight, neighbours within `TOGETHER` of the first of each class joined."""
    left, found = sorted(weight, key=lambda n: -weight[n]), []
    while left:
        own = [n for n in left if behind[n] - behind[left[0]] < TOGETHER][:LARGEST_CLASS]
        found.append(Candidate(tuple(own), sum(weight[n] for n in own) / total, fitted[own[0]], tuple(fitted[n] for n in own[1:])))
        left = [n for n in left if n not in own]
    return found


def _second(leader: Fitted, search: Search, count: int) -> tuple[Fitted, float] | None:
    """The pair that adds most to the leader, and its weight beside none."""
    if not search.pairs:
        return None
    gain = {p.name: likelihood_ratio(p.gains - search.alone.gains) + plausibility(p) for p in search.pairs}
    best = max(search.pairs, key=lambda p: gain[p.name])
    return best, float(np.exp(np.log(SINGLE / count) + leader.score + np.log(PAIR / count) + gain[best.name]))


def _verdict(ranking: Sequence[Candidate], behind: dict[str, float], second: tuple[Fitted, float] | None) -> Verdict:
    first = ranking[0]
    if first.names in (("none",), ("outside_library",)):
        return Verdict("none" if first.names == ("none",) else "outside_library", None, (), first.probability, tuple(ranking))
    compound = second is not None and first.fitted is second[0]
    classes = tuple((e.name,) for e in first.fitted.effects) if compound else (first.names,)
    return Verdict("effect", first.fitted, classes, first.probability, tuple(ranking))


def withdrawn(verdict: Verdict, reason: str) -> Verdict:
    """None instead of the named effect, which did not help on motion kept out: its class keeps a tenth of its weight."""
    own = {n for c in verdict.classes for n in c}
    weights = [c.probability * (0.1 if own & set(c.names) else 1.0) for c in verdict.ranking]
    ranking = [replace(c, probability=w / sum(weights)) for c, w in zip(verdict.ranking, weights, strict=True)]
    ranking = sorted(ranking, key=lambda c: (c.names != ("none",), -c.probability))
    return Verdict("none", None, (), ranking[0].probability, tuple(ranking), reason)
