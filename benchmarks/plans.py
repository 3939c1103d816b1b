"""Plans of tasks in large buildings: what grows is the building, not the logic program."""

from __future__ import annotations

import math
import tempfile
import warnings
from pathlib import Path

import numpy as np

from benchmarks.timing import Row, median_seconds, medians_in_turn, print_rows
from planner.routing_graph import RoutingGraph
from planner.tasks import TaskObject, TaskState, TaskWorld, find_plan, parse_goal
from planner.tasks.pddl import pddl, write_pddl
from planner.tasks.problem_builder import build_problem
from planner.topology import Place, PlaceConnector, Topology
from semmap.geometry.pose import Pose

__all__ = ["furnish", "main", "tower"]

PITCH = 6.0
STOREY = 4.0


def tower(rooms: int, seed: int = 3) -> Topology:
    """Storeys of 5 x 10 rooms that doors join in a lattice, one in ten walls without; one elevator.

    The elevator's cabin adds a place a storey.
    """
    random = np.random.default_rng(seed)
    across, deep = 10, 5
    places, connectors = [], []
    for storey in range(math.ceil(rooms / (across * deep))):
        z, name = STOREY * storey, f"storey{storey}"
        for x in range(across):
            for y in range(deep):
                places.append(Place(f"room{storey}-{x}-{y}", storey=name, floor=z))
                for dx, dy in ((1, 0), (0, 1)):
                    there = (x + dx, y + dy)
                    if there[0] == across or there[1] == deep:
                        continue
                    if random.random() < 0.1 and y > 0 and dy == 0:
                        continue
                    frame = Pose.planar(
                        PITCH * (x + dx / 2) + random.uniform(-1, 1) * dy,
                        PITCH * (y + dy / 2) + random.uniform(-1, 1) * dx,
                        math.atan2(dy, dx),
                        z,
                    )
                    connectors.append(
                        PlaceConnector(
                            f"door{storey}-{x}-{y}-{dy}",
                            (f"room{storey}-{x}-{y}", f"room{storey}-{there[0]}-{there[1]}"),
                            (
                                frame @ Pose.planar(-0.6, 0.0),
                                frame @ Pose.planar(0.6, 0.0, math.pi),
                            ),
                            state="closed" if random.random() < 0.1 else "open",
                        )
                    )
        places.append(Place(f"cabin{storey}", storey=name, elevator="elevator", floor=z))
        frame = Pose.planar(-PITCH / 2, PITCH * 2, math.pi, z)
        connectors.append(
            PlaceConnector(
                f"edoor{storey}",
                (f"room{storey}-0-2", f"cabin{storey}"),
                (frame @ Pose.planar(-0.6, 0.0), frame @ Pose.planar(0.6, 0.0, math.pi)),
                type="elevator_door",
                state="closed",
                behaviour="call_elevator",
            )
        )
    return Topology.of(places, connectors)


def furnish(topology: Topology, items: int = 201, seed: int = 5) -> TaskWorld:
    """Tables in random rooms, and on them items of ten types; one of them is the only muffin."""
    random = np.random.default_rng(seed)
    rooms = [p for p in topology.places.values() if p.elevator is None]
    found = []
    tables = []
    for i, k in enumerate(random.permutation(len(rooms))[: items // 2]):
        x, y = (int(v) for v in rooms[k].name.split("-")[1:])
        at = Pose(
            PITCH * x + random.uniform(-1.5, 1.5),
            PITCH * y + random.uniform(-1.5, 1.5),
            rooms[k].floor + 0.4,
        )
        tables.append(
            TaskObject(
                f"table{i}",
                ("table", "furniture"),
                None,
                rooms[k].name,
                rooms[k].name,
                at,
                height=0.4,
                size=(1.6, 0.8, 0.8),
                surface=1.0,
            )
        )
    for i in range(items - len(tables)):
        under = tables[int(random.integers(len(tables)))]
        assert under.pose is not None
        aside = random.uniform(-0.3, 0.3, 2)
        at = Pose(under.pose.x + aside[0], under.pose.y + aside[1], under.pose.z + 0.5)
        kind = "muffin" if i == 0 else f"kind{i % 10}"
        found.append(
            TaskObject(
                f"item{i}",
                (kind,),
                None,
                under.name,
                under.place,
                at,
                height=0.9,
                size=(0.1, 0.1, 0.1),
            )
        )
    return TaskWorld([*tables, *found])


def _row(graph: RoutingGraph, world: TaskWorld, goal: str, job: str, required: float) -> Row:
    state = TaskState("room0-5-2", Pose(PITCH * 5, PITCH * 2, 0.0))
    plan = find_plan(graph, world, state, goal)
    taken = 1e3 * median_seconds(lambda: find_plan(graph, world, state, goal), 7)
    proven = "proven optimal" if plan.optimal else f"gap {plan.gap:.0%}"
    return Row(
        job,
        f"{taken:.1f} ms",
        f"{len(plan.actions)} actions, {plan.seconds:.0f} s, {proven}",
        f"at most {required:g} ms",
        taken <= required and plan.optimal,
    )


def _pddl_row(graph: RoutingGraph, world: TaskWorld, goal: str, job: str) -> Row:
    """The PDDL of a task, beside unified-planning's writer of the same problem."""
    from unified_planning.io import PDDLReader, PDDLWriter

    state = TaskState("room0-5-2", Pose(PITCH * 5, PITCH * 2, 0.0))
    problem = build_problem(graph, world, state, parse_goal(goal))
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        task = PDDLReader().parse_problem(*map(str, write_pddl(problem, Path(folder))))

    def peer() -> tuple[str, str]:
        writer = PDDLWriter(task)
        return writer.get_domain(), writer.get_problem()

    ours, theirs = medians_in_turn(lambda: pddl(problem), peer)
    return Row(
        f"{job}: PDDL",
        f"{1e3 * ours:.2f} ms",
        f"unified-planning, from its own problem: {1e3 * theirs:.0f} ms",
        "at most 1/5",
        5 * ours <= theirs,
    )


def main() -> None:
    """Print the table."""
    small, large = tower(1000), tower(10000)
    rows = []
    for topology, count, required in ((small, "1,000", 50.0), (large, "10,000", 200.0)):
        graph, world = RoutingGraph(topology), furnish(topology)
        graph.graph.prepare()
        job = f"{count} rooms, {len(world.objects)} objects"
        rows.append(
            _row(graph, world, "on(muffin, table7)", f"{job}: on(muffin, table7)", required)
        )
        rows.append(
            _row(
                graph,
                world,
                "on(kind3, table7)",
                f"{job}: on(kind3, table7), the best of 10",
                required,
            )
        )
        if count == "1,000":
            goal = " and ".join(f"on(item{3 * i}, table{5 * i + 2})" for i in range(1, 6))
            rows.append(_row(graph, world, goal, f"{job}: five objects", 200.0))
            rows.append(_pddl_row(graph, world, goal, f"{job}: five objects"))
    print_rows("Plans", rows)


if __name__ == "__main__":
    main()
