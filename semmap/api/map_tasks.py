"""What robots do: plans, missions, and searches for objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from semmap.api.checked import EntityName, Positive
from semmap.api.map_driving import MapDriving, Progress

if TYPE_CHECKING:
    from planner.mission.runner import MissionEvent
    from planner.mission.store.mission_list import MissionList
    from planner.robot_class import RobotClass
    from planner.search.problem_builder import Detector
    from planner.search.viewpoints import Sight
    from planner.simulated_run import SimulatedMission
    from semmap.api.map_results import MapPlan, ObjectSearch

AT_ONCE = 1e6
"""Speed of the simulated robot that tries a plan: nobody watches it."""


class MapTasks(MapDriving):
    """The part of `Map` about tasks."""

    def plan(
        self,
        goal: str,
        *,
        start: EntityName | None = None,
        robot: str | RobotClass | None = None,
        gripper: str | None = None,
        domain: Path | str | None = None,
        patience: Positive = 10.0,
        pddl: Path | str | None = None,
        assume_sizes: bool = False,
        try_grasps: bool = False,
    ) -> MapPlan:
        """The actions that reach a goal in the least time (Deeken et al., Figure 4).

        Parameters
        ----------
        goal : ``on(mug1, table1) and in(robot, kitchen)``: names, labels or types of the map
        start : the room, object, agent or region where the robot is; by default its place in the
            map, else the map's home region
        robot : a stored class, or a `planner.RobotClass`; by default that of the agent, else the
            body that `route` assumes
        gripper : by default the robot's own, or the preferred one, else an assumed one that opens
            0.09 m, as in missions
        domain : a YAML file of additional actions
        patience : seconds after which the best plan found so far is taken
        pddl : write ``domain.pddl`` and ``problem.pddl`` into this folder
        assume_sizes : give objects without geometry a typical box for their type
        try_grasps : carry the plan out in a copy of the map, each grasp in physics, as `run` does;
            it needs a login that may write

        Raises
        ------
        LookupError
            The map has no entity or robot of a name.
        ValueError
            The goal cannot be read, or no plan reaches it, also not in physics; the message says
            why.
        """
        from planner.readers.grasp_check import GraspCheck
        from planner.readers.robot_class import read_agent_class
        from planner.search.search_mission import SearchPlanner
        from planner.search.task_search import plan_with_search
        from planner.task_planner import TaskPlanner
        from planner.tasks.domain_file import read_domain
        from planner.tasks.pddl import write_pddl
        from planner.tasks.problem import NoPlanError
        from semmap.api.map_results import MapPlan
        from semmap.query.geometry_notes import read_names_without_geometry

        added = None if domain is None else read_domain(Path(domain))
        if robot is None:
            with self.snapshot() as seen:
                robot = read_agent_class(seen, start)
        agent = robot if isinstance(robot, str) else None
        live = self.live_topology(robot, assume_sizes=assume_sizes)
        tasks, search = TaskPlanner(live, added, gripper), SearchPlanner(live)
        with live.snapshot() as seen:
            found = plan_with_search(
                seen,
                tasks,
                search,
                goal,
                start,
                agent=agent,
                relations=() if added is None else added.relations,
                patience=patience,
            )
            if found is None or pddl is not None:
                task = tasks.task(seen, goal, start, agent=agent)
                if pddl is not None:
                    write_pddl(task.problem(), Path(pddl))
                found = found or (task.plan(patience), [])
            plan, reasons = found
            if search.assumed_camera is not None:
                reasons = [search.assumed_camera.capitalize(), *reasons]
            searched = {action.names[0] for action in plan.actions if action.name == "search"}
            items = [action.names[0] for action in plan.actions if action.name == "pickup"]
            items = [item for item in dict.fromkeys(items) if item not in searched]
            named = (agent, live.graph.robot.name)
            check = GraspCheck(seen, gripper=gripper, robots=named, assume_sizes=assume_sizes)
            reasons = [*reasons, *check.unjudged(items)]
            assumed: list[str] = []
            if assume_sizes:
                used = {name for action in plan.actions for name in action.names}
                assumed = [name for name in read_names_without_geometry(seen) if name in used]
        options = {"start": start, "robot": agent, "gripper": gripper, "domain": domain}
        options |= {"assume_sizes": assume_sizes}
        told: Any = {"reasons": tuple(reasons), "assumed": tuple(assumed)}
        told["assumed_body"] = live.assumed_body
        made = MapPlan.of(self, plan, **told, options=options)
        if try_grasps and items:
            if agent is None and robot is not None:
                raise ValueError("try_grasps is for stored robots: semmap robot add")
            tried = made.run(speed=AT_ONCE, try_grasps=True)
            self._write("SELECT drop_map(%s)", tried.map)  # the copy, with its mission
            tried.world.unlink(missing_ok=True)
            if not tried.done:
                raise NoPlanError(f"no plan for {goal} holds in simulation: {tried.reason}")
        return made

    def run(
        self,
        goal: str | None = None,
        *,
        start: EntityName | None = None,
        robot: str | None = None,
        agent: str = "robot",
        simulate: bool = True,
        speed: float = 20.0,
        fail: Sequence[str] = (),
        seed: int = 0,
        put: Sequence[str] = (),
        gripper: str | None = None,
        world: Path | str | None = None,
        apply: bool = False,
        domain: Path | str | None = None,
        try_grasps: bool | None = None,
        assume_sizes: bool = False,
        sight: Sight | None = None,
        detector: Detector | None = None,
        resume: bool = False,
        mission: int | None = None,
        on_event: Callable[[MissionEvent], None] | None = None,
        say: Callable[[str], object] | None = None,
    ) -> SimulatedMission:
        """Let a simulated robot pursue a goal, step by step, through failures and restarts.

        It happens in a copy of the map. A real robot runs missions with
        `planner.mission.runner.Runner` and its own behaviours.

        Parameters
        ----------
        goal : as for `plan`; none to resume a mission
        start : as for `plan`
        robot : a stored class; by default that of the agent, else the body of `route`
        agent : the name of the robot in the map
        speed : how many times faster than real time
        fail : failures: ``door3 locked``, ``Lift 1 broken``, ``pickup fails twice``
        seed : of random failures and detections
        put : where objects are in the simulated world: ``mug1 on table2``
        gripper : by default the robot's own, or the preferred one, else an assumed one that opens
            0.09 m
        world : a file for the state of the simulated world
        apply : change the map itself, in place of a copy
        domain : a YAML file of additional actions
        try_grasps : try each grasp in physics; by default where MuJoCo is installed
        assume_sizes : give objects without geometry a typical box for their type, in the copy; the
            answer names them
        resume : go on with a mission whose process has ended
        mission : the one to resume; by default the oldest
        sight, detector : of searches: the camera, and how well it recognises objects
        on_event, say : called with events, and with notes for a person

        Raises
        ------
        LookupError, ValueError
            A name is unknown, the goal cannot be read, or there is no mission to resume.
        """
        from planner.simulated_run import SimulatedRun
        from planner.tasks.domain_file import read_domain

        if not simulate:
            raise ValueError(
                "a map can only simulate a robot: simulate=True; a real robot runs missions with "
                "planner.mission.runner.Runner and its behaviours"
            )
        if resume == (goal is not None):
            raise ValueError("give either a goal, or resume=True")
        run = SimulatedRun(
            self,
            start,
            agent,
            robot,
            speed=speed,
            fail=fail,
            seed=seed,
            world=None if world is None else Path(world),
            apply=apply,
            domain=None if domain is None else read_domain(Path(domain)),
            put=put,
            gripper=gripper,
            sight=sight,
            detector=detector,
            try_grasps=try_grasps,
            assume_sizes=assume_sizes,
            on_event=on_event,
            say=say or (lambda text: None),
        )
        return run.run(goal, mission, resume=resume)

    def search(
        self,
        name: EntityName,
        *,
        start: EntityName | None = None,
        robot: str | None = None,
        sight: Sight | None = None,
        detector: Detector | None = None,
        progress: Progress | None = None,
    ) -> ObjectSearch:
        """Where to look for an object, and why (O'Neill, section 4.4.2).

        Parameters
        ----------
        name : of the object, or a type: the one of it whose search costs least
        start, robot : as for `plan`
        sight, detector : the robot's camera, by default that of its URDF, and how well it
            recognises objects
        progress : called with a place that is measured, its number, and the number of places

        Raises
        ------
        LookupError, ValueError
            The map has no such object, robot or start, or it cannot be searched for.
        """
        from planner.readers.robot_class import read_agent_class
        from planner.search.receding_horizon import cheapest, decide
        from planner.search.search_mission import SearchPlanner
        from planner.tasks.reader import read_state
        from semmap.api.map_results import ObjectSearch
        from semmap.belief.store.beliefs import read_belief, things_named

        if robot is None:
            with self.snapshot() as seen:
                robot = read_agent_class(seen, start)
        live = self.live_topology(robot)
        with live.snapshot() as seen:
            state = read_state(seen, live.topology, start)
            begin = live.graph.endpoint(state.place, state.pose)
            planner = SearchPlanner(live, sight, detector)
            names = things_named(seen, name)
            begun = [planner.begin(seen, each, begin, progress=progress) for each in names]
            best = cheapest([(each.problem, each.belief) for each in begun]) if names[1:] else 0
            name, problem = names[best], begun[best]
            belief = read_belief(seen, name)
        decision = decide(problem.problem, problem.belief)
        options = {"start": start, "robot": robot, "sight": sight, "detector": detector}
        assumptions = live.assumed_body, planner.assumed_camera
        return ObjectSearch(name, belief, problem, decision, self, options, *assumptions)

    def missions(self) -> list[dict[str, Any]]:
        """The missions of the map, the newest first, with the counts of their steps."""
        with self._missions() as store:
            return store.missions()

    def mission_steps(self, mission: int) -> list[dict[str, Any]]:
        """The steps of a mission in order: action, arguments, state, times, cause and message."""
        from planner.mission.store.mission_list import MissionError

        with self._missions() as store:
            if mission not in {row["id"] for row in store.missions()}:
                raise MissionError(f"there is no mission {mission}: `semmap missions` lists them")
            return store.steps(mission)

    def cancel_mission(self, mission: int) -> None:
        """Cancel a mission; its robot stops.

        ValueError if it does not exist, has ended, or belongs to another robot.
        """
        from planner.mission.store.mission_list import MissionError

        with self._missions() as store:
            if not store.cancel(mission):
                raise MissionError(
                    f"mission {mission} does not exist or has ended: `semmap missions` lists them"
                )

    def _missions(self) -> MissionList:
        from planner.mission.store.mission_list import MissionList

        return MissionList(self)
