"""Runs a mission with a simulated robot, in a copy of the map or in the map itself."""

from __future__ import annotations

import math
import os
import socket
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from navgrid.grid import file_name
from planner.live_topology import LiveTopology
from planner.mission.failures import FailureRule
from planner.mission.runner import MissionEvent, Runner
from planner.mission.sim_setup import entry_poses, open_world, simulated_robot
from planner.mission.store.grasp_memory import GraspMemory
from planner.mission.store.mission_list import MissionError, MissionList
from planner.mission.store.missions import MissionStore
from planner.mission.store.simulation_map import simulation_map, store_assumed_sizes
from planner.readers.robot_class import read_agent_class, read_robot_class
from planner.readers.topology import read_topology
from planner.search.problem_builder import Detector
from planner.search.reader import read_believed_object
from planner.search.search_mission import SearchPlanner, SearchResult
from planner.search.sim_search import find_spots, searching_robot
from planner.search.task_search import FOUND, SearchingPlanner, objects_to_find
from planner.search.viewpoints import Sight
from planner.task_planner import TaskPlanner
from planner.tasks.domain_file import Domain
from planner.tasks.goal import ROBOT, Goal, parse_goal
from planner.tasks.reader import read_world
from planner.topology import Topology
from semmap.database.maps import see_map
from semmap.query.geometry_notes import names_note
from semmap.query.map_handle import MapHandle, MapSource
from semmap.query.snapshot import Snapshot

_WORLDS = Path("out/missions")  # folder for the states of simulated worlds


@dataclass(frozen=True)
class SimulatedMission:
    """How a simulated mission ended; `state` is done, failed or cancelled, `reason` says why.

    Each step has its action, arguments, state, times, cause and message. `searches` has how each
    search ended, by object; `assumed` has the objects with the assumed box of their type.
    """

    mission: int
    state: str
    reason: str | None
    steps: list[dict[str, Any]] = field(repr=False)
    world: Path  # the file with the state of the simulated world
    map: str  # in which it happened
    original: str  # the map that was asked for
    searches: dict[str, SearchResult] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)

    @property
    def done(self) -> bool:
        """Whether the goal was reached."""
        return self.state == "done"

    @property
    def found(self) -> dict[str, SearchResult]:
        """The searches that found their object, with its place."""
        return {name: result for name, result in self.searches.items() if result.found}

    @property
    def not_found(self) -> dict[str, SearchResult]:
        """The searches that did not find their object, with where they looked."""
        return {name: result for name, result in self.searches.items() if not result.found}

    def as_json(self) -> dict[str, Any]:
        """How it ended, with its steps, as plain values."""
        told = {
            "mission": self.mission,
            "simulated": True,
            "map": self.map,
            "state": self.state,
            "reason": self.reason,
            "world": str(self.world),
            "steps": self.steps,
        }
        if self.assumed:
            told["assumed_sizes"] = self.assumed
        for kind in ("found", "not_found"):
            if results := getattr(self, kind):
                told[kind] = {name: asdict(result) for name, result in results.items()}
        return told


@dataclass
class SimulatedRun:
    """How a simulated robot pursues goals."""

    source: MapSource
    start: str | None = None  # a room, object or region; by default where the robot is, or its home
    robot: str = "robot"  # name of the agent
    robot_class: str | None = None  # a stored class; by default that of the agent, else `BODY`
    speed: float = 20.0  # how many times faster than real time
    fail: Sequence[str] = ()  # as `planner.mission.failures.FailureRule` reads them
    seed: int = 0  # of the simulation's chance
    world: Path | None = None  # for the state of the simulated world
    apply: bool = False  # change the map itself, not a copy
    domain: Domain | None = None
    put: Sequence[str] = ()  # where objects are in the simulated world: 'mug on table2'
    gripper: str | None = None  # by default the robot's own or the preferred one
    sight: Sight | None = None
    detector: Detector | None = None
    try_grasps: bool | None = None  # in physics; by default where MuJoCo is installed
    assume_sizes: bool = False  # objects without geometry have a typical box, in the copy
    on_event: Callable[[MissionEvent], None] | None = None
    say: Callable[[str], object] = lambda text: None  # called with notes for a person

    def run(
        self, goal: str | None, mission: int | None = None, *, resume: bool = False
    ) -> SimulatedMission:
        """Run a new mission with a goal, or resume one.

        Raises MissionError if there is no such mission, `planner.tasks.GoalError` if the goal
        cannot be read.
        """
        if not self.speed > 0:
            raise MissionError(f"speed is {self.speed}: give a number above 0; 1 is real time")
        if self.assume_sizes and self.apply:
            raise MissionError("what is assumed is not written into a map: leave out one of both")
        grasps = self._grasps()
        rules = [FailureRule.parse(text) for text in self.fail]
        relations = ((FOUND, 1), *(() if self.domain is None else self.domain.relations))
        if goal is not None:
            parse_goal(goal, relations)
        engine, robot = self.source.engine, self.robot
        process = f"{socket.gethostname()} {os.getpid()}"
        with ExitStack() as opened_here:
            with MissionList(self.source) as missions:
                original = happens_in = missions.map_name
                number = _resumed(missions, mission) if resume else None
                if number is not None:
                    known = missions.mission(number)
                    robot, happens_in, goal = known.robot, known.map, known.goal
            with engine.connect() as connection:
                see_map(connection, happens_in)
                self._check(Snapshot.of(connection, happens_in), rules)
            if not (self.apply or resume):
                happens_in = opened_here.enter_context(simulation_map(engine, original, self.world))
            assumed: list[str] = []
            if self.assume_sizes and not resume:
                with engine.begin() as connection:
                    see_map(connection, happens_in)
                    assumed = store_assumed_sizes(Snapshot.of(connection, happens_in))
                self.say(names_note(assumed, "assumed_sizes") if assumed else "no size is assumed")
            with engine.connect() as connection:
                see_map(connection, happens_in)
                known_class = read_agent_class(Snapshot.of(connection, happens_in), robot)
                robot_class = self.robot_class or known_class
                grasps.check(connection, robot, robot_class)
            copy = MapHandle(engine, happens_in)
            store = opened_here.enter_context(MissionStore(copy, process, grasps))
            live = LiveTopology(copy, robot_class)
            if live.assumed_body is not None:
                self.say(live.assumed_body)
            tasks = TaskPlanner(live, self.domain, self.gripper)
            assert goal is not None
            with live.snapshot() as seen:
                names, _ = objects_to_find(seen, parse_goal(goal, relations))
                for name in names:
                    read_believed_object(seen, name)  # refuses a name that is unknown
                if number is None:
                    _refuse_unknown(seen, live.topology, parse_goal(goal, relations), names)
            spots = find_spots(store, live, self.put)
            plans = tasks if not names and number is None else None
            self._place_robot(store, live, robot, goal, plans, new=number is None)
            stem = file_name(original)
            file = self.world or _WORLDS / f"{stem}-{number}.sqlite"
            if self.world is None and number is None:
                file = _WORLDS / f"{stem}-new-{os.getpid()}.sqlite"
                file.unlink(missing_ok=True)
                opened_here.callback(file.unlink, missing_ok=True)
            opened = open_world(file, store, live.topology, robot, rules, resume=resume)
            with closing(opened) as sim_world:
                for spot in spots:
                    sim_world.put_object(*spot)
                body, planner, searches = self._actors(
                    live, sim_world, robot, names, tasks, relations
                )
                if number is None:  # at last, so that what is refused leaves no mission behind
                    number = store.add(robot, goal)
                    if self.world is None:
                        sim_world.move(_WORLDS / f"{stem}-{number}.sqlite")
                runner = Runner(store, body, planner, speed=self.speed, on_event=self.on_event)
                runner.tick = min(0.05, 1.0 / self.speed)
                result = runner.run(number)
            ended = result.mission, result.state, result.reason, store.steps(number)
            where = sim_world.path, happens_in, original
            return SimulatedMission(*ended, *where, searches, assumed)

    def _check(self, seen: Snapshot, rules: Sequence[FailureRule]) -> None:
        """Raise LookupError for options that name what the map does not have."""
        topology = read_topology(seen)
        for rule in rules:
            rule.check(topology)
        if self.start is not None:
            topology.place(self.start)
        if self.robot_class is not None:
            read_robot_class(seen, self.robot_class)

    def _place_robot(
        self,
        store: MissionStore,
        live: LiveTopology,
        robot: str,
        goal: str,
        tasks: TaskPlanner | None,
        *,
        new: bool,
    ) -> None:
        """Put the robot where it starts, unless the map knows where it is.

        In a room of several parts, it is in the first one from which tasks have a plan.
        """
        start = self.start
        if start is not None and not new:
            raise MissionError("a mission resumes where its robot is: leave out start=")
        if start is None and new and store.robot(robot) is None:
            start = store.home()
            if start is not None:
                self.say(f"{robot} starts in {start}, where the map has a home region")
        if start is None and new and store.robot(robot) is None:
            raise MissionError(
                f"there is no robot named {robot} in a room of {store.map_name}: place an agent of "
                "that name, or give its start by start="
            )
        if start is not None:
            live.topology.place(start)
            first, *others = entry_poses(live.graph, start)
            store.add_robot(robot, start, first)
        if self.robot_class is not None:
            store.state_class(robot, self.robot_class)
        if start is None or tasks is None or not others:
            return
        for pose in (first, *others, first):
            store.add_robot(robot, start, pose)
            with suppress(ValueError, LookupError), live.snapshot() as seen:
                tasks(seen, robot, goal)
                return

    def _actors(
        self,
        live: LiveTopology,
        sim_world: Any,
        robot: str,
        names: Sequence[str],
        tasks: TaskPlanner,
        relations: Sequence[tuple[str, int]],
    ) -> tuple[Any, Any, dict[str, SearchResult]]:
        """The simulated robot, its planner, and where the ends of its searches appear."""
        motion: Any = {"speed": self.speed, "seed": self.seed}
        if not names:
            return simulated_robot(live, sim_world, robot, **motion), tasks, {}
        detector = self.detector or Detector()
        search = SearchPlanner(live, self.sight, detector, self.say)
        with live.snapshot() as seen:
            sight = search.camera(seen)
        if search.assumed_camera is not None:
            self.say(search.assumed_camera)
        body = searching_robot(live, sim_world, robot, names, sight, detector, **motion)
        return body, SearchingPlanner(tasks, search, relations[1:]), search.answers

    def _grasps(self) -> GraspMemory:
        """Chooses grasps and places; tries them in simulation, as far as that is possible."""
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.extra import library

        trial = self.try_grasps is not False
        try:
            if trial:
                library("mujoco")
        except ManipulationError as error:
            if self.try_grasps:
                raise
            self.say(f"grasps are not tried: {error}")
            trial = False
        seconds: float | None = GraspMemory.motion_seconds
        try:
            library("ompl")
        except ManipulationError as error:
            self.say(f"motions of arms are not planned: {error}")
            seconds = None
        return GraspMemory(self.gripper, simulated=True, trial=trial, motion_seconds=seconds)


def _refuse_unknown(
    seen: Snapshot, topology: Topology, goal: Goal, searched: Sequence[str]
) -> None:
    """Raise `UnknownObjectError` for a word of a goal that stands for nothing in the map."""
    world = read_world(seen, goal, topology, (-math.inf, math.inf))
    for word in goal.words():
        if word.text not in (ROBOT, *searched):
            world.find(word, topology)


def _resumed(missions: MissionList, mission: int | None) -> int:
    """The number of the mission to resume."""
    if mission is not None:
        return mission
    unfinished = missions.unfinished()
    if not unfinished:
        raise MissionError("there is no mission to resume: `semmap missions` lists them")
    return unfinished[0]
