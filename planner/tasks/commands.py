"""What tasks add to the command line: `semmap plan`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from planner.base_pose import NoBasePoseError, poses_to_reach
from planner.live import Live
from planner.network import Network
from planner.plan import Action, Plan
from planner.source.meant import read_targets
from planner.tasks.domain_file import Domain, read_domain
from planner.tasks.goal import parse_goal
from planner.tasks.pddl import write_pddl
from planner.tasks.plan import PATIENCE, plan_task
from planner.tasks.posing import pose_problem
from planner.tasks.sites import StandOf
from planner.tasks.source import read_state, read_world
from planner.tasks.world import Thing
from semmap import cli
from semmap.geometry.pose import Pose

__all__ = ["plan_as_json", "plan_command"]


def plan_command(
    goal: Annotated[str, typer.Argument(help="on(muffin, desk1) and in(robot, kitchen), ...")],
    start: Annotated[
        str | None, typer.Option("--from", help="The room it is in; else where the map has it.")
    ] = None,
    map_name: cli.MapName = None,
    robot: Annotated[str | None, typer.Option(help="A class of robots: semmap robot.")] = None,
    domain_file: Annotated[
        Path | None, typer.Option("--domain", help="Actions of your own, a YAML file.")
    ] = None,
    pddl: Annotated[
        Path | None, typer.Option(help="Write domain.pddl and problem.pddl into this folder.")
    ] = None,
    patience: Annotated[
        float, typer.Option(help="Seconds after which the best plan found is taken.")
    ] = PATIENCE,
    json_: cli.Json = False,
) -> None:
    """Plan a task: the actions that reach a goal in the least time."""
    domain = None if domain_file is None else read_domain(domain_file)
    asked = parse_goal(goal, domain.relations if domain else ())
    with cli.database() as engine:
        live = Live(engine, map_name, robot)
        with engine.connect() as connection:
            cli.choose_map(connection, map_name)
            state = read_state(connection, live.topology, start)
            world = read_world(
                connection, asked, live.topology, live.network.robot.heights,
                words=domain.words if domain else (), robot=robot,
            )  # fmt: skip
            stand = base_stands(connection, live)
            if pddl is not None:
                problem = pose_problem(
                    live.network, world, state, asked, stand=stand, extend=_extend(domain)
                )
                written = write_pddl(problem, pddl)
                if not json_:
                    cli.out.print(f"{written[0]}, {written[1]}")
            found = plan_task(
                live.network, world, state, asked, domain=domain, stand=stand, patience=patience
            )
    if json_:
        print(json.dumps(plan_as_json(found)))
    else:
        show_plan(found)


def _extend(domain: Domain | None) -> Any:
    return None if domain is None else domain.extend


def base_stands(connection: Any, live: Live) -> StandOf | None:
    """Where the robot's base stands for things: on its costmaps, where it has a shape."""
    ground = live.ground
    if ground is None:
        return None
    found: dict[str, Pose | None] = {}

    def stand(thing: Thing) -> Pose | None:
        if thing.name not in found:
            target = next((t for t in read_targets(connection, thing.name)), None)
            try:
                poses = [] if target is None else poses_to_reach(ground, target)
            except NoBasePoseError:
                poses = []
            found[thing.name] = _nearest_door(live.network, thing, poses)
        return found[thing.name]

    return stand


def _nearest_door(network: Network, thing: Thing, poses: list[Pose]) -> Pose | None:
    """Of several free poses the first; where there is none, that of the thing: out of reach."""
    return poses[0] if poses else thing.pose


def plan_as_json(found: Plan) -> dict[str, Any]:
    """The plan as plain values; poses as x, y, z and quaternion."""
    return {
        "goal": found.goal,
        "seconds": found.seconds,
        "bound": found.bound,
        "optimal": found.optimal,
        "actions": [_action(action) for action in found.actions],
    }


def _action(action: Action) -> dict[str, Any]:
    return {
        "name": action.name,
        "arguments": list(action.arguments),
        "entities": list(action.names),
        "seconds": action.seconds,
        "at": None if action.at is None else action.at._asdict(),
        "steps": [
            {
                "behaviour": step.behaviour,
                "connector": step.connector.name if step.connector else None,
                "elevator": step.elevator,
                "from": step.from_place,
                "to": step.to_place,
                "approach": None if step.approach is None else step.approach._asdict(),
                "leave": step.leave._asdict(),
                "seconds": step.seconds,
                "map": step.map,
            }
            for step in action.steps
        ],
    }


def show_plan(found: Plan) -> None:
    """The plan as Figure 4 prints it, with seconds."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("", justify="right")
    table.add_column("action", overflow="fold")
    table.add_column("seconds", justify="right")
    for number, action in enumerate(found.actions, 1):
        table.add_row(str(number), str(action), f"{action.seconds:.1f}")
    if found.actions:
        cli.out.print(table)
    proof = (
        "no plan is shorter" if found.optimal
        else f"at most {found.gap:.0%} longer than the shortest, of {found.bound:.1f} s or more"
    )  # fmt: skip
    done = f"{found.seconds:.1f} s" if found.actions else "nothing to do: it is so by now"
    cli.out.print(f"{found.goal}: {done} ({proof})")
