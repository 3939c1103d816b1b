"""Robots fetch things of the small house that fit their hands: planned, tried, moved by the arm.

The things of the house and two of each object of the YCB set, which lie at random on its furniture,
are brought to furniture at random. Those count that the hand is expected to hold and for which
there is a plan; for the others, the table has the reasons. Where a mission says that it is done,
shapely and the simulated world say whether the thing stands on what it was brought to.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import trimesh
from rich.progress import track
from scipy.stats import binomtest

import semmap
from benchmarks.bench_map import fresh_map
from benchmarks.recognition import ycb_meshes
from benchmarks.timing import Row, print_rows
from planner.simulated_run import SimulatedMission
from planner.tasks import NoPlanError
from semmap.arrays import Floats
from semmap.geometry.mesh import Mesh
from semmap.geometry.pose import Pose
from semmap.geometry.surfaces import LevelPatch, support_surfaces
from tests.manipulation.grippers import urdf

WORLDS = Path(os.environ.get("SEMMAP_WORLDS", "../shared/worlds"))
HOUSE = WORLDS / "small_house" / "worlds" / "small_house.world"
ROOMS = Path(__file__).parents[1] / "tests" / "worlds" / "small_house_rooms.geojson"

ROBOTS = ("tiago_pro", "pr2", "tiago")
THINGS, SEED = 10, 3
"""Missions of each robot, and the seed of where things are and go."""

START = "kitchen"
"""The room from which robots start."""

LOW, HIGH = 0.3, 1.1
"""Metres above the floor of furniture that things lie on."""

LARGEST, HOLDS = 0.36, 0.5
"""Metres of a thing, and the least share of successes that is expected of its best grasp."""

SIZES = """
SELECT e.name, ST_XMin(box), ST_YMin(box), ST_ZMin(box), ST_XMax(box), ST_YMax(box), ST_ZMax(box)
FROM entity e JOIN world w ON w.entity_id = e.id
WHERE e.map_id = current_map() AND e.kind = 'object' AND box IS NOT NULL ORDER BY e.name
"""


def boxes(house: semmap.Map) -> dict[str, Floats]:
    """The lowest and highest corners (2, 3) of objects, map's frame."""
    return {name: np.reshape(box, (2, 3)) for name, *box in house.execute(SIZES)}


def levels_of(house: semmap.Map, name: str) -> list[LevelPatch]:
    """The level surfaces of an object, map's frame."""
    mesh = house[name].mesh
    return [] if mesh is None else support_surfaces(Mesh.of_triangles(mesh.triangles))


def furniture(house: semmap.Map) -> dict[str, list[LevelPatch]]:
    """The levels of large objects between two heights."""
    found: dict[str, list[LevelPatch]] = {}
    for name, (low, high) in boxes(house).items():
        if (high - low).max() > LARGEST:
            levels = [each for each in levels_of(house, name) if LOW < each.height < HIGH]
            found |= {name: levels} if levels else {}
    return found


def strew(house: semmap.Map, random: np.random.Generator) -> None:
    """Put two of each YCB object where nothing else is."""
    levels = [level for each in furniture(house).values() for level in each]
    room: Any = trimesh.collision.CollisionManager()  # type: ignore[no-untyped-call]
    for name in boxes(house):
        room.add_object(name, house[name].mesh)
    for name, mesh in [each for each in ycb_meshes(WORLDS).items() for _ in range(2)]:
        shape = trimesh.Trimesh(mesh.vertices, mesh.faces)
        while True:
            level = levels[random.integers(len(levels))]
            x0, y0, x1, y1 = level.outline.bounds
            x, y, yaw = random.uniform((x0, y0, -np.pi), (x1, y1, np.pi))
            bottom = level.height + 0.002 - float(mesh.used[:, 2].min())
            pose = Pose.planar(x, y, yaw, bottom).matrix
            corners = trimesh.transform_points(mesh.used, pose)
            foot = shapely.MultiPoint(corners[:, :2]).convex_hull
            if level.outline.contains(foot) and not room.in_collision_single(shape, pose):
                break
        number = sum(other.startswith(name) for other in boxes(house)) + 1
        made = house.add_object(
            f"{name}_{number}", type=name, define=True, mesh=mesh, pose=(x, y, bottom, yaw)
        )
        room.add_object(made.name, shape, pose)


def small_house(db: semmap.Database) -> semmap.Map:
    """The small house with its rooms, YCB objects, and classes of robots."""
    house = db.create_map("fetch")
    house.import_file(HOUSE)
    house.import_file(ROOMS)
    strew(house, np.random.default_rng(SEED))
    for robot in ROBOTS:
        db.add_robot(robot, urdf(robot), reach=(0.2, 1.2), heights=(0.0, 2.0))
    return house


def fitting(house: semmap.Map, robot: str) -> Iterator[str]:
    """The small things of which the robot's hand is expected to hold one grasp."""
    every = boxes(house).items()
    small = [name for name, (low, high) in every if (high - low).max() <= LARGEST]
    for name in track(small, f"grasps, {robot}", transient=True):
        found = house.grasps(name, gripper=urdf(robot), limit=1)
        if found and found[0]["expected"] >= HOLDS:
            yield name


def is_there(house: semmap.Map, ran: SimulatedMission, thing: str, target: str) -> bool:
    """Whether the thing stands on a level of the target, in the copy where the mission was."""
    low, high = boxes(house.database.map(ran.map))[thing]
    middle = shapely.Point((low + high)[:2] / 2)
    return any(
        abs(low[2] - level.height) < 0.01 and level.outline.contains(middle)
        for level in levels_of(house, target)
    )


def main() -> None:
    """Print the table."""
    rows = []
    with fresh_map("fetch", small_house) as (_, house):
        targets = [*furniture(house)]
        for robot in ROBOTS:
            random = np.random.default_rng(SEED)
            things = [str(each) for each in random.permutation([*fitting(house, robot)])]
            brought, seconds, why = [], [], Counter[str]()
            for thing in track(things, robot, transient=True):
                holder = house[thing].holder
                target = str(
                    random.choice(
                        [each for each in targets if holder is None or each != holder.name]
                    )
                )
                goal = f"on('{thing}', '{target}')"
                try:
                    house.plan(goal, start=START, robot=robot)
                except NoPlanError as error:
                    why[str(error)] += 1
                    continue
                start = time.process_time()
                ran = house.run(goal, start=START, robot=robot, speed=1e5)
                seconds.append(time.process_time() - start)
                brought.append(ran.done and is_there(house, ran, thing, target))
                if not brought[-1]:
                    why[f"NOT BROUGHT: {thing}: {ran.reason}"] += 1
                if len(brought) == THINGS:
                    break
            rows.append(_row(robot, brought, seconds, why))
    print_rows(f"Things of the small house that fit are fetched, seed {SEED}", rows)


def _row(robot: str, brought: list[bool], seconds: list[float], why: Counter[str]) -> Row:
    found = binomtest(sum(brought), max(len(brought), 1)).proportion_ci(method="wilson")
    return Row(
        f"{robot}: things fetched of those with a plan",
        f"{sum(brought)} of {len(brought)} ({100 * found.low:.0f} to {100 * found.high:.0f} %)",
        f"{np.median(seconds or [0]):.0f} s of the processor each; no plan, or not brought: "
        + "; ".join(f"{reason} ({count})" for reason, count in why.items()),
        f"all of {THINGS}",
        sum(brought) == THINGS,
    )


if __name__ == "__main__":
    main()
