"""Independent answers for small searches: expectimax on beliefs, and all orders of looks."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np

from planner.search.pomdp import Pomdp
from planner.search.search_problem import SearchProblem


def expectimax(pomdp: Pomdp, steps: int) -> float:
    """The highest expected reward within some steps, by trying all of them."""

    @cache
    def value(belief: tuple[float, ...], left: int) -> float:
        if left == 0:
            return -1e9 if belief[-1] < 1 else 0.0  # the last state is the end
        if belief[-1] == 1:
            return 0.0
        here, best = np.array(belief), -np.inf
        for a in range(len(pomdp.actions)):
            total = sum(p * pomdp.rewards[a, s] for s, p in enumerate(belief) if p)
            after = sum(p * pomdp.transitions[a, s] for s, p in enumerate(here) if p)
            for o in range(len(pomdp.observations)):
                joint = after * pomdp.likelihoods[a, :, o]
                if joint.sum() > 1e-12:
                    next_ = tuple(np.round(joint / joint.sum(), 10))
                    total += pomdp.discount * joint.sum() * value(next_, left - 1)
            best = max(best, total)
        return best

    return value(tuple(np.round(pomdp.start, 10)), steps)


def best_order(problem: SearchProblem, belief: np.ndarray, looks: int) -> float:
    """The lowest cost of a search for one object that is never seen where it is not.

    It tries all orders of up to some looks, and adds up what follows from each true spot.
    """
    viewpoints = range(len(problem.viewpoints))
    best = np.inf
    for length in range(looks + 1):
        for order in itertools.product(viewpoints, repeat=length):
            unseen, spent, cost, open_, here = belief[0].copy(), 0.0, 0.0, set(), None
            for v in order:
                spent += problem.start[v] if here is None else problem.travel[here, v]
                spent += problem.look + (0 if v in open_ else problem.opening[v])
                open_.add(v)
                here = v
                for spot in range(len(unseen)):
                    seen = problem.hit[0] * problem.visible[v, spot]
                    cost += unseen[spot] * seen * spent
                    unseen[spot] *= 1 - seen
            places = [
                sum(u for u, p in zip(unseen, problem.place_of, strict=True) if p == k)
                for k in range(len(problem.places))
            ]
            end = problem.wrong * (sum(places) - max(places))
            if problem.missed is not None:
                end = min(end, problem.missed * sum(places))
            cost += sum(places) * spent + end
            best = min(best, cost)
    return best
