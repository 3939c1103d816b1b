"""The next step of a search of any size: plan a tour of viewpoints, make its first step, repeat.

Until an object is seen, a tour is a fixed order of looks, and what it costs follows from products
of arrays: how long the objects probably stay unseen, and what to declare at its end. The best tour
is found greedily and improved by moving and exchanging its viewpoints. Where few answers are
possible, the next looks are also expanded answer by answer, with tours at their ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from planner.search.search_problem import NOT_SEEN, SearchProblem
from semmap.arrays import Floats

VOTES = ((1, 1), (2, 2), (4, 3))
"""Numbers of looks from one viewpoint, and how many must show an object until it is declared."""

LONGEST = 30  # stops of a tour, at most
ROUNDS = 6  # improvements of a tour, at most
BUDGET = 2e6  # values in the arrays of one round of improvements
MOST_OPTIONS = 6  # ways to go on that are expanded answer by answer, the best first
LEAST = 40  # viewpoints that are tried as the next one, at least
LEAVES = 40  # beliefs that are expanded answer by answer


@dataclass(frozen=True)
class Option:
    """One way to go on: the viewpoint to look from first, or None to end now."""

    viewpoint: int | None
    seconds: float  # until that look ends
    chance: float  # that it shows an object not declared yet
    cost: float  # expected seconds of the search, with what wrong and missed objects cost


@dataclass(frozen=True)
class Decision:
    """The next step, where, and why: the ways to go on, the best first.

    To give up is to end without the place of any object: none is believed enough, and no look is
    worth its time.
    """

    action: Literal["go", "open", "look", "declare", "give up"]
    viewpoint: int | None  # where to go next, by its number; None to end now
    options: tuple[Option, ...]  # the best first
    tour: tuple[int, ...] = ()  # the viewpoints of the search while nothing is found

    @property
    def cost(self) -> float:
        """Expected seconds of the rest, with what wrong and missed objects cost."""
        return self.options[0].cost


def decide(
    problem: SearchProblem,
    belief: Floats,
    at: int | None = None,
    opened: frozenset[int] = frozenset(),
    *,
    depth: int | None = None,
    rounds: int = ROUNDS,
) -> Decision:
    """The next step of a search.

    Parameters
    ----------
    belief : (O, S) float64
        P(spot) of each object; rows sum to 1.
    at
        Number of the viewpoint at which the robot is; None: where `problem.start` counts from.
    opened
        The viewpoints whose container is open.
    depth
        Number of looks that are expanded answer by answer; by default as many as stay quick.
    rounds
        Most improvements of the tour.

    Returns
    -------
    Decision
        Its `cost` is that of a plan that can be carried out, if no object hides another.
    """
    options, tours = _options(problem, belief, at, opened, rounds)
    depth = _affordable(problem, options) if depth is None else depth
    if depth > 0:
        options = _expanded(problem, belief, at, opened, options, depth)
    best = options[0].viewpoint
    if best is None:
        found = any(place is not None for place in problem.declared(belief)[0])
        return Decision("declare" if found else "give up", None, tuple(options))
    if best != at:
        return Decision("go", best, tuple(options), tours[best])
    shut = problem.opening[best] > 0 and best not in opened
    return Decision("open" if shut else "look", best, tuple(options), tours[best])


def cheapest(searches: Sequence[tuple[SearchProblem, Floats]]) -> int:
    """The number of the search that costs least, of problems with their beliefs (O, S).

    All are compared with the largest costs of a missed and of a wrong object among them: a search
    that is worth little to its own problem would seem cheap.
    """
    missed = [problem.missed for problem, _ in searches if problem.missed is not None]
    wrong = max(problem.wrong for problem, _ in searches)
    costs = [
        decide(replace(problem, missed=max(missed, default=None), wrong=wrong), belief).cost
        for problem, belief in searches
    ]
    return costs.index(min(costs))


def tour_seconds(problem: SearchProblem, belief: Floats, tour: Sequence[int]) -> float:
    """The expected seconds of a tour, which ends when an object is found: no cost of answers."""
    if not tour:
        return 0.0
    order = np.array([tour], np.intp)
    tours, timed = (
        _Tours(each, belief, None, frozenset())
        for each in (problem, replace(problem, wrong=0.0, missed=None))
    )
    looks = min(
        _all_looks(problem, belief), key=lambda looks: float(tours.totals(looks, order)[0, -1])
    )
    return float(timed.totals(looks, order)[0, -1])


def _affordable(problem: SearchProblem, options: Sequence[Option]) -> int:
    """How many looks can be expanded: none where an answer can only be true or missing."""
    if not problem.false_alarm.any() and len(problem.objects) == 1:
        return 0  # then the tour is the best plan already
    stops = min(len(options), MOST_OPTIONS)
    most = max(int(problem.in_view.sum(axis=1).max(initial=0)), 1)
    branches = stops * float(1 + most) ** len(problem.objects)
    return 2 if branches**2 <= LEAVES else int(branches <= LEAVES)


def _expanded(
    problem: SearchProblem,
    belief: Floats,
    at: int | None,
    opened: frozenset[int],
    options: Sequence[Option],
    depth: int,
) -> list[Option]:
    """The options with the costs that follow if each answer of the next looks is decided upon."""
    found = []
    for option in options[:MOST_OPTIONS]:
        if option.viewpoint is None:
            found.append(option)
            continue
        cost = option.seconds
        then = opened | {option.viewpoint}
        for seen, chance in _joint_outcomes(problem, belief, option.viewpoint):
            after = problem.after(belief, option.viewpoint, seen)
            if depth > 1:
                further, _ = _options(problem, after, option.viewpoint, then)
                further = _expanded(problem, after, option.viewpoint, then, further, depth - 1)
                cost += chance * further[0].cost
            else:
                cost += chance * _Tours(problem, after, option.viewpoint, then).first()[0]
        found.append(Option(option.viewpoint, option.seconds, option.chance, cost))
    return sorted(found, key=lambda o: o.cost)


def _joint_outcomes(
    problem: SearchProblem, belief: Floats, viewpoint: int
) -> list[tuple[tuple[int, ...], float]]:
    """The answers of a look that are possible, each with its probability."""
    chances = np.einsum("os,osp->op", belief, problem.answers(belief, viewpoint))
    places = [*range(len(problem.places)), NOT_SEEN]
    possible = [[p for p, c in zip(places, row, strict=True) if c > 1e-9] for row in chances]
    outcomes = [
        (seen, float(np.prod([chances[i, p] for i, p in enumerate(seen)])))
        for seen in product(*possible)
    ]
    return [(seen, chance) for seen, chance in outcomes if chance > 1e-6]


@dataclass(frozen=True)
class _Looks:
    """What each viewpoint does to the unnormalised belief of objects that are not declared yet."""

    unseen: Floats  # (V, O, S) P(not declared at a stop | spot)
    falsely: Floats  # (V, O, S) P(declared in another place than it is | spot)
    seconds: float  # of a stop


def _options(
    problem: SearchProblem,
    belief: Floats,
    at: int | None,
    opened: frozenset[int],
    rounds: int = ROUNDS,
) -> tuple[list[Option], dict[int, tuple[int, ...]]]:
    """All ways to go on by their costs, and the tour of each viewpoint that is the first."""
    declared = Option(None, 0.0, 0.0, problem.declared(belief)[1])
    tours = _Tours(problem, belief, at, opened)
    if not tours.usable.any():
        return [declared], {}
    _, looks, order = tours.first()
    order, cost = tours.improve(looks, order, rounds)
    promising = tours.promising(BUDGET / (belief.size * (len(order) + 1)))
    firsts = np.union1d(promising, order[:1])
    # each viewpoint first, then the best tour without it
    each = np.full((len(firsts), len(order) + 1), -1, np.intp)
    for row, first in enumerate(firsts):
        rest = order.tolist()
        if first in rest:
            rest.remove(first)
        each[row, : len(rest) + 1] = [first, *rest]
    each = each[:, : max(LONGEST, 1)]  # one more look is not better than a tour that is cut
    totals = tours.totals(looks, each)[:, 1:]
    costs, ends = totals.min(axis=1), totals.argmin(axis=1) + 1
    along = {int(row[0]): tuple(row[:end].tolist()) for row, end in zip(each, ends, strict=True)}
    if len(order):
        costs[firsts == order[0]] = np.minimum(cost, costs[firsts == order[0]])
        along[int(order[0])] = tuple(order.tolist())
    chances, seconds = tours.chances[firsts].tolist(), tours.seconds[firsts].tolist()
    options = [declared]
    options += map(Option, firsts.tolist(), seconds, chances, costs.tolist())
    options.sort(key=lambda o: (o.cost, o.viewpoint is not None))
    return options, along


def _all_looks(problem: SearchProblem, belief: Floats) -> list[_Looks]:
    """The looks for each number of votes; kept with the problem where no object hides another."""
    if problem.shows is None and "looks" in problem.memory:
        kept: list[_Looks] = problem.memory["looks"]
        return kept
    votes = VOTES if problem.false_alarm.any() else VOTES[:1]
    problem.memory["looks"] = made = [_looks(problem, belief, n, k) for n, k in votes]
    return made


def _looks(problem: SearchProblem, belief: Floats, looks: int, needed: int) -> _Looks:
    """A stop with a number of looks, of which some must show the object."""
    seen = np.stack([problem.detection(belief, v) for v in range(len(problem.viewpoints))])
    shown = problem.in_view  # (V, P)
    count = shown.sum(axis=1)
    here = shown[:, problem.place_of]  # (V, S)
    alarm = problem.false_alarm[None, :, None] * (count > 0)[:, None, None]
    by_chance = (1 - seen) * alarm
    to_it = by_chance * (here / np.maximum(count, 1)[:, None])[:, None]
    right = _at_least(looks, needed, np.clip(seen + to_it, 0, 1))
    wrong = _at_least(looks, needed, np.clip(by_chance - to_it, 0, 1))
    return _Looks(np.clip(1 - right - wrong, 0, 1), wrong, looks * problem.look)


def _at_least(looks: int, needed: int, chance: Floats) -> Floats:
    if looks == 1:
        return chance
    enough: Floats = bdtrc(needed - 1, looks, chance)
    return enough


class _Tours:
    """Tours of viewpoints from where the robot is, with a belief.

    `legs` and `shut` are the seconds (V,) to each viewpoint and of opening it, `seconds` those
    until a look from it ends, and `chances` (V,) that it shows an object.
    """

    def __init__(
        self, problem: SearchProblem, belief: Floats, at: int | None, opened: frozenset[int]
    ) -> None:
        self.problem, self.belief = problem, belief
        self.legs = problem.start if at is None else problem.travel[at]
        self.shut = problem.opening * [k not in opened for k in range(len(problem.opening))]
        self.usable = np.isfinite(self.legs) & (problem.visible @ belief.max(axis=0) > 1e-9)
        self.seconds = self.legs + self.shut + problem.look

    @cached_property
    def chances(self) -> Floats:
        shown = [self.problem.detection(self.belief, v) for v in range(len(self.legs))]
        seen: Floats = (np.array(shown) * self.belief).sum(axis=2)
        chances: Floats = 1 - np.prod(1 - seen, axis=1)
        return chances

    def promising(self, most: float) -> NDArray[np.intp]:
        """The usable viewpoints; of more than `most` (or `LEAST`) those of most chance a second."""
        usable = np.flatnonzero(self.usable)
        count = max(int(most), LEAST)
        if len(usable) <= count:
            return usable
        worth = self.chances[usable] / self.seconds[usable]
        return np.sort(usable[np.argpartition(-worth, count)[:count]])

    def first(self) -> tuple[float, _Looks, NDArray[np.intp]]:
        """The greedy tour with the best number of looks at each stop, and its cost."""
        found = []
        for looks in _all_looks(self.problem, self.belief):
            order = self.greedy(looks)
            found.append((float(self.totals(looks, order[None]).min()), looks, order))
        return min(found, key=lambda f: f[0])

    def totals(self, looks: _Looks, tours: NDArray[np.intp]) -> Floats:
        """(T, L + 1) what T tours cost if they end after each of their stops.

        A negative number in a tour (T, L) ends it.
        """
        problem, belief = self.problem, self.belief
        count, length = tours.shape
        alive = np.logical_and.accumulate(tours >= 0, axis=1)
        to = np.where(alive, tours, 0)
        mass = np.empty((count, length + 1, *belief.shape))
        mass[:, 0] = belief
        for stop in range(length):  # accumulate takes twice as long
            np.multiply(mass[:, stop], looks.unseen[to[:, stop]], out=mass[:, stop + 1])
        unseen = mass.sum(axis=3)
        going_on = 1 - np.prod(1 - np.minimum(unseen[:, :-1], 1), axis=2)
        going_on[:, :1] = 1
        leg = np.concatenate([self.legs[to[:, :1]], problem.travel[to[:, :-1], to[:, 1:]]], axis=1)
        earlier = np.tri(length, k=-1, dtype=bool)
        first = ~((to[:, :, None] == to[:, None, :]) & earlier).any(axis=2)
        spent = np.where(alive, going_on * (leg + self.shut[to] * first + looks.seconds), np.inf)
        spent += problem.wrong * np.einsum("tlos,tlos->tl", mass[:, :-1], looks.falsely[to])
        places = np.flatnonzero(np.diff(problem.place_of, prepend=-1))  # their first spots
        by_place = np.add.reduceat(mass, places, axis=3)
        declarable = problem.declarable[problem.place_of[places]]
        likeliest = np.max(by_place, axis=3, where=declarable, initial=0.0)
        totals: Floats = problem.cost_of_end(unseen, likeliest).sum(axis=2)
        totals[:, 1:] += np.cumsum(spent, axis=1)
        totals[:, 0] = problem.declared(belief)[1]
        return totals

    def greedy(self, looks: _Looks) -> NDArray[np.intp]:
        """A tour that goes where the chance to find an object per second is highest."""
        mass, tour = self.belief.ravel().copy(), []
        unseen = looks.unseen.reshape(len(self.shut), -1)
        legs, shut = self.legs, self.shut.copy()
        for _ in range(LONGEST):
            left = mass.sum()
            if left < 1e-3 * len(self.belief):
                break
            seconds = legs + shut + looks.seconds
            gain = (left - unseen @ mass) / seconds
            index = np.where(self.usable & np.isfinite(seconds), gain, -1.0)
            best = int(index.argmax())
            if index[best] <= 0:
                break
            tour.append(best)
            mass *= unseen[best]
            legs, shut[best] = self.problem.travel[best], 0.0
        return np.array(tour, np.intp)

    def improve(
        self, looks: _Looks, tour: NDArray[np.intp], rounds: int
    ) -> tuple[NDArray[np.intp], float]:
        """Move or exchange stops while this lowers the cost; end the tour where it is lowest."""
        totals = self.totals(looks, tour[None])[0]
        end = int(totals.argmin())
        best = float(totals[end])
        for _ in range(rounds):
            most = max(int(BUDGET / (self.belief.size * max(len(tour), 1))), 1)
            others = _neighbours(tour, max(end, min(len(tour), 3)), most)
            if not len(others):
                break
            totals = self.totals(looks, others)
            row, column = np.unravel_index(int(totals.argmin()), totals.shape)
            if totals[row, column] >= best - 1e-9:
                break
            tour, end, best = others[row], int(column), float(totals[row, column])
        return tour[:end], best


def _neighbours(tour: NDArray[np.intp], end: int, most: int) -> NDArray[np.intp]:
    """Tours with one stop moved, left out, or two exchanged, near the beginning first."""
    found: list[list[int]] = []
    stops = tour.tolist()
    for i in range(len(stops)):
        rest = stops[:i] + stops[i + 1 :]
        found.append([*rest, -1])
        for j in range(min(end, len(stops))):
            if j == i:
                continue
            found.append([*rest[:j], stops[i], *rest[j:]])
            if j < i - 1:
                swapped = stops.copy()
                swapped[i], swapped[j] = stops[j], stops[i]
                found.append(swapped)
        if len(found) > most:
            break
    return np.array(found[:most], np.intp).reshape(-1, len(stops))
