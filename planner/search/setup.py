"""Makes simulated robots that search, and puts objects where they truly are."""

from __future__ import annotations

import re
from collections.abc import Sequence

from planner.live_topology import LiveTopology
from planner.mission.behaviours import Sighting
from planner.mission.sim_setup import body_options
from planner.mission.sim_world import SimWorld
from planner.mission.store.mission_list import MissionError
from planner.mission.store.missions import MissionStore
from planner.search.problem_builder import Detector
from planner.search.reader import read_believed_object, read_entity_shapes, read_room
from planner.search.sim_search import SearchingRobot, SimEyes
from planner.search.viewpoints import Sight
from semmap.geometry.pose import Pose

_PUT = re.compile(r"(?P<item>.+?) (?:on|in) (?P<target>.+)")


def searching_robot(
    live: LiveTopology,
    world: SimWorld,
    name: str,
    objects: Sequence[str],
    sight: Sight,
    detector: Detector,
    *,
    speed: float,
    seed: int = 0,
) -> SearchingRobot:
    """A robot that sees these objects only where its camera shows them; LookupError without one."""
    eyes = {}
    with live.snapshot() as seen:
        shapes = read_entity_shapes(seen) if objects else {}
        for target in objects:
            known = read_believed_object(seen, target)
            eyes[target] = SimEyes(
                known.places, shapes, sight, detector, known.all_shut, known.height, seed
            )
    return SearchingRobot(
        name, world, live.topology, eyes=eyes, **body_options(live, speed=speed, seed=seed)
    )


def find_spots(
    store: MissionStore, live: LiveTopology, texts: Sequence[str]
) -> list[tuple[str, str, Sighting]]:
    """Where objects truly are by texts such as ``mug on table2``: each with its room and pose.

    Raises MissionError: a text cannot be read, or nothing is free there; LookupError: a name is
    unknown.
    """
    spots = []
    for text in texts:
        found = _PUT.fullmatch(text.strip())
        if found is None:
            raise MissionError(
                f"{text!r} is not 'OBJECT on PLACE'; write for example 'mug on table1'"
            )
        item, target = found["item"].strip(), found["target"].strip()
        with live.snapshot() as seen:
            room = target if target in live.topology.places else read_room(seen, target)
        if room is None:
            raise MissionError(f"no room holds {target}: name a place of the map that is in one")
        spot = store.spot(item, target, Pose(0.0, 0.0, live.topology.places[room].floor))
        if spot is None:
            raise MissionError(
                f"nothing is free on {target} for {item}, or the map has no such object"
            )
        spots.append((item, room, Sighting(target, "in" if target == room else "on", spot)))
    return spots
