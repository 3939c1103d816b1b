"""Makes the simulated world of a map, in a file, and a robot in it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from planner.base_pose import NoBasePoseError, poses_in
from planner.live_topology import LiveTopology
from planner.location import LocatedEntity
from planner.mission.failures import FailureRule
from planner.mission.sim_robot import SimulatedRobot
from planner.mission.sim_world import SimWorld
from planner.mission.store.mission_list import MissionError
from planner.mission.store.missions import MissionStore
from planner.routing_graph import RoutingGraph
from planner.storey_costmaps import StoreyCostmaps
from planner.topology import Topology
from semmap.geometry.pose import Pose

_NOWHERE = "no room holds {}: give its start by start="


def entry_poses(graph: RoutingGraph, place: str) -> list[Pose]:
    """Where a robot may begin in a place: at a door of each part of it, the best first.

    From one pose of a part the robot drives to all others. Poses from which most doors are reached
    come first, of these ones at doors that nothing closes, and none at a door that something
    obstructs. In a place without other doors, it is a free pose. MissionError if there is neither.
    """
    nodes = graph.nodes.get(place, np.empty(0, np.int64))
    costs, seconds = graph.costs, graph.endpoint(place).seconds
    clear = [costs.obstruction(place, graph.poses[int(node)]) is None for node in nodes]
    ground = costs.ground(place) if isinstance(costs, StoreyCostmaps) else None
    if not any(clear) and ground is not None:
        inside = shapely.multipoints(ground.free()[1]).envelope
        room = LocatedEntity(place, "room", place, footprint=inside)
        with suppress(NoBasePoseError):
            return poses_in(ground, room, np.random.default_rng(0), 1)
    if not len(nodes):
        raise MissionError(f"{place} has no door: a robot cannot leave it; add a connector")
    travel = graph.travel_edges.get(place, slice(0))
    joined = np.isfinite(graph.seconds[travel])
    tails, heads = (ends[travel][joined] for ends in (graph.tails, graph.heads))
    reached = np.array([np.count_nonzero(tails == node) for node in nodes])
    found: list[int] = []
    for i in np.lexsort([~np.isfinite(seconds), -reached]):
        if (clear[i] or not any(clear)) and not np.isin(heads[tails == nodes[i]], found).any():
            found.append(int(nodes[i]))
    return [graph.standing(node) for node in found]


def open_world(
    file: Path,
    store: MissionStore,
    topology: Topology,
    robot: str,
    rules: Sequence[FailureRule] = (),
    *,
    resume: bool = False,
) -> SimWorld:
    """The simulated world in a file, with the robot; made from the map if there is no file.

    Raises MissionError: the pose of the robot is unknown, or there is no mission to resume.
    """
    where = store.robot(robot)
    if file.is_file():
        world = SimWorld(file)
        if where is None and not world.has_robot(robot):
            world.close()
            raise MissionError(_NOWHERE.format(robot))
        world.add_rules(rules)
    elif resume:
        raise MissionError(f"{file}, the simulated world, is gone: name its file by world=")
    elif where is None:
        raise MissionError(_NOWHERE.format(robot))
    else:
        file.parent.mkdir(parents=True, exist_ok=True)
        world = SimWorld.make(file, topology, store.objects(), rules)
    if where is not None and not world.has_robot(robot):
        world.put_robot(robot, *where)
        lift = topology.places[where[0]].elevator if where[0] in topology.places else None
        if lift is not None:  # it stands where somebody is in it
            world.set_elevator(lift, where[0], robot)
    return world


def simulated_robot(
    live: LiveTopology, world: SimWorld, name: str, *, speed: float, seed: int = 0
) -> SimulatedRobot:
    """A robot of the class of a live topology, on its costmaps; `speed` is that of its clock."""
    options = body_options(live, speed=speed, seed=seed)
    return SimulatedRobot(name, world, live.topology, **options)


def body_options(live: LiveTopology, *, speed: float, seed: int = 0) -> dict[str, Any]:
    """How a simulated robot of the class of a live topology moves."""
    return {
        "speed": speed,
        "seed": seed,
        "velocity": live.graph.robot.speed,
        "path": live.costmaps.path if live.costmaps is not None else None,
    }
