"""Plans of missions: tasks by answer set programming on the map as it is now."""

from __future__ import annotations

from typing import Any

from planner.live import Live
from planner.mission.without import topology_without
from planner.plan import Plan
from planner.tasks.commands import base_stands
from planner.tasks.domain_file import Domain
from planner.tasks.goal import parse_goal
from planner.tasks.plan import plan_task
from planner.tasks.source import read_state, read_world
from planner.tasks.world import World

__all__ = ["TaskPlanner"]


class TaskPlanner:
    """Plans for a class of robots, on a topology that follows the map.

    Parameters
    ----------
    domain : actions that the user adds
    """

    def __init__(self, live: Live, domain: Domain | None = None) -> None:
        self._live = live
        self._domain = domain

    def check(self, goal: str) -> None:
        """Say at once what is wrong with a goal, before there is a mission for it.

        Raises
        ------
        ValueError
        """
        parse_goal(goal, self._domain.relations if self._domain else ())

    def __call__(
        self, connection: Any, robot: str, goal: str, *, without: frozenset[str] = frozenset()
    ) -> Plan:
        """The plan of least time, as `planner.mission.runner.Planner` says."""
        domain = self._domain
        asked = parse_goal(goal, domain.relations if domain else ())
        self._live.catch_up()
        network = self._live.network
        if without:
            network = topology_without(network.topology, without).network(
                network.robot, times=network.times, walks=network.walks
            )
        state = read_state(connection, network.topology, robot)
        world = read_world(
            connection, asked, network.topology, network.robot.heights,
            words=domain.words if domain else (), robot=robot,
        )  # fmt: skip
        left = [t for t in world.things.values() if t.name not in without]
        return plan_task(
            network, World(left, world.known), state, asked, domain=domain,
            stand=base_stands(connection, self._live),
        )  # fmt: skip
