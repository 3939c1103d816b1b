"""One search, several solvers: what it costs until an object is declared, in the same worlds.

The search of the map with joined states (`planner.search.aggregation`), as other solvers read it:
point-based value iteration, POMCP and POUCT of pomdp-py, and the planner of the map, each in the
same draws of where the mug is, in that joined search.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pomdp_py

import semmap
from benchmarks.bench_map import fresh_map
from benchmarks.search import WORLDS
from benchmarks.timing import Row, print_rows
from planner.search.aggregation import SmallerSearch, aggregate
from planner.search.pomdp import Pomdp
from planner.search.receding_horizon import decide
from planner.search.search_problem import as_pomdp
from semmap.arrays import Floats
from tests.oracles.point_based import solve

STATES = 250
TRIALS = 20
STEPS = 60
SIMULATIONS = 1000  # of each step of POMCP and POUCT
DEPTH = 20
ROLLOUT = 12  # steps, with those in the tree, after which a simulated search gives up

Choose = Callable[[Floats], int]
"""The number of the action for a belief (S,) over the states."""


@dataclass
class Played:
    """What the runs of a solver cost, and how long it thought, seconds a step."""

    costs: list[float] = field(default_factory=list)
    thought: list[float] = field(default_factory=list)
    cut: int = 0  # runs that had not ended after `STEPS`


def play(pomdp: Pomdp, choose: Choose, random: np.random.Generator, played: Played) -> None:
    """One run, until the end or `STEPS`, which cost as much as the best end then."""
    state = int(random.choice(len(pomdp.states), p=pomdp.start))
    belief, cost = pomdp.start, 0.0
    for _ in range(STEPS):
        start = time.perf_counter()
        action = choose(belief)
        played.thought.append(time.perf_counter() - start)
        cost -= float(pomdp.rewards[action, state])
        state = int(random.choice(len(pomdp.states), p=pomdp.transitions[action, state]))
        if state == len(pomdp.states) - 1:
            played.costs.append(cost)
            return
        seen = int(random.choice(len(pomdp.observations), p=pomdp.likelihoods[action, state]))
        belief = (belief @ pomdp.transitions[action]) * pomdp.likelihoods[action][:, seen]
        belief = belief / belief.sum()
    ends = [k for k, name in enumerate(pomdp.actions) if name.startswith("declare")]
    played.cut += 1
    played.costs.append(cost + float((-pomdp.rewards[ends] @ belief).min()))


def planner_of_the_map(small: SmallerSearch, pomdp: Pomdp) -> Choose:
    """The planner that the map searches with, as actions of the POMDP."""
    problem = small.problem
    spots, views = len(problem.place_of), len(problem.viewpoints)
    shut = np.flatnonzero(problem.opening > 0)
    shape = (spots, views + 1, *[2] * len(shut))

    def choose(belief: Floats) -> int:
        joint = belief[:-1].reshape(shape)
        _, at, *opened = np.unravel_index(int(joint.argmax()), shape)
        here = None if at == views else int(at)
        spread = joint.reshape(spots, -1).sum(axis=1)[None]
        is_open = frozenset(int(v) for v, o in zip(shut, opened, strict=True) if o)
        decision = decide(problem, spread / spread.sum(), here, is_open)
        if decision.viewpoint is None:
            (place,), _ = problem.declared(spread / spread.sum())
            name = problem.objects[0]
            action = f"declare no-{name}" if place is None else f"declare {name}@{place}"
        elif decision.action == "look":
            action = "look"
        else:
            action = f"{decision.action} {problem.viewpoints[decision.viewpoint]}"
        return pomdp.actions.index(action)

    return choose


def point_based(pomdp: Pomdp) -> Choose:
    """Point-based value iteration: Pineau, Gordon and Thrun 2003."""
    return solve(pomdp, most_beliefs=120).action


class _State(pomdp_py.State):  # type: ignore[misc]
    def __init__(self, number: int) -> None:
        self.number = number

    def __hash__(self) -> int:
        return self.number

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and other.number == self.number


class _Action(_State, pomdp_py.Action):  # type: ignore[misc]
    """An action by its number."""


class _Observation(_State, pomdp_py.Observation):  # type: ignore[misc]
    """An observation by its number."""


def tree_search(pomdp: Pomdp, algorithm: str, seed: int) -> Choose:
    """POMCP or POUCT of pomdp-py (Silver and Veness 2010).

    They declare where the object was seen, or is the likeliest: with all places as actions, the
    tries of wrong ones outweigh what a search is worth. Beyond their tree, they go and look at
    random, and then give up.
    """
    random = np.random.default_rng(seed)
    states = [_State(k) for k in range(len(pomdp.states))]
    actions = [_Action(k) for k in range(len(pomdp.actions))]
    observations = [_Observation(k) for k in range(len(pomdp.observations))]
    following = pomdp.transitions.argmax(axis=2)  # no action leaves anything to chance
    cumulated = pomdp.likelihoods.cumsum(axis=2)

    class Transitions(pomdp_py.TransitionModel):  # type: ignore[misc]
        def sample(self, state: Any, action: Any) -> Any:
            return states[following[action.number, state.number]]

    class Likelihoods(pomdp_py.ObservationModel):  # type: ignore[misc]
        def sample(self, after: Any, action: Any) -> Any:
            row = cumulated[action.number, after.number]
            return observations[min(int(row.searchsorted(random.random())), len(row) - 1)]

    class Rewards(pomdp_py.RewardModel):  # type: ignore[misc]
        def sample(self, state: Any, action: Any, after: Any) -> float:
            return float(pomdp.rewards[action.number, state.number])

    class Actions(pomdp_py.RolloutPolicy):  # type: ignore[misc]
        def __init__(self, likeliest: int) -> None:
            self.likeliest = likeliest

        def get_all_actions(self, state: Any = None, history: Any = None) -> Any:
            seen = {declares.get(o.number, self.likeliest) for _, o in history or ()}
            return [actions[k] for k in {*moving, give_up.number, self.likeliest, *seen}]

        def rollout(self, state: Any, history: Any = None) -> Any:
            if len(history or ()) >= ROLLOUT:
                return give_up
            return actions[int(random.choice(moving))]

        def sample(self, state: Any) -> Any:
            return self.rollout(state)

    moving = [k for k, name in enumerate(pomdp.actions) if not name.startswith("declare")]
    give_up = actions[next(k for k, n in enumerate(pomdp.actions) if n.startswith("declare no-"))]
    named = {name.removeprefix("declare "): k for k, name in enumerate(pomdp.actions)}
    declares = {k: named[name] for k, name in enumerate(pomdp.observations) if name in named}
    spread = float(-pomdp.rewards[give_up.number].min())

    def choose(belief: Floats) -> int:
        if algorithm == "POMCP":
            drawn = random.choice(len(belief), 500, p=belief / belief.sum())
            known = pomdp_py.Particles([states[k] for k in drawn])
        else:
            rows = np.flatnonzero(belief)
            known = pomdp_py.Histogram({states[k]: float(belief[k]) for k in rows})
        ends = [k for k in range(len(actions)) if k not in moving]
        policy = Actions(ends[int((pomdp.rewards[ends] @ belief).argmax())])
        agent = pomdp_py.Agent(known, policy, Transitions(), Likelihoods(), Rewards())
        solver = getattr(pomdp_py, algorithm)(
            max_depth=DEPTH,
            discount_factor=0.999,
            num_sims=SIMULATIONS,
            exploration_const=spread,
            rollout_policy=policy,
        )
        return int(solver.plan(agent).number)

    return choose


def world_rows(files: tuple[str | Path, ...], start: str) -> tuple[str, list[Row]]:
    """What each solver costs in a world; and what was joined."""

    def make(db: semmap.Database) -> semmap.Map:
        for file in files:
            db.import_file(Path(os.environ["SEMMAP_WORLDS"]) / file, map="solvers")
        return db.map("solvers")

    with fresh_map("solvers", make) as (_, made):
        made.add_object("mug", type="mug", size=(0.09, 0.09, 0.1), define=True)
        search = made.search("mug", start=start).problem
    small = aggregate(search.problem, search.belief, STATES)
    pomdp = as_pomdp(small.problem, small.belief)
    begun = time.perf_counter()
    solvers: dict[str, Choose] = {"point-based": point_based(pomdp)}
    policy = time.perf_counter() - begun
    solvers["planner of the map"] = planner_of_the_map(small, pomdp)
    solvers |= {name: tree_search(pomdp, name, 1) for name in ("POMCP", "POUCT")}
    played = {name: Played() for name in solvers}
    for trial in range(TRIALS):
        for name, choose in solvers.items():
            play(pomdp, choose, np.random.default_rng(trial), played[name])
    rows = []
    ours = np.array(played["planner of the map"].costs)
    for name, runs in played.items():
        costs = np.array(runs.costs)
        more = costs - ours
        error = 1.96 * more.std() / np.sqrt(len(more))
        told = f"{costs.mean():.0f} s; {np.mean(runs.thought) * 1000:.0f} ms a step"
        told += f", {policy:.1f} s for the policy" if name == "point-based" else ""
        told += f"; {runs.cut} cut" if runs.cut else ""
        reference = f"{more.mean():+.0f} s to the map's, ± {error:.0f}"
        rows.append(Row(name, told, reference, "", True))
    return str(small), rows


def main() -> None:
    """Print a table for each world of the folder ``SEMMAP_WORLDS``."""
    if "SEMMAP_WORLDS" not in os.environ:
        raise SystemExit("set SEMMAP_WORLDS to the folder of the real worlds")
    for world, (files, start) in WORLDS.items():
        joined, rows = world_rows(files, start)
        print_rows(f"{world}: {joined}; mean cost of {TRIALS} searches", rows)


if __name__ == "__main__":
    main()
