"""The judge of missions: a simulated robot does what a plan promises, or fails for its reason."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

import semmap
from tests.buildings.building import Building
from tests.buildings.plans import ROBOTS, goals, stored_robot, text

ASKED = 2
"""Goals of a building for which missions run."""


def judge_missions(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """Missions without trials in physics end as their plans say, for one robot or none."""
    chance = random.Random(f"missions of {building.seed}")
    robot = chance.choice([None, *ROBOTS])
    if robot is not None:
        stored_robot(place, robot)
    wrong = []
    wanted = [goal for goal in goals(building, chance) if any(g[1] != "robot" for g in goal)]
    asked = chance.sample(wanted, min(ASKED, len(wanted)))
    for goal in asked:
        start = chance.choice([room.name for room in building.rooms])
        promised = why = None
        try:
            promised = place.plan(text(goal), start=start, robot=robot)
        except ValueError as error:
            why = str(error)
        with tempfile.TemporaryDirectory() as folder:
            ended = place.run(
                text(goal),
                start=start,
                robot=robot,
                speed=1e5,
                try_grasps=False,
                world=Path(folder) / "world.sqlite",
            )
        told = f"{robot or 'a robot'} in {start}, {text(goal)}"
        if promised is not None and not ended.done:
            wrong.append(f"{told}: {[*map(str, promised.actions)]}, but {ended.reason}")
        if why is not None and (ended.done or not _is_told(why, str(ended.reason))):
            wrong.append(f"{told}: refused, {why}; the mission is {ended.state}: {ended.reason}")
    return len(asked), wrong


def _is_told(why: str, reason: str) -> bool:
    """Whether the mission ends for a plan's reason; ways depend on where in a room it begins."""
    return "gripper" not in why or why in reason or "finds no path" in reason
