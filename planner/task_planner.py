"""Plans tasks on the present state of a map: which actions reach a goal in the least time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import shapely

from planner.base_pose import (
    NoBasePoseError,
    RoomGround,
    facing_poses,
    floor_spot,
    free_stances,
    poses_in,
    poses_to_reach,
)
from planner.live_topology import LiveTopology
from planner.location import LocatedEntity
from planner.mission.command import near
from planner.plan import Plan
from planner.readers.entity_lookup import find_entities
from planner.readers.grasp_check import GraspCheck
from planner.robot_class import RobotClass
from planner.route_search import seconds_between
from planner.routing_graph import RoutingGraph
from planner.tasks.domain_file import Domain
from planner.tasks.goal import Goal, parse_goal
from planner.tasks.problem import NoPlanError, Problem
from planner.tasks.problem_builder import build_problem
from planner.tasks.reader import read_state, read_world
from planner.tasks.sites import ApproachPosesOf, Target, stand
from planner.tasks.solver import PATIENCE, find_plan
from planner.tasks.world import TaskObject, TaskState, TaskWorld
from planner.topology import Place, PlaceRegion
from semmap.geometry.pose import Pose
from semmap.query.map_handle import MapSource
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    from semmap.manipulation.arm_reach import ArmReach

BAND = 0.2  # metres of distance to an object in which the arm is asked about one pose a side
ASKED = 24  # the most base poses about which the arm is asked
COMPARED = 3  # base poses from which the arm acts that are compared


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
    approach_poses: ApproachPosesOf | None = None  # None: before objects, in the middle of regions

    def plan(self, patience: float = PATIENCE) -> Plan:
        """The plan that takes the least time, or the best one found within `patience` seconds.

        A robot somewhere in a room that furniture divides is in a part from which there is a plan.
        Raises `planner.tasks.NoPlanError`.
        """
        try:
            return find_plan(**vars(self), patience=patience)
        except NoPlanError:
            for pose in self._parts_of_start():
                with suppress(NoPlanError):
                    state = replace(self.state, pose=pose)
                    return find_plan(**vars(replace(self, state=state)), patience=patience)
            raise

    def _parts_of_start(self) -> Iterator[Pose]:
        """A pose in each part of the place where the robot is, if no way joins the parts."""
        doors = [self.graph.poses[n] for n in self.graph.nodes.get(self.state.place, ())]
        if self.state.pose is not None or len(doors) < 2:
            return
        ends = self.graph.endpoints([(self.state.place, pose) for pose in doors])
        joined = np.isfinite(seconds_between(self.graph, ends, ends))
        firsts = (joined & joined.T).argmax(axis=1)
        if firsts.any():
            yield from (doors[n] for n in np.unique(firsts))

    def problem(self) -> Problem:
        """The facts that the solver is given; raises `planner.tasks.NoPlanError`."""
        return build_problem(**vars(self))


class TaskPlanner:
    """Plans tasks for a class of robots on a map that changes, with the actions of a domain file.

    `gripper` names a stored one; by default that of the robot or of the URDF of its class, else the
    preferred one or the only one of no robot, else an assumed one.
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
        domain = self._domain
        parsed = parse_goal(goal, () if domain is None else domain.relations)
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
        check = GraspCheck(
            seen, gripper=self._gripper, robots=robots, assume_sizes=self._live.assume_sizes
        )

        def misfit(item: str) -> str | None:
            elsewhere = item in believed or world.objects[item].assumed
            return check.misfit(item, moved=elsewhere or bool(world.above.get(item)))

        def no_place(item: str, on: str, inside: bool, is_open: bool) -> str | None:
            if item in believed or on in believed:
                return None
            floor = graph.topology.places.get(world.objects[on].place or "")
            above = 0.0 if floor is None else floor.floor
            return check.no_place(item, on, heights, above, inside=inside, is_open=is_open)

        world = TaskWorld(usable, world.known, misfit, no_place)
        approach_poses = _approach_poses(seen, self._live, world, check, tried, believed)
        return Task(graph, world, state, parsed, domain, approach_poses)

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


def _approach_poses(
    seen: Snapshot,
    live: LiveTopology,
    world: TaskWorld,
    check: GraspCheck,
    tried: frozenset[tuple[str, Pose]],
    believed: Mapping[str, str],
) -> ApproachPosesOf | None:
    """Finds base poses on the costmaps that were not tried, and from which the robot's arm acts.

    None for a robot that is a point. A robot without shape crosses places without an outline
    straight, and stands at the object there. An object is reached at the place where it is
    `believed`. The arm is asked about objects whose poses are known, not about floors.
    """
    costmaps = live.costmaps
    if costmaps is None:
        return None
    robot = live.graph.robot

    def poses(of: Target) -> list[Pose]:
        if isinstance(of, PlaceRegion):
            region = LocatedEntity(of.name, "region", of.places[0], footprint=of.outline)
            return poses_in(costmaps.ground(of.places[0]), region, np.random.default_rng(0))
        if isinstance(of, Place):
            return poses_to_reach(costmaps.ground(of.name), floor_spot(costmaps, of.name))
        place = believed.get(of.name, of.name)
        if place in live.topology.places:
            return poses_to_reach(costmaps.ground(place), floor_spot(costmaps, place))
        return poses_to_reach(*located(of))

    def located(item: TaskObject) -> tuple[RoomGround | None, LocatedEntity]:
        name = believed.get(item.name, item.name)
        entity = next(iter(find_entities(seen, name)), None)
        if entity is None:  # another one renamed or deleted it just now
            raise LookupError(f"the map has no {name} any more")
        if item.assumed and item.pose is not None:
            (x, y), (depth, width, _) = item.pose[:2], item.size
            around = shapely.box(x - depth / 2, y - width / 2, x + depth / 2, y + width / 2)
            entity = replace(entity, footprint=around)
        return None if entity.place is None else costmaps.ground(entity.place), entity

    def untried(name: str, poses: Iterable[Pose]) -> Iterator[Pose]:
        bad = [pose for failed, pose in tried if failed == name]
        seen_before = 0
        for pose in poses:
            if any(near(pose, other) for other in bad):
                seen_before += 1
            else:
                yield pose
        if seen_before:
            raise NoBasePoseError(
                f"{robot.name} has no other base pose for {name}: from {seen_before} it was tried"
            )

    def within_reach(item: TaskObject) -> Iterator[Pose] | None:
        """The base poses from which the arm acts on an object; None where that is not known."""
        if item.name in believed or check.arm is None:
            return None
        carried = item.obstacle(robot.heights) is None
        reach = check.reach(item.name, carried=carried, beneath=bool(world.above.get(item.name)))
        return None if reach is None else acting(item, carried, reach)

    def acting(item: TaskObject, carried: bool, reach: ArmReach) -> Iterator[Pose]:
        """First poses that face the object, unless the arm needs its base to get to a grasp.

        Of each few from which the arm acts, those come first where that costs least.
        """
        number, found = 0, False
        why: NoBasePoseError | None = None
        for poses in (facing(item, reach), placed_by_arm(item, reach)):
            acts: list[tuple[float, int, Pose]] = []
            try:
                for cost, pose in poses:
                    number += 1
                    if cost is not None:
                        found = True
                        acts.append((cost, number, pose))
                    if len(acts) == COMPARED:
                        yield from (pose for *_, pose in sorted(acts))
                        acts = []
            except NoBasePoseError as error:
                why = why or error
            yield from (pose for *_, pose in sorted(acts))
            if found:
                return
        if not number and why is not None:
            raise why
        assert check.arm is not None
        name = item.name
        what = f"takes {name} by no grasp" if carried else f"gets over no part of {name}"
        tried = f"was tried from {number} free base poses" if number else "no base is free for that"
        raise NoBasePoseError(
            f"{name} is out of reach: the arm of {check.arm[0]} {what}; it reaches {reach.side}, "
            f"and {tried}"
        )

    def facing(item: TaskObject, reach: ArmReach) -> Iterator[tuple[float | None, Pose]]:
        if reach.arm.needs_base:
            return
        around = untried(item.name, facing_poses(*located(item), BAND))
        yield from ((reach.cost(pose), pose) for pose in islice(around, ASKED))

    def placed_by_arm(item: TaskObject, reach: ArmReach) -> Iterator[tuple[float | None, Pose]]:
        ground, entity = located(item)
        bases, which = reach.stances(0.0 if ground is None else ground.floor)
        numbers: dict[Pose, int] = {}

        def stances() -> Iterator[Pose]:
            for number, pose in free_stances(ground, entity, bases, BAND):
                numbers[pose] = int(which[number])
                yield pose

        around = untried(item.name, stances())
        yield from ((reach.cost_of(numbers[pose], pose), pose) for pose in islice(around, ASKED))

    def approach_poses(of: Target) -> Iterable[Pose]:
        place = of.place if isinstance(of, TaskObject) else of.name
        place = of.places[0] if isinstance(of, PlaceRegion) else place
        if costmaps.straight and place is not None and costmaps.ground(place) is None:
            return stand(of)
        reached = within_reach(of) if isinstance(of, TaskObject) else None
        return untried(of.name, poses(of)) if reached is None else reached

    return approach_poses
