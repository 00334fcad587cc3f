"""What each of several causes takes from the misfit: Shapley values over the named effects.

    φ_i = Σ_{S ∌ i}  |S|! (n − |S| − 1)! / n!  ·  (v(S ∪ i) − v(S)),    v(S) = Σ_w (J_w(base) − J_w(S))

J_w is the misfit of a window by strengths fitted on the others: about the simulation of just those effects where there was one, else as far
as derivatives about the base tell. The shares add up to what all of them take together. A share may be negative: an effect that helps only
beside another one.

Source: Shapley 1953.
"""

from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations
from math import factorial

from tasks.effects.effect import Effect
from tasks.gap.hypotheses import Fitted, Windows

Set = frozenset[str]


def shapley(players: Sequence[str], value: Callable[[Set], float]) -> dict[str, float]:
    """player -> φ."""
    v, n = cache(value), len(players)
    found = {}
    for player in players:
        others = [p for p in players if p != player]
        coalitions = [frozenset(s) for k in range(n) for s in combinations(others, k)]
        found[player] = sum(factorial(len(s)) * factorial(n - len(s) - 1) / factorial(n) * (v(s | {player}) - v(s)) for s in coalitions)
    return found


def misfit_taken(windows: Windows, named: Fitted, simulated: Sequence[Fitted] = ()) -> dict[str, float]:
    """name -> what the effect takes from the windows' misfit, of Σ J_w. simulated: others that were; those that could not be followed in all
    windows do not count.
    """
    known = {_names(h.effects): h for h in (*simulated, named) if len(h.misfits) == len(windows)}
    effects = {e.name: e for e in named.effects}

    def taken(names: Set) -> float:
        if not names:
            return 0.0
        found = known[names] if names in known else windows.fit([e for name, e in effects.items() if name in names])
        return float((windows.base.misfits - found.misfits).sum())

    return shapley(list(effects), taken)


def _names(effects: Sequence[Effect]) -> Set:
    return frozenset(e.name for e in effects)
