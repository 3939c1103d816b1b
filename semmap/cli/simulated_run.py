"""Runs a mission with a simulated robot, for `semmap run` and `semmap search`."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from semmap import cli

if TYPE_CHECKING:
    from planner.mission.runner import MissionEvent, MissionResult
    from planner.mission.store.grasp_memory import GraspMemory
    from planner.mission.store.mission_list import MissionList
    from planner.search.problem_builder import Detector
    from planner.search.search_mission import SearchResult
    from planner.search.viewpoints import Sight

__all__ = ["SimulatedRun"]

_WORLDS = Path("out/missions")
"""Folder for the states of simulated worlds."""


@dataclass
class SimulatedRun:
    """The options of a run; see `semmap run --help`."""

    start: str | None
    robot: str
    robot_class: str | None
    speed: float = 20.0
    fail: Sequence[str] = ()
    seed: int = 0
    world: Path | None = None
    apply: bool = False
    domain_file: Path | None = None
    map_name: str | None = None
    json_: bool = False
    put: Sequence[str] = ()
    gripper: str | None = None
    sight: Sight | None = None
    detector: Detector | None = None
    try_grasps: bool | None = None
    assume_sizes: bool = False
    answers: dict[str, SearchResult] = field(default_factory=dict)

    def run(self, goal: str | None, mission: int | None = None, *, resume: bool = False) -> None:
        """Run a new mission with a goal, or resume one; print what happens.

        Raises
        ------
        typer.Exit
            The mission did not reach its goal.
        """
        from planner.live_topology import LiveTopology
        from planner.mission.failures import FailureRule
        from planner.mission.runner import Runner
        from planner.mission.sim_setup import entry_pose, open_world, simulated_robot
        from planner.mission.store.mission_list import MissionList
        from planner.mission.store.missions import MissionStore
        from planner.mission.store.simulation_map import simulation_map
        from planner.search.problem_builder import Detector
        from planner.search.search_mission import SearchPlanner
        from planner.search.setup import put_objects, searching_robot
        from planner.search.task_search import FOUND, SearchingPlanner, objects_to_find
        from planner.search.viewpoints import Sight
        from planner.task_planner import TaskPlanner
        from planner.tasks.domain_file import read_domain
        from planner.tasks.goal import parse_goal
        from semmap.query.map_handle import MapHandle

        grasps = self._grasps()
        rules = [FailureRule.parse(text) for text in self.fail]
        domain = None if self.domain_file is None else read_domain(self.domain_file)
        relations = ((FOUND, 1), *(() if domain is None else domain.relations))
        if goal is not None:
            parse_goal(goal, relations)
        process = f"{socket.gethostname()} {os.getpid()}"
        robot = self.robot
        with cli.database() as engine, ExitStack() as opened_here:
            with MissionList(engine, self.map_name) as missions:
                original = happens_in = missions.map_name
                number = _resumed(missions, mission) if resume else None
                if number is not None:
                    robot, happens_in = missions.robot_of(number), missions.map_of(number)
                    goal = missions.goal_of(number)
            if not (self.apply or resume):
                happens_in = opened_here.enter_context(simulation_map(engine, original, self.world))
            with engine.connect() as connection:
                cli.choose_map(connection, happens_in)
                grasps.check(connection, robot, self.robot_class)
            store = opened_here.enter_context(MissionStore(engine, happens_in, process, grasps))
            live = LiveTopology(
                MapHandle(engine, happens_in), self.robot_class, assume_sizes=self.assume_sizes
            )
            tasks = TaskPlanner(live, domain)
            assert goal is not None
            with live.snapshot() as connection:
                names = objects_to_find(connection, parse_goal(goal, relations))
            start = self.start
            if start is not None and number is not None:
                raise typer.BadParameter("a mission resumes where its robot is: leave out --from")
            if start is None and number is None and store.robot(robot) is None:
                start = store.home()
                if start is not None:
                    self._say(f"{robot} starts in {start}, where the map has a home region")
            if start is not None:
                live.topology.place(start)
                pose = entry_pose(live.topology, start)
                store.add_robot(robot, start, pose, self.robot_class)
            if number is None:
                number = store.add(robot, goal)
            file = self.world or _WORLDS / f"{original}-{number}.sqlite"
            if self.world is None and not resume:
                file.unlink(missing_ok=True)  # of a mission of another database
            opened = open_world(file, store, live.topology, robot, rules, resume=resume)
            with closing(opened) as sim_world:
                put_objects(sim_world, store, live, self.put)
                planner: Any = tasks
                body: Any
                if names:
                    sight, detector = self.sight or Sight(), self.detector or Detector()
                    search = SearchPlanner(live, sight, detector, self._say)
                    planner = SearchingPlanner(tasks, search, relations[1:])
                    body = searching_robot(
                        live,
                        sim_world,
                        robot,
                        names,
                        sight,
                        detector,
                        speed=self.speed,
                        seed=self.seed,
                    )
                    self.answers = search.answers
                else:
                    body = simulated_robot(live, sim_world, robot, speed=self.speed, seed=self.seed)
                runner = Runner(
                    store,
                    body,
                    planner,
                    speed=self.speed,
                    tick=min(0.05, 1.0 / self.speed),
                    on_event=None if self.json_ else _show_event,
                )
                result = runner.run(number)
            steps = store.steps(number)
        self._show(result, steps, file, happens_in, original)
        if result.state != "done":
            raise typer.Exit(1)

    def _grasps(self) -> GraspMemory:
        """Chooses grasps and places; tries them in simulation, as far as that is possible."""
        from planner.mission.store.grasp_memory import GraspMemory
        from semmap.manipulation.error import ManipulationError
        from semmap.manipulation.extra import library

        trial = self.try_grasps is not False
        try:
            if trial:
                library("mujoco")
        except ManipulationError as error:
            if self.try_grasps:
                raise
            self._say(f"grasps are not tried: {error}")
            trial = False
        seconds: float | None = GraspMemory.motion_seconds
        try:
            library("ompl")
        except ManipulationError as error:
            self._say(f"motions of arms are not planned: {error}")
            seconds = None
        return GraspMemory(
            self.gripper,
            simulated=True,
            trial=trial,
            lenient=self.try_grasps is not True,
            motion_seconds=seconds,
        )

    def _say(self, text: str) -> None:
        if not self.json_:
            cli.out.print(text, style="cyan")

    def _show(
        self,
        result: MissionResult,
        steps: list[dict[str, Any]],
        file: Path,
        happens_in: str,
        original: str,
    ) -> None:
        from planner.search.problem_builder import ELSEWHERE

        if self.json_:
            value = {
                "mission": result.mission,
                "state": result.state,
                "reason": result.reason,
                "world": str(file),
                "steps": steps,
                "map": happens_in,
            }
            if self.answers:
                value["found"] = {name: asdict(answer) for name, answer in self.answers.items()}
            print(json.dumps(value, default=str))
            return
        for name, answer in self.answers.items():
            if answer.place == ELSEWHERE:
                continue
            looks = "1 look" if answer.looks == 1 else f"{answer.looks} looks"
            how = f"seen there, after {looks}" if answer.seen else "not seen there"
            cli.out.print(f"{name} is at {answer.place} ({answer.probability:.0%}; {how})")
        if happens_in != original:
            cli.out.print(
                f"in {happens_in}; {original} is unchanged (--apply changes it)", style="dim"
            )


def _show_event(event: MissionEvent) -> None:
    """Print an event of a runner as a line."""
    number = "" if event.number is None else f"{event.number:>4}"
    if event.kind == "planned":
        cli.out.print(f"plan: {event.message}", style="dim")
    elif event.kind == "ended":
        message = f": {event.message}" if event.message else ""
        cli.out.print(f"{number} {event.command}{message}")
    elif event.kind == "failed" and event.command is not None:
        cli.out.print(f"{number} {event.command}: {event.message}", style="yellow")
    elif event.kind == "waits":
        cli.out.print(f"{number} waits: {event.message}", style="dim")
    elif event.command is None:
        message = f": {event.message}" if event.message else ""
        cli.out.print(f"{event.kind}{message}", style="bold")


def _resumed(missions: MissionList, mission: int | None) -> int:
    """The number of the mission to resume."""
    from planner.mission.store.map_connection import MissionError

    if mission is not None:
        return mission
    unfinished = missions.unfinished()
    if not unfinished:
        raise MissionError("there is no mission to resume: `semmap missions` lists them")
    return unfinished[0]
