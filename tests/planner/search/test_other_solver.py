"""Exported files, solved by the value iteration of pomdp-py: the same first action as ours."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from planner.search.pomdp import Pomdp, write_pomdp
from planner.search.search_problem import as_pomdp
from tests.oracles.point_based import solve
from tests.planner.search.pomdp_reader import read_pomdp
from tests.planner.search.problems import random_search

pytest.importorskip("pomdp_py")  # it has no wheel for newer Pythons

import pomdp_py
from pomdp_py.algorithms.value_iteration import ValueIteration


@dataclass(frozen=True)
class State(pomdp_py.State):
    number: int


@dataclass(frozen=True)
class Action(pomdp_py.Action):
    number: int


@dataclass(frozen=True)
class Observation(pomdp_py.Observation):
    number: int


def agent_of(pomdp: Pomdp) -> pomdp_py.Agent:
    """The same process as an agent of pomdp-py."""
    states = [State(k) for k in range(len(pomdp.states))]
    actions = [Action(k) for k in range(len(pomdp.actions))]
    observations = [Observation(k) for k in range(len(pomdp.observations))]

    class Transitions(pomdp_py.TransitionModel):
        def probability(self, after, state, action):
            return float(pomdp.transitions[action.number, state.number, after.number])

        def get_all_states(self):
            return states

    class Likelihoods(pomdp_py.ObservationModel):
        def probability(self, observation, after, action):
            return float(pomdp.likelihoods[action.number, after.number, observation.number])

        def get_all_observations(self):
            return observations

    class Rewards(pomdp_py.RewardModel):
        def sample(self, state, action, after):
            return float(pomdp.rewards[action.number, state.number])

    class Actions(pomdp_py.PolicyModel):
        def get_all_actions(self, state=None, history=None):
            return actions

    start = pomdp_py.Histogram({state: float(pomdp.start[state.number]) for state in states})
    return pomdp_py.Agent(start, Actions(), Transitions(), Likelihoods(), Rewards())


@pytest.mark.parametrize(
    ("seed", "wrong", "first"),
    [(0, 10.0, "declare"), (1, 60.0, "declare"), (2, 10.0, "look"), (5, 60.0, "look")],
)
def test_another_solver_begins_as_ours_does(
    tmp_path: Path, seed: int, wrong: float, first: str
) -> None:
    problem, belief = random_search(
        seed, places=2, viewpoints=1, hit=0.9, false_alarm=0.05, wrong=wrong
    )
    # With this discount, three steps are nearly all: pomdp-py tries each policy of three.
    exported = replace(as_pomdp(problem, belief), discount=0.2)
    pomdp = read_pomdp(write_pomdp(exported, tmp_path / "search.pomdp"))
    solver = ValueIteration(horizon=3, discount_factor=0.2, epsilon=1e-9)
    theirs = exported.actions[solver.plan(agent_of(pomdp)).number]
    ours = exported.actions[solve(exported, sweeps=300, tolerance=1e-9).action(exported.start)]
    assert ours == theirs
    assert ours.startswith(first)
