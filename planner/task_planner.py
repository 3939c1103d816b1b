"""Plans tasks on the present state of a map: which actions reach a goal in the least time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import shapely

from planner.base_pose import NoBasePoseError, floor_spot, poses_in, poses_to_reach
from planner.live_topology import LiveTopology
from planner.location import LocatedEntity
from planner.mission.command import near
from planner.plan import Plan
from planner.readers.entity_lookup import find_entities
from planner.readers.grasp_check import grasp_check
from planner.robot_class import RobotClass
from planner.routing_graph import RoutingGraph
from planner.tasks.domain_file import Domain
from planner.tasks.goal import Goal, parse_goal
from planner.tasks.problem import NoPlanError, Problem
from planner.tasks.problem_builder import build_problem
from planner.tasks.reader import read_state, read_world
from planner.tasks.sites import ApproachPoseOf, Target
from planner.tasks.solver import PATIENCE, find_plan
from planner.tasks.world import TaskState, TaskWorld
from planner.topology import Place, PlaceRegion
from semmap.geometry.pose import Pose
from semmap.query.map_handle import MapSource
from semmap.query.snapshot import Snapshot


def plan_task(
    source: MapSource,
    goal: str,
    *,
    start: str | None = None,
    robot: str | RobotClass | None = None,
    domain: Domain | None = None,
    patience: float = PATIENCE,
) -> Plan:
    """The actions that reach a goal in the least time, on the present state of a map.

    Parameters
    ----------
    source, robot
        As for `planner.LiveTopology`.
    goal
        ``on(muffin, desk1) and in(robot, kitchen)``: names, labels or types of the map.
    start
        The room, agent or region in which the robot is; by default the robot of the map, or else
        its home.
    domain
        Additional actions.
    patience
        Seconds after which the best plan found so far is returned.

    Raises
    ------
    planner.tasks.GoalError
        The goal cannot be read, or contradicts itself.
    planner.tasks.NoPlanError
        No plan reaches the goal; the message says why.
    LookupError
        The map has no entity of a name, or the start is not clear.
    """
    live = LiveTopology(source, robot)
    with live.snapshot() as seen:
        return TaskPlanner(live, domain).task(seen, goal, start).plan(patience)


@dataclass(frozen=True)
class Task:
    """A goal, with all that a plan for it depends on."""

    graph: RoutingGraph  # travel times of the robot
    world: TaskWorld  # the objects that a plan can use
    state: TaskState  # where the robot is, and what it carries
    goal: Goal
    domain: Domain | None = None
    approach_pose: ApproachPoseOf | None = None  # None: before objects, in the middle of regions

    def plan(self, patience: float = PATIENCE) -> Plan:
        """The plan that takes the least time, or the best one found within `patience` seconds.

        Raises `planner.tasks.NoPlanError`.
        """
        return find_plan(**vars(self), patience=patience)

    def problem(self) -> Problem:
        """The facts that the solver is given; raises `planner.tasks.NoPlanError`."""
        return build_problem(**vars(self))


class TaskPlanner:
    """Plans tasks for a class of robots on a map that changes, with the actions of a domain file.

    `gripper` names a stored one; by default that of the robot or of the URDF of its class.
    """

    def __init__(
        self, live: LiveTopology, domain: Domain | None = None, gripper: str | None = None
    ) -> None:
        self._live = live
        self._domain = domain
        self._gripper = gripper

    def task(
        self,
        seen: Snapshot,
        goal: str,
        start: str | None = None,
        *,
        agent: str | None = None,
        without: frozenset[str] = frozenset(),
        tried: frozenset[tuple[str, Pose]] = frozenset(),
        believed: Mapping[str, str] = MappingProxyType({}),
    ) -> Task:
        """A task on the state of the map that a transaction sees; `start` is as for `plan_task`.

        `agent` names the agent that may carry objects. Plans do not use the objects, connectors and
        elevators `without`, nor the base poses `tried`, each with the object that the robot could
        not reach from it. `believed` has the places, objects or rooms, of objects that are not
        where the map has them.
        """
        parsed, domain = self._parsed(goal), self._domain
        graph = self._live.graph.without(without)
        state = read_state(seen, graph.topology, start)
        words = [] if domain is None else [*domain.words]
        words += [place for place in believed.values() if place not in graph.topology.places]
        heights = graph.robot.heights
        world = read_world(
            seen,
            parsed,
            graph.topology,
            heights,
            words=words,
            robot=agent,
            assume_sizes=self._live.assume_sizes,
        )
        self._refuse_needed(world, parsed, graph, without)
        usable = [
            world.at_place(o, believed[o.name], graph.topology) if o.name in believed else o
            for o in world.objects.values()
            if o.name not in without
        ]
        robots = (agent, graph.robot.name)
        misfit = grasp_check(seen, gripper=self._gripper, robots=robots)
        world = TaskWorld(usable, world.known, misfit)
        approach_pose = _approach_poses(seen, self._live, tried, believed)
        return Task(graph, world, state, parsed, domain, approach_pose)

    @staticmethod
    def _refuse_needed(
        world: TaskWorld, goal: Goal, graph: RoutingGraph, without: frozenset[str]
    ) -> None:
        """Raise NoPlanError for a word of a goal that stands for nothing but what is left out."""
        for word in goal.words():
            kind, names = world.find(word, graph.topology)
            if kind == "item" and without.issuperset(names):
                others = "" if names == [word.text] else f", and there is no other {word.text}"
                raise NoPlanError(f"the goal needs {' and '.join(names)}{others}")

    def __call__(
        self,
        seen: Snapshot,
        robot: str,
        goal: str,
        *,
        without: frozenset[str] = frozenset(),
        tried: frozenset[tuple[str, Pose]] = frozenset(),
    ) -> Plan:
        """The plan of a mission (`planner.mission.runner.Planner`)."""
        self._live.catch_up()
        return self.task(seen, goal, robot, agent=robot, without=without, tried=tried).plan()

    def _parsed(self, goal: str) -> Goal:
        return parse_goal(goal, () if self._domain is None else self._domain.relations)


def _approach_poses(
    seen: Snapshot,
    live: LiveTopology,
    tried: frozenset[tuple[str, Pose]],
    believed: Mapping[str, str],
) -> ApproachPoseOf | None:
    """Finds base poses on the costmaps that were not tried; None for a robot without shape.

    An object is reached at the place where it is `believed`.
    """
    costmaps = live.costmaps
    if costmaps is None:
        return None
    found: dict[tuple[str, tuple[str, ...]], Pose] = {}

    def poses(of: Target) -> list[Pose]:
        if isinstance(of, PlaceRegion):
            region = LocatedEntity(of.name, "region", of.places[0], footprint=of.outline)
            return poses_in(costmaps.ground(of.places[0]), region, np.random.default_rng(0))
        if isinstance(of, Place):
            return poses_to_reach(costmaps.ground(of.name), floor_spot(costmaps, of.name))
        name = believed.get(of.name, of.name)
        if name in live.topology.places:
            return poses_to_reach(costmaps.ground(name), floor_spot(costmaps, name))
        entity = find_entities(seen, name)[0]
        if of.assumed and of.pose is not None:
            (x, y), (depth, width, _) = of.pose[:2], of.size
            around = shapely.box(x - depth / 2, y - width / 2, x + depth / 2, y + width / 2)
            entity = replace(entity, footprint=around)
        ground = None if entity.place is None else costmaps.ground(entity.place)
        return poses_to_reach(ground, entity)

    def untried(name: str, poses: list[Pose]) -> Pose:
        bad = [pose for failed, pose in tried if failed == name]
        left = [pose for pose in poses if not any(near(pose, other) for other in bad)]
        if not left:
            raise NoBasePoseError(
                f"{live.graph.robot.name} has no other base pose for {name}: from "
                f"{len(poses)} it was tried"
            )
        return left[0]

    def approach_pose(of: Target) -> Pose:
        key = (of.name, of.places if isinstance(of, PlaceRegion) else ())
        if key not in found:
            found[key] = untried(of.name, poses(of))
        return found[key]

    return approach_pose
