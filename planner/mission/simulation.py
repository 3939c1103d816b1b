"""A simulated world in a file, and the robot in it, made of the map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from planner.live import Live
from planner.mission.failures import FailureRule
from planner.mission.journal import Journal, MissionError
from planner.mission.sim import SimulatedRobot
from planner.mission.truth import Truth
from planner.topology import Topology
from semmap.geometry.pose import Pose

__all__ = ["entry", "open_world", "simulated_robot"]

_NOWHERE = "no room holds {}: say where it starts (--from)"


def entry(topology: Topology, place: str) -> Pose:
    """Where a robot can stand in a place: before its first door.

    Raises
    ------
    MissionError
    """
    doors = topology.doors_of(place)
    if not doors:
        raise MissionError(f"{place} has no door: a robot in it would never leave it")
    connector, side = doors[0]
    return connector.poses[side]


def open_world(
    file: Path,
    journal: Journal,
    topology: Topology,
    robot: str,
    rules: Sequence[FailureRule] = (),
    *,
    resume: bool = False,
) -> Truth:
    """What is true in a file, with the robot in it; made from the map where there is no file.

    Raises
    ------
    MissionError
        Nothing says where the robot is, or there is nothing to resume.
    """
    where = journal.robot(robot)
    if file.is_file():
        truth = Truth(file)
        if where is None and not truth.has_robot(robot):
            truth.close()
            raise MissionError(_NOWHERE.format(robot))
        truth.add_rules(rules)
    elif resume:
        raise MissionError(f"{file}, where the simulated robot is, is gone: name its --world")
    elif where is None:
        raise MissionError(_NOWHERE.format(robot))
    else:
        file.parent.mkdir(parents=True, exist_ok=True)
        things = [(t.name, t.place, t.seen) for t in journal.things()]
        truth = Truth.make(file, topology, things, rules)
    if where is not None and not truth.has_robot(robot):
        truth.put_robot(robot, *where)
    return truth


def simulated_robot(
    live: Live, truth: Truth, name: str, *, speed: float, seed: int = 0
) -> SimulatedRobot:
    """A robot of the class that a topology is for, on its costmaps; `speed` times as fast."""
    return SimulatedRobot(
        name, truth, live.topology, speed=speed, seed=seed, velocity=live.network.robot.speed,
        way=live.ground.path if live.ground is not None else None,
    )  # fmt: skip
