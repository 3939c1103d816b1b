"""Trials of a search: is what it finds true, and does the memory of looks make searches shorter?

In a trial, an object is searched for three times: it was never seen before; it is still there; it
was moved since. Over the trials, it is at each place in turn, anywhere in it, also where no look
shows it. The truth judges each end, and never the planner. The robot that remembers starts from
what it saw in former searches, as the map computes it; so its first search is one without memory.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planner.search.problem_builder import Detector, MapSearch
from planner.search.reader import DOUBT
from planner.search.receding_horizon import decide
from planner.search.search_problem import ELSEWHERE, NOT_SEEN, SearchProblem
from semmap.arrays import Floats
from semmap.belief import Observations
from semmap.belief.motion import DAILY, infer_with_motion

CASES = ("never seen", "still there", "moved since")
"""The searches of a trial, in this order."""

PAUSE = math.log(2) * DAILY.seconds
"""Seconds between two searches of a trial: half of all objects of mobility 1 were moved since."""

HISTORY = 0.5
"""Share of the prior that former places have, as in the map (`belief_model.prior_history`)."""

AWAY = 0.1
"""The prior of being at no place, as in the map (`belief_model.prior_elsewhere`)."""

RESAMPLES = 2000  # of the bootstrap, percentiles of the mean

_Looks = list[tuple[int, int]]  # a viewpoint, and the place in which the object was seen
_Decisions = dict[tuple[Any, ...], tuple[int | None, tuple[int, ...]]]


def compare(
    search: MapSearch, trials: int, seed: int = 0, *, limit: float = Detector.limit
) -> dict[str, Any]:
    """How several strategies search for the same objects: how right they are, and how fast.

    A search ends after `limit` seconds.

    For each of `CASES`, and for all together, there are the `seconds` of each strategy, and the
    shares of searches that have `found` the object, are `wrong` (found where it is not), or have
    `missed` it (not found, but a viewpoint shows it). The others did not find what no viewpoint
    shows, which is `right`, as to find it is. `slower` is by how many seconds a strategy is slower
    than the robot that remembers, and `slower_if_right` the same for searches in which both are
    right, as errors end searches soon; None if these are in fewer than 2 trials. Intervals are
    those of 95 %, by the bootstrap of (paired) means. Fewer than 2 trials, or than 2 places, are a
    ValueError.
    """
    problem = search.problem
    shown = problem.visible[np.isfinite(problem.start)].max(axis=0, initial=0.0) > 0
    places = [k for k, name in enumerate(problem.places) if name != ELSEWHERE]
    if trials < 2 or len(places) < 2:
        raise ValueError(
            f"{trials} trials with {len(places)} places; give 2 trials and 2 places or more"
        )
    order = np.random.default_rng(seed).permutation(places)
    decisions: _Decisions = {}  # what was decided once is decided again
    ends: dict[str, list[list[tuple[float, bool, bool, bool]]]] = {}
    for trial in range(trials):
        draw = np.random.default_rng([seed, trial])
        here, there = (_spot(search, order[(trial + k) % len(order)], draw) for k in range(2))
        strategies = {
            "remembers": _Believing(search, decisions, remembers=True),
            "without memory": _Believing(search, decisions, remembers=False),
            "last seen first": _LastSeenFirst(problem, remembers=True),
            "nearest first": _LastSeenFirst(problem, remembers=False),
        }
        for name, strategy in strategies.items():
            rows = []
            for number, spot in enumerate((here, here, there)):
                answers = np.random.default_rng([seed, trial, number])
                seconds, place = _search(problem, strategy, spot, answers, limit)
                found = place == problem.place_of[spot]
                missed = place is None and bool(shown[spot])
                rows.append((seconds, found, not found and place is not None, missed))
            ends.setdefault(name, []).append(rows)
    values = {name: np.array(rows, float) for name, rows in ends.items()}  # (trials, cases, 4)
    cases = {case: {n: v[:, [k]] for n, v in values.items()} for k, case in enumerate(CASES)}
    return {
        "trials": trials,
        "places": len(places),
        "cases": {case: summary(each) for case, each in {**cases, "all": values}.items()},
    }


def summary(values: dict[str, Floats]) -> dict[str, dict[str, Any]]:
    """The measures of each strategy, from seconds, found, wrong and missed (trials, cases, 4)."""
    seconds = {name: value[:, :, 0].mean(axis=1) for name, value in values.items()}
    right = {name: value[:, :, 2:].sum(axis=2) == 0 for name, value in values.items()}
    rows: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        found, wrong, missed = value[:, :, 1:].mean(axis=(0, 1)).tolist()
        rows[name] = {"seconds": _interval(seconds[name]), "right": 1 - wrong - missed}
        rows[name] |= {"found": found, "wrong": wrong, "missed": missed}
        if name != "remembers":
            rows[name]["slower"] = _interval(seconds[name] - seconds["remembers"])
            both = right[name] & right["remembers"]
            slower = (value - values["remembers"])[:, :, 0]
            pairs = both.any(axis=1)
            means = (slower * both).sum(axis=1)[pairs] / both.sum(axis=1)[pairs]
            rows[name]["slower_if_right"] = _interval(means) if len(means) > 1 else None
    return rows


def _interval(values: Floats) -> dict[str, float]:
    """The mean of values, and its 95 % confidence interval (percentile bootstrap)."""
    draw = np.random.default_rng(0)
    rows = draw.integers(0, len(values), (RESAMPLES, len(values)))
    low, high = np.percentile(values[rows].mean(axis=1), (2.5, 97.5))
    return {"mean": float(values.mean()), "low": float(low), "high": float(high)}


def _spot(search: MapSearch, place: int, draw: np.random.Generator) -> int:
    """A spot of a place, by their shares."""
    weights = search.share * (search.problem.place_of == place)
    return int(draw.choice(len(weights), p=weights / weights.sum()))


def _search(
    problem: SearchProblem, strategy: Any, spot: int, draw: np.random.Generator, limit: float
) -> tuple[float, int | None]:
    """The seconds of one search, and the place that it finds; None if it does not find the object.

    A look shows what the viewpoint shows of the true spot, at the rates of the detector.
    """
    belief = strategy.begin()
    at: int | None = None
    seconds, opened = 0.0, set()
    looks: _Looks = []
    while seconds < limit:
        to = strategy.choose(belief, at, looks)
        if to is None:
            break
        seconds += (problem.start if at is None else problem.travel[at])[to] + problem.look
        if to not in opened:
            seconds += problem.opening[to]
            opened.add(to)
        at = to
        chances = problem.answers(belief, to)[0, spot]
        answer = int(draw.choice(len(chances), p=chances))
        answer = NOT_SEEN if answer == len(problem.places) else answer
        looks.append((to, answer))
        belief = problem.after(belief, to, [answer])
    place = strategy.answer(belief, looks)
    strategy.end(looks)
    return seconds, place


class _Believing:
    """Searches by the belief that the map computes from all looks, or from none of former ones."""

    def __init__(self, search: MapSearch, decisions: _Decisions, *, remembers: bool) -> None:
        self.search, self.problem = search, search.problem
        self.decisions, self.remembers = decisions, remembers
        self.former: list[_Looks] = []
        self.tour: list[int] = []

    def begin(self) -> Floats:
        """The belief of a planner that doubts what the map believes after former looks."""
        self.tour = []
        prior = self._prior()
        rows = [
            (place, (len(self.former) - number) * PAUSE, place == seen, share, count)
            for number, looks in enumerate(self.former)
            for viewpoint, seen in looks
            for place, share, count in self._shown(viewpoint)
        ]
        believed = prior
        if rows:
            place, age, was_seen, share, count = map(np.array, zip(*rows, strict=True))
            observations = Observations(
                np.zeros(len(rows), np.intp),
                place,
                age,
                was_seen,
                share,
                np.full(len(rows), self.problem.hit[0]),
                self.problem.false_alarm[0] / count,
            )
            believed = infer_with_motion(prior[None], observations, [1.0])[0]
        chances = ((1 - DOUBT) * believed + DOUBT * prior).tolist()
        known = dict(zip(self.problem.places, chances, strict=True))
        return self.problem.spread([known], self.search.share)

    def _prior(self) -> Floats:
        """(P,) the prior of the map, in which former places weigh more."""
        names = self.problem.places
        places = np.array([name != ELSEWHERE for name in names])
        prior = places / places.sum()
        seen = [place for looks in self.former for _, place in looks if place != NOT_SEEN]
        moves = [p for k, p in enumerate(seen) if k == 0 or p != seen[k - 1]]
        if moves:
            former = np.zeros(len(names))
            for age, place in enumerate(reversed(moves), 1):
                former[place] += 0.5**age
            prior = (1 - HISTORY) * prior + HISTORY * former / former.sum()
        if places.all():
            return np.asarray(prior)
        return np.where(places, (1 - AWAY) * prior, AWAY)

    def _shown(self, viewpoint: int) -> list[tuple[int, float, int]]:
        """The places that a look shows, the share of each, and how many they are."""
        problem = self.problem
        whole = self.search.share @ problem.membership
        shares = (problem.visible[viewpoint] * self.search.share) @ problem.membership / whole
        shown = np.flatnonzero(shares > 0)
        return [(int(p), min(float(shares[p]), 1.0), len(shown)) for p in shown]

    def choose(self, belief: Floats, at: int | None, looks: _Looks) -> int | None:
        if looks and looks[-1][1] == NOT_SEEN and self.tour:
            return self.tour.pop(0)  # the tour is the best plan as long as nothing is seen
        opened = frozenset(v for v, _ in looks) if self.problem.opening.any() else frozenset()
        key = (belief.round(9).tobytes(), at, opened)
        if key not in self.decisions:
            decision = decide(self.problem, belief, at, opened, depth=0, rounds=1)
            self.decisions[key] = decision.viewpoint, decision.tour[1:]
        to, tour = self.decisions[key]
        self.tour = [*tour]
        return to

    def answer(self, belief: Floats, looks: _Looks) -> int | None:
        (place,), _ = self.problem.declared(belief)
        return None if place is None else self.problem.places.index(place)

    def end(self, looks: _Looks) -> None:
        if self.remembers:
            self.former.append(looks)


class _LastSeenFirst:
    """Looks where the object was seen last, then from the nearest viewpoint that is left.

    It is found where it was seen twice, as once may be an error. Each viewpoint has three looks.
    """

    def __init__(self, problem: SearchProblem, *, remembers: bool) -> None:
        self.problem, self.remembers = problem, remembers
        self.last: int | None = None
        self.uniform = np.full((1, len(problem.place_of)), 1 / len(problem.place_of))

    def begin(self) -> Floats:
        return self.uniform

    def choose(self, belief: Floats, at: int | None, looks: _Looks) -> int | None:
        if self.answer(belief, looks) is not None:
            return None
        if looks and looks[-1][1] != NOT_SEEN:
            return at
        legs = self.problem.start if at is None else self.problem.travel[at]
        if not looks and self.last is not None:
            shown = self.problem.visible @ self.problem.membership[:, self.last]
            return int(np.argmax(np.where(np.isfinite(legs), shown, -1)))
        times = np.bincount([v for v, _ in looks], minlength=len(legs)).astype(float)
        times[~np.isfinite(legs)] = np.inf
        if times.min() >= 3:
            return None
        return int(np.argmin(np.where(times == times.min(), legs, np.inf)))

    def answer(self, belief: Floats, looks: _Looks) -> int | None:
        seen = [place for _, place in looks if place != NOT_SEEN]
        return seen[-1] if seen and seen.count(seen[-1]) >= 2 else None

    def end(self, looks: _Looks) -> None:
        if self.remembers:
            self.last = next((s for _, s in reversed(looks) if s != NOT_SEEN), self.last)
