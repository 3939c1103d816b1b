"""Random trials of a search: does the memory of looks make later searches shorter?

In a trial, an object has favourite places and moves among them between runs. Each strategy searches
for it in every run, with the same truth. The believing one starts from what it saw in former runs,
as the map computes it; so its first run is as long as a search without memory.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.search.problem_builder import ELSEWHERE, MapSearch
from planner.search.receding_horizon import decide
from planner.search.search_problem import NOT_SEEN, SearchProblem
from semmap.arrays import Floats
from semmap.belief import SightingModel

RUNS = 5  # searches of a trial

STAYS = 0.5
"""Probability that the object is where it was in the run before; else it is put down again."""

CONCENTRATION = 0.3
"""Of the Dirichlet distribution of favourite places: below 1, few places have most of it."""

HISTORY = 0.5
"""Share of the prior that former places have, as in the map (`belief_model.prior_history`)."""

LEAST_CHANCE = 0.002  # chance to see the object below which a search ends without it
MOST_LOOKS = 60  # looks after which a search gives up


_Decisions = dict[tuple[Any, ...], tuple[int | None, tuple[int, ...]]]


def compare(search: MapSearch, trials: int, seed: int = 0) -> dict[str, Any]:
    """The durations of searches for random objects by several strategies, in seconds.

    For each strategy there are `seconds` and `right` (share of right answers), and for each
    comparison the mean difference; each with the half width of its 95 % confidence interval. Fewer
    than 2 trials, or than 2 places in view, are a ValueError.
    """
    problem = search.problem
    seen = problem.visible.max(axis=0) > 0
    places = np.unique(problem.place_of[seen])
    if trials < 2 or len(places) < 2:
        raise ValueError(
            f"{trials} trials with {len(places)} places in view; give 2 trials and 2 places or more"
        )
    decisions: _Decisions = {}  # what was decided once is decided again
    results: dict[str, list[list[tuple[float, bool]]]] = {}
    for trial in range(trials):
        draw = np.random.default_rng([seed, trial])
        truths = _truths(problem, search.share * seen, places, draw)
        strategies = {
            "believing": _Believing(search, decisions, remembers=True),
            "without memory": _Believing(search, decisions, remembers=False),
            "last seen first": _LastSeenFirst(problem),
        }
        for name, strategy in strategies.items():
            runs = []
            for run, spot in enumerate(truths):
                answers = np.random.default_rng([seed, trial, run])
                cost, place = _search(problem, strategy, spot, answers)
                runs.append((cost, place == problem.place_of[spot]))
            results.setdefault(name, []).append(runs)
    values = {k: np.array(v, float) for k, v in results.items()}  # (trials, runs, 2)
    columns = {
        "first search": values["believing"][:, :1],
        "later searches": values["believing"][:, 1:],
        **{name: values[name][:, 1:] for name in ("without memory", "last seen first")},
    }
    seconds = {name: k[:, :, 0].mean(axis=1) for name, k in columns.items()}
    later = seconds["later searches"]
    return {
        "trials": trials,
        "runs": RUNS,
        "strategies": {
            name: {"seconds": _interval(seconds[name]), "right": float(k[:, :, 1].mean())}
            for name, k in columns.items()
        },
        "later searches are shorter than": {
            name: _interval(each - later)
            for name, each in seconds.items()
            if name != "later searches"
        },
    }


def _interval(values: Floats) -> dict[str, float]:
    """The mean of values, and the half width of its 95 % confidence interval (Student's t)."""
    from scipy.stats import t

    error = values.std(ddof=1) / math.sqrt(len(values))
    width = float(t.ppf(0.975, len(values) - 1) * error)
    return {"mean": float(values.mean()), "half_width": width}


def _truths(
    problem: SearchProblem, share: Floats, places: NDArray[np.intp], draw: np.random.Generator
) -> list[int]:
    """The spot of the object in each run."""
    habits = draw.dirichlet(np.full(len(places), CONCENTRATION))
    spots: list[int] = []
    for _ in range(RUNS):
        if spots and draw.random() < STAYS:
            spots.append(spots[-1])
            continue
        place = places[draw.choice(len(places), p=habits)]
        weights = share * (problem.place_of == place)
        spots.append(int(draw.choice(len(share), p=weights / weights.sum())))
    return spots


def _search(
    problem: SearchProblem, strategy: Any, spot: int, draw: np.random.Generator
) -> tuple[float, int]:
    """The seconds of one search, and the place that it ends with."""
    belief = strategy.begin()
    at: int | None = None
    seconds, opened = 0.0, set()
    looks: list[tuple[int, int]] = []
    while len(looks) < MOST_LOOKS:
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
    """Searches by the belief that the map computes from all looks, or from none of former runs."""

    def __init__(self, search: MapSearch, decisions: _Decisions, *, remembers: bool) -> None:
        self.search, self.problem = search, search.problem
        self.decisions, self.remembers = decisions, remembers
        self.evidence = np.zeros(len(self.problem.places))
        self.history: list[int] = []
        self.tour: list[int] = []

    def begin(self) -> Floats:
        """The belief of the map: its prior with former places, times the likelihoods of looks."""
        problem = self.problem
        places = [k for k, name in enumerate(problem.places) if name != ELSEWHERE]
        self.tour = []
        prior = np.zeros(len(problem.places))
        prior[places] = 1 / len(places)
        if self.history:
            former = np.zeros(len(problem.places))
            moves = [p for k, p in enumerate(self.history) if k == 0 or p != self.history[k - 1]]
            for age, place in enumerate(reversed(moves), 1):
                former[place] += 0.5**age
            prior = (1 - HISTORY) * prior + HISTORY * former / former.sum()
        weights = np.log(np.maximum(prior, 1e-300)) + self.evidence
        chances = np.exp(weights - weights.max())
        chances /= chances.sum()
        known = {name: float(chances[k]) for k, name in enumerate(problem.places)}
        return problem.spread([known], self.search.share)

    def choose(self, belief: Floats, at: int | None, looks: list[tuple[int, int]]) -> int | None:
        if looks and looks[-1][1] == NOT_SEEN and self.tour:
            return self.tour.pop(0)  # the tour is the best plan as long as nothing is seen
        seen = next((place for _, place in reversed(looks) if place != NOT_SEEN), None)
        opened = frozenset(v for v, _ in looks) if self.problem.opening.any() else frozenset()
        key = (belief.round(9).tobytes(), at, opened, seen)
        if key not in self.decisions:
            decision = decide(self.problem, belief, at, opened, depth=0, rounds=1)
            to = decision.viewpoint
            if to is None and seen != self.answer(belief, looks):  # an answer must be seen
                more = (o for o in decision.options if o.chance > LEAST_CHANCE)
                to = next((o.viewpoint for o in more), None)
            self.decisions[key] = to, decision.tour[1:]
        to, tour = self.decisions[key]
        self.tour = [*tour]
        return to

    def answer(self, belief: Floats, looks: list[tuple[int, int]]) -> int:
        return int(self.problem.by_place(belief)[0].argmax())

    def end(self, looks: list[tuple[int, int]]) -> None:
        """Remember what was seen, and what was in view and was not, at the rates of old looks."""
        if not self.remembers:
            return
        problem = self.problem
        (old_hit,), (old_alarm,) = SightingModel().rates(np.array([1e6]), np.array([1.0]))
        whole = self.search.share @ problem.membership
        for viewpoint, seen in looks:
            shares = (problem.visible[viewpoint] * self.search.share) @ problem.membership / whole
            for place in np.flatnonzero(shares > 0):
                hit, alarm = old_hit * shares[place], old_alarm * shares[place]
                self.evidence[place] += (
                    math.log(hit / alarm) if place == seen else math.log((1 - hit) / (1 - alarm))
                )
            if seen != NOT_SEEN:
                self.history.append(seen)


class _LastSeenFirst:
    """Looks where the object was seen last, then from the nearest viewpoint that is left."""

    def __init__(self, problem: SearchProblem) -> None:
        self.problem = problem
        self.last: int | None = None
        self.uniform = np.full((1, len(problem.place_of)), 1 / len(problem.place_of))

    def begin(self) -> Floats:
        return self.uniform

    def choose(self, belief: Floats, at: int | None, looks: list[tuple[int, int]]) -> int | None:
        sightings = [place for _, place in looks if place != NOT_SEEN]
        if sightings and sightings.count(sightings[-1]) >= 2:
            return None
        if looks and looks[-1][1] != NOT_SEEN:
            return at  # to see it once may be an error
        legs = self.problem.start if at is None else self.problem.travel[at]
        if not looks and self.last is not None:
            shown = self.problem.visible @ self.problem.membership[:, self.last]
            return int(np.argmax(np.where(np.isfinite(legs), shown, -1)))
        times = np.bincount([v for v, _ in looks], minlength=len(legs))
        if times.min() >= 3:
            return None
        return int(np.argmin(np.where(times == times.min(), legs, np.inf)))

    def answer(self, belief: Floats, looks: list[tuple[int, int]]) -> int:
        return next((seen for _, seen in reversed(looks) if seen != NOT_SEEN), 0)

    def end(self, looks: list[tuple[int, int]]) -> None:
        self.last = next((seen for _, seen in reversed(looks) if seen != NOT_SEEN), self.last)
