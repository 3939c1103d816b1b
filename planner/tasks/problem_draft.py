"""A problem while it is built, with the map's data that it is built from."""

from __future__ import annotations

from dataclasses import dataclass

from planner.routing_graph import RoutingGraph
from planner.tasks.problem import Problem
from planner.tasks.sites import Sites
from planner.tasks.world import TaskWorld


@dataclass(frozen=True)
class ProblemDraft:
    """What every step of building a problem reads; the steps fill `problem`."""

    graph: RoutingGraph
    world: TaskWorld
    sites: Sites
    problem: Problem

    @property
    def heights(self) -> tuple[float, float]:
        """The lowest and highest height that the robot reaches, metres."""
        return self.graph.robot.heights
