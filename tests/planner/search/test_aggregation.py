"""Searches with fewer states: what is joined is the nearest, and little is lost by it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.search.aggregation import aggregate
from planner.search.pomdp import Pomdp, write_pomdp
from planner.search.search_problem import NOT_SEEN, SearchProblem, as_pomdp
from tests.oracles.point_based import SearchPolicy, solve
from tests.planner.search.pomdp_reader import read_pomdp
from tests.planner.search.problems import random_search


def wide_search(seed: int, places: int = 4, spots: int = 9, viewpoints: int = 7, **options: float):
    """A search whose places have many spots, of which viewpoints show random shares."""
    random = np.random.default_rng(seed)
    small, belief = random_search(seed, 1, places, viewpoints, **options)
    share = random.dirichlet(np.ones(spots), places)
    shown = random.uniform(0, 1, (viewpoints, places * spots)) ** 3
    wide = replace(small, place_of=np.repeat(np.arange(places), spots), visible=shown)
    return wide, np.repeat(belief, spots, axis=1) * share.ravel()


def chances(problem: SearchProblem, belief: np.ndarray, looks: list[int]) -> float:
    """P(looks from these viewpoints all miss the object)."""
    missed = np.prod([1 - problem.hit[0] * problem.visible[v] for v in looks], axis=0)
    return float(belief[0] @ missed)


@pytest.mark.parametrize("seed", range(4))
def test_belief_and_places_stay(seed: int) -> None:
    problem, belief = wide_search(seed)
    found = aggregate(problem, belief, 60)
    assert found.states <= 60 < found.former == 36 * 8 + 1
    assert len(as_pomdp(found.problem, found.belief).states) == found.states
    whole, small = problem.by_place(belief), found.problem.by_place(found.belief)
    assert small == pytest.approx(whole)
    for kept in found.problem.viewpoints:  # a single look shows the same of each place
        v, w = problem.viewpoints.index(kept), found.problem.viewpoints.index(kept)
        shown = problem.by_place(belief * problem.visible[v])
        assert found.problem.by_place(found.belief * found.problem.visible[w]) == pytest.approx(
            shown
        )


def test_spots_that_are_seen_alike_are_one_without_a_loss() -> None:
    problem, belief = wide_search(5, spots=4)
    twice = replace(
        problem,
        place_of=np.repeat(problem.place_of, 3),
        visible=np.repeat(problem.visible, 3, axis=1),
    )
    parts = np.repeat(belief, 3, axis=1) / 3
    found = aggregate(twice, parts, 16 * 8 + 1)
    assert found.problem.viewpoints == problem.viewpoints
    assert found.shown == pytest.approx(found.formerly)
    for looks in itertools.combinations(range(7), 3):
        expected = chances(problem, belief, [*looks])
        assert chances(found.problem, found.belief, [*looks]) == pytest.approx(expected)


@pytest.mark.parametrize("seed", range(12))
def test_the_first_step_is_the_best_of_all(seed: int) -> None:
    """By brute force over all pairs of spots and all viewpoints."""
    problem, belief = wide_search(seed, places=2, spots=4, viewpoints=4)
    spots, views, losses = 8, 4, {}
    for a, b in itertools.combinations(range(spots), 2):
        if problem.place_of[a] == problem.place_of[b]:
            one, two = belief[0, [a, b]]
            off = max(abs(problem.visible[:, a] - problem.visible[:, b]))
            lost = off * one * two / (one + two)
            losses["join", a, b] = lost / np.log(spots / (spots - 1))
    for v in range(views):
        left = np.delete(problem.visible, v, axis=0).max(axis=0)
        lost = float((problem.visible.max(axis=0) - left) @ belief[0])
        losses["leave", v] = lost / np.log((views + 1) / views)
    best = min(losses, key=losses.__getitem__)
    smaller = aggregate(problem, belief, spots * (views + 1))
    found = smaller.problem
    if best[0] == "join":
        assert len(found.place_of) == spots - 1
        merged = np.delete(belief[0], best[2])
        merged[best[1]] += belief[0, best[2]]
        assert found.visible.shape == (views, spots - 1)
        assert smaller.belief[0] == pytest.approx(merged)
    else:
        assert found.viewpoints == tuple(np.delete(problem.viewpoints, best[1]))


@pytest.mark.parametrize("seed", range(3))
def test_the_policy_of_a_joined_search_is_nearly_as_good(tmp_path: Path, seed: int) -> None:
    """Played in the whole search, by looks that show the true spot or not; written and read."""
    problem, belief = wide_search(seed, places=3, spots=5, viewpoints=4, hit=0.9, wrong=100.0)
    whole = as_pomdp(problem, belief)
    found = aggregate(problem, belief, 40)
    file = write_pomdp(as_pomdp(found.problem, found.belief), tmp_path / "a.pomdp", str(found))
    assert file.read_text().startswith(f"# {len(whole.states)} states joined to {found.states}:")
    joined = replace(read_pomdp(file), actions=as_pomdp(found.problem, found.belief).actions)
    best, policy = -solve(whole).value(whole.start), solve(joined)
    costs = [played(problem, belief, joined, policy, found.problem, n) for n in range(400)]
    error = 2 * np.std(costs) / np.sqrt(len(costs))
    assert np.mean(costs) < 1.25 * best + error


def played(
    whole: SearchProblem,
    belief: np.ndarray,
    joined: Pomdp,
    policy: SearchPolicy,
    small: SearchProblem,
    seed: int,
) -> float:
    """The cost of the joined policy where the object is at a spot of the whole search."""
    random = np.random.default_rng(seed)
    spot = int(random.choice(len(whole.place_of), p=belief[0]))
    believed, at, cost = joined.start, len(small.viewpoints), 0.0
    views = [whole.viewpoints.index(name) for name in small.viewpoints]
    for _ in range(40):
        action = policy.action(believed)
        name = joined.actions[action]
        seen = NOT_SEEN
        if name.startswith("declare"):
            return cost + whole.wrong * (
                not name.endswith(f"@{whole.places[whole.place_of[spot]]}")
            )
        if name == "look":
            cost += whole.look
            answers = whole.answers(np.eye(len(whole.place_of))[[spot]], views[at])[0, spot]
            seen = int(random.choice(len(answers), p=answers))
            seen = NOT_SEEN if seen == len(whole.places) else seen
        else:
            to = small.viewpoints.index(name.removeprefix("go "))
            legs = small.start if at == len(views) else small.travel[at]
            cost, at = cost + (whole.look if to == at else legs[to]), to
        chance = joined.likelihoods[action][:, _answer(joined, small, seen)]
        believed = (believed @ joined.transitions[action]) * chance
        believed = believed / believed.sum()
    return cost + whole.wrong


def _answer(joined: Pomdp, small: SearchProblem, seen: int) -> int:
    """The number of an answer of a look, by the place that its name ends with."""
    if seen == NOT_SEEN:
        return next(k for k, name in enumerate(joined.observations) if name.startswith("no-"))
    return next(k for k, o in enumerate(joined.observations) if o.endswith(small.places[seen]))


def test_two_objects_and_shut_furniture_are_counted(tmp_path: Path) -> None:
    problem, belief = random_search(7, 2, 4, 5, shut=3)
    found = aggregate(problem, belief, 200)
    assert len(as_pomdp(found.problem, found.belief).states) == found.states <= 200
    assert (
        found.states
        == 16 * (len(found.problem.viewpoints) + 1) * 2 ** int((found.problem.opening > 0).sum())
        + 1
    )
    with pytest.raises(ValueError, match="or search for fewer objects"):
        aggregate(problem, belief, 30)


def test_a_search_that_is_small_enough_stays() -> None:
    problem, belief = random_search(8)
    found = aggregate(problem, belief)
    assert str(found) == "13 states"
    assert found.problem.viewpoints == problem.viewpoints
    assert (found.belief == belief).all()
