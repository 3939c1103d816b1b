"""The search for objects as arrays: where they may be, what each viewpoint shows, what time costs.

A *spot* is a part of a place that a viewpoint sees as a whole or not at all, so that a second look
from the same viewpoint does not find what the first could not see. The cost of a search is its
seconds, `wrong` seconds for each object that is declared at a wrong place, and `missed` seconds for
each that is not found. With these two costs an object is declared from the belief `sure` on (the
reject option of Chow, 1970).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.search.pomdp import Pomdp
from semmap.arrays import Floats

NOT_SEEN = -1  # stands for a place in the answer of a look: the object was not seen

ELSEWHERE = "elsewhere"  # the place that nothing shows: at no place of the map

END = "end"


@dataclass(frozen=True, eq=False)
class SearchProblem:
    """What is known before a search, except where the objects are; wrong values are ValueErrors.

    Parameters
    ----------
    objects, places, viewpoints : tuples of O, P and V str
        The last place may be *elsewhere*, which nothing shows.
    place_of : (S,) int
        The place of each spot, ascending.
    visible : (V, S) float64
        The share of a spot that a viewpoint shows.
    travel, start : (V, V) and (V,) float64, seconds
        From viewpoint to viewpoint, and from the robot; infinite where no way leads.
    look : float, seconds
        The duration of a look.
    hit : (O,) float64
        P(an object is seen | it is in what the viewpoint shows).
    false_alarm : (O,) float64
        P(an object is seen where it is not | it is not seen where it is).
    wrong : float, seconds
        What a wrong place of an object costs.
    opening : (V,) float64, seconds
        The duration of opening what the viewpoint looks into; 0 where nothing is shut. What a
        viewpoint shows is hidden until then.
    shows : (V, O, O) float64, optional
        P(object i is not hidden | object j is in the same place), from each viewpoint.
    missed : float, seconds, optional
        What an object that is not found costs. Without it each object is declared somewhere.
    """

    objects: tuple[str, ...]
    places: tuple[str, ...]
    viewpoints: tuple[str, ...]
    place_of: NDArray[np.intp]
    visible: Floats
    travel: Floats
    start: Floats
    look: float
    hit: Floats
    false_alarm: Floats
    wrong: float
    opening: Floats
    shows: Floats | None = None
    missed: float | None = None

    def __post_init__(self) -> None:
        o, p, v, s = (*map(len, (self.objects, self.places, self.viewpoints)), len(self.place_of))
        for kind in ("object", "place", "viewpoint"):
            names = getattr(self, f"{kind}s")
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise ValueError(f"{kind} {twice} is there twice; name each {kind} once")
        if not (o and p and s):
            raise ValueError(f"{o} objects, {p} places and {s} spots; give 1 or more of each")
        shapes = {
            "visible": (v, s),
            "travel": (v, v),
            **dict.fromkeys(("start", "opening"), (v,)),
            **dict.fromkeys(("hit", "false_alarm"), (o,)),
            **({} if self.shows is None else {"shows": (v, o, o)}),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name}: its shape is {getattr(self, name).shape}; give {shape}")
        _refuse_outside("visible", self.visible, 0, 1)
        _refuse_outside("shows", self.shows, 0, 1)
        for name in ("travel", "start", "opening", "look", "wrong", "missed"):
            _refuse_outside(name, getattr(self, name), 0, np.inf)
        for name in ("hit", "false_alarm"):
            for of, rate in zip(self.objects, getattr(self, name), strict=True):
                if not (0 < rate <= 1 if name == "hit" else 0 <= rate < 1):
                    raise ValueError(f"{of}: its rate {name} is {rate:g}; give one in (0, 1)")
        if (self.hit <= self.false_alarm).any():
            of = self.objects[int(np.argmax(self.hit <= self.false_alarm))]
            raise ValueError(
                f"{of}: it is seen no more often where it is than where it is not; give a rate "
                "hit above false_alarm"
            )
        unsorted = (np.diff(self.place_of) < 0).any()
        if unsorted or self.place_of[0] < 0 or self.place_of[-1] >= p:
            raise ValueError(f"place_of: give ascending numbers from 0 to {p - 1}")
        if not (np.isfinite(self.look) and np.isfinite(self.wrong) and self.look > 0):
            raise ValueError(
                f"look is {self.look} s and wrong {self.wrong} s; give finite numbers above 0"
            )

    @cached_property
    def memory(self) -> dict[str, Any]:
        """Results that depend on the problem alone, for solvers."""
        return {}

    @property
    def sure(self) -> float:
        """The least belief in a place at which an object is declared there."""
        if self.missed is None or self.missed >= self.wrong:
            return 0.0
        return 1 - self.missed / self.wrong

    @cached_property
    def declarable(self) -> NDArray[np.bool_]:
        """(P,) where an object can be declared: not elsewhere, if it may remain not found."""
        return np.array([self.missed is None or name != ELSEWHERE for name in self.places])

    @cached_property
    def membership(self) -> Floats:
        """(S, P) float64: 1 where a spot belongs to a place."""
        return np.eye(len(self.places))[self.place_of]

    @cached_property
    def in_view(self) -> Floats:
        """(V, P) float64: 1 where a viewpoint shows a part of a place."""
        return ((self.visible @ self.membership) > 0).astype(float)

    def spread(self, belief: Sequence[Mapping[str, float]], share: Floats | None = None) -> Floats:
        """(O, S) the belief over spots, from one over places for each object.

        `share` (S,) is that of its place that a spot is; by default all spots of a place are equal.
        """
        per_place = np.array([[b.get(name, 0.0) for name in self.places] for b in belief])
        _refuse_outside("belief", per_place, 0, 1)
        sums = per_place.sum(axis=1)
        for of, total in zip(self.objects, sums, strict=True):
            if abs(total - 1) > 1e-6:
                raise ValueError(f"{of}: its belief sums to {total:.6f}, not to 1")
        parts = np.ones(len(self.place_of)) if share is None else share
        whole = parts @ self.membership
        spread: Floats = (per_place / sums[:, None])[:, self.place_of] * (
            parts / whole[self.place_of]
        )
        return spread

    def by_place(self, belief: Floats) -> Floats:
        """(O, P) the belief over places, from one over spots (O, S)."""
        return belief @ self.membership

    def detection(self, belief: Floats, viewpoint: int) -> Floats:
        """(O, S) P(a look sees the object where it is), for each spot.

        What other objects may hide is averaged over where they may be.
        """
        seen: Floats = self.hit[:, None] * self.visible[viewpoint]
        if self.shows is not None:
            with_it = self.by_place(belief)[:, self.place_of]  # (O, S): in the place of a spot
            hidden = (1 - self.shows[viewpoint])[:, :, None] * with_it[None]
            hidden[np.arange(len(self.objects)), np.arange(len(self.objects))] = 0
            seen = seen * (1 - hidden).prod(axis=1)
        return seen

    def answers(self, belief: Floats, viewpoint: int) -> Floats:
        """(O, S, P + 1) P(answer of a look | spot): seen in each place, and at the end not seen."""
        seen = self.detection(belief, viewpoint)
        shown = self.in_view[viewpoint]
        alarm = self.false_alarm * bool(shown.any())
        missed = 1 - seen
        found = seen[:, :, None] * self.membership[None]
        falsely = (missed * alarm[:, None])[:, :, None] * (shown / max(shown.sum(), 1))
        return np.concatenate([found + falsely, (missed * (1 - alarm[:, None]))[:, :, None]], 2)

    def after(self, belief: Floats, viewpoint: int, seen: Sequence[int]) -> Floats:
        """The belief (O, S) after a look; ValueError if the answer is impossible.

        `seen` has for each object the number of the place in which it was seen, or `NOT_SEEN`.
        """
        answers = self.answers(belief, viewpoint)
        posterior = belief * answers[np.arange(len(self.objects)), :, np.asarray(seen)]
        total = posterior.sum(axis=1, keepdims=True)
        if (total <= 0).any():
            of = self.objects[int(np.argmin(total))]
            raise ValueError(f"{of}: by the belief and the rates, this answer is impossible")
        after: Floats = posterior / total
        return after

    def declared(self, belief: Floats) -> tuple[list[str | None], float]:
        """The place of each object, None if it is not found, and what this end costs, seconds."""
        chances = np.where(self.declarable, self.by_place(belief), 0.0)
        best, most = chances.argmax(axis=1), chances.max(axis=1)
        found = most >= self.sure - 1e-9
        places = [self.places[k] if yes else None for k, yes in zip(best, found, strict=True)]
        return places, float(self.cost_of_end(np.ones(len(most)), most).sum())

    def cost_of_end(self, left: Floats, most: Floats) -> Floats:
        """What it costs to end, seconds, in each case of `left` (...): to declare or to miss.

        `left` is the probability of a case, and `most` the part of it in the likeliest place.
        """
        cost: Floats = self.wrong * (left - most)
        return cost if self.missed is None else np.minimum(cost, self.missed * left)


def count_states(objects: int, spots: int, viewpoints: int, shut: int) -> int:
    """How many states a search has as a POMDP, if the contents of so many viewpoints are shut."""
    return int(spots**objects * (viewpoints + 1) * 2**shut + 1)


def as_pomdp(problem: SearchProblem, belief: Floats, *, most_states: int = 1000) -> Pomdp:
    """The search with a belief (O, S) as a POMDP whose actions are go, look, open, and declare.

    A state is a spot for each object, the viewpoint of the robot (or its start), and what is open.
    More states than `most_states` are a ValueError: use `planner.search.aggregation.aggregate`.
    """
    o, s, v = len(problem.objects), len(problem.place_of), len(problem.viewpoints)
    shut = [int(k) for k in np.flatnonzero(problem.opening > 0)]
    n = count_states(o, s, v, len(shut))
    if n > most_states:
        raise ValueError(
            f"the search has {n} states; up to {most_states} can be listed: use "
            "planner.search.aggregation"
        )
    hidden = list(itertools.product(range(s), repeat=o))
    outcomes = list(itertools.product([NOT_SEEN, *range(len(problem.places))], repeat=o))
    modes = list(itertools.product(range(v + 1), itertools.product((0, 1), repeat=len(shut))))
    names = [
        " ".join(
            [f"{x}@{problem.places[problem.place_of[k]]}.{k}" for x, k in _pairs(problem, spots)]
            + [f"robot@{'start' if at == v else problem.viewpoints[at]}"]
            + [f"open:{problem.viewpoints[c]}" for c in itertools.compress(shut, opened)]
        )
        for spots in hidden
        for at, opened in modes
    ]
    state = np.arange(n - 1).reshape(len(hidden), v + 1, *[2] * len(shut))
    where, at, *is_open = (axis.ravel() for axis in np.indices(state.shape))
    quiet = np.zeros((n, len(outcomes)))
    quiet[:, outcomes.index((NOT_SEEN,) * o)] = 1
    actions: list[tuple[str, NDArray[np.intp], Floats, Floats]] = []

    def add(name: str, following: NDArray[np.intp], reward: Floats, answer: Floats = quiet) -> None:
        after = np.broadcast_to(following, state.shape).ravel()
        actions.append((name, np.append(after, n - 1), np.append(reward, 0.0), answer))

    def chances(viewpoint: int, spots: tuple[int, ...]) -> list[float]:
        """The probability of each outcome of a look, if each object is at a spot for certain."""
        answers = problem.answers(np.eye(s)[list(spots)], viewpoint)[np.arange(o), list(spots)]
        return [math.prod(answers[np.arange(o), list(outcome)].tolist()) for outcome in outcomes]

    legs = np.concatenate([problem.travel, problem.start[None]])  # (V + 1, V)
    np.fill_diagonal(legs, problem.look)  # to wait takes time: a search that never ends costs more
    far = 10 * (problem.wrong * o + legs[np.isfinite(legs)].sum() + 1.0)
    legs[~np.isfinite(legs)] = far
    for to in range(v):
        add(f"go {problem.viewpoints[to]}", state[:, [to]], -legs[at, to])
    for c, axis in zip(shut, itertools.count(2)):
        after = state.copy()
        after[:, c] = state.take([1], axis)[:, c]
        add(f"open {problem.viewpoints[c]}", after, np.full(n - 1, -problem.opening[c]))
    answer = quiet.copy()
    for viewpoint in range(v):
        sees = at == viewpoint
        if viewpoint in shut:
            sees &= is_open[shut.index(viewpoint)] == 1
        each = np.array([chances(viewpoint, spots) for spots in hidden])
        answer[:-1][sees] = each[where[sees]]
    add("look", state, np.full(n - 1, -problem.look), answer)
    places = problem.place_of[np.array(hidden)]  # (h, O)
    missed = [] if problem.missed is None else [NOT_SEEN]
    for reported in itertools.product([*np.flatnonzero(problem.declarable), *missed], repeat=o):
        said = np.array(reported)
        errors = ((places != said) & (said != NOT_SEEN)).sum(axis=1)
        costs = problem.wrong * errors + (problem.missed or 0.0) * (said == NOT_SEEN).sum()
        name = _answer_name(problem, reported)
        add(f"declare {name}", np.full_like(state, n - 1), -costs[where])

    start = np.zeros(n)
    start[state[:, v].reshape(len(hidden), -1)[:, 0]] = [
        np.prod([belief[i, x] for i, x in enumerate(spots)]) for spots in hidden
    ]
    likelihoods = np.stack([answer for *_, answer in actions])
    possible = np.asarray(likelihoods.any(axis=(0, 1)))
    labels = [_answer_name(problem, outcome) for outcome in outcomes]
    return Pomdp(
        (*names, END),
        tuple(name for name, *_ in actions),
        tuple(itertools.compress(labels, possible)),
        np.stack([np.eye(n)[following] for _, following, *_ in actions]),
        likelihoods[:, :, possible],
        np.stack([reward for _, _, reward, _ in actions]),
        start / start.sum(),
    )


def _answer_name(problem: SearchProblem, answer: Sequence[int]) -> str:
    """The places of the objects in a look or at the end, as the name of a POMDP's symbol."""
    return " ".join(
        f"no-{x}" if p == NOT_SEEN else f"{x}@{problem.places[p]}"
        for x, p in _pairs(problem, answer)
    )


def _pairs(problem: SearchProblem, values: Sequence[int]) -> zip[tuple[str, int]]:
    return zip(problem.objects, values, strict=True)


def _refuse_outside(name: str, value: Floats | float | None, low: float, high: float) -> None:
    if value is None:
        return
    values = np.asarray(value, float)
    wrong = ~((values >= low) & (values <= high))  # true for NaN as well
    if wrong.any():
        limits = f"in [{low:g}, {high:g}]" if np.isfinite(high) else f"from {low:g} on"
        raise ValueError(f"{name}: {values[wrong][0]:g} is not {limits}")
