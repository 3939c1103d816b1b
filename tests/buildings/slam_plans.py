"""Judge rooms found in maps of SLAM programs: ``python -m tests.buildings.slam_plans --count 40``.

The plans are made here and share nothing with `random_building`: a rectangle is cut by straight
walls, of which some are slanted, until its parts are as large as rooms; doors are in the walls,
some with an open leaf; furniture stands at walls and in the middle, on legs or on the floor. The
maps are `drawn` from above, or `seen`: rays of a level scanner at many places, whose ranges are
noisy, mark the cells that they pass and hit. Then walls are as thin as their visible faces, and
nothing behind furniture is known.

The tables are in the metrics of Bormann et al. (2016) and of MAORIS (Mielle et al., 2018), as in
`tests.buildings.found_rooms`. The last table shows what a confidence means: of the rooms and
doorways with about this confidence, the part that is right.
"""

from __future__ import annotations

import argparse
import itertools
import math
import random
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
import shapely.geometry
import shapely.ops
import yaml
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from shapely import LineString, Polygon, affinity

from navgrid.explored_map import read_explored_map
from navgrid.found_rooms import FoundRooms, find_rooms
from semmap.query.storey_scene import SceneEntity, StoreyScene
from tests.buildings.found_rooms import (
    Score,
    areas,
    right_doors,
    right_rooms,
    score_doors,
    score_rooms,
)

SIDE = 0.05
"""Metres of a cell."""

RANGE, RAYS, NOISE = 10.0, 1440, 0.012
"""Metres that the scanner sees, its rays, and the deviation of a range, metres."""

LEVELS = (0.0, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95, 1.01)
"""The confidences between which the last table counts."""

NONE = Score()

Cells = NDArray[np.bool_]


class PlanDoor(NamedTuple):
    """A doorway in a wall between two rooms: its posts."""

    rooms: tuple[int, int]
    posts: LineString


@dataclass(frozen=True)
class Plan:
    """Rooms and doors of one storey, its walls, and its furniture; metres."""

    rooms: tuple[Polygon, ...]
    doors: tuple[PlanDoor, ...]
    walls: shapely.Geometry
    furniture: shapely.Geometry


def random_plan(seed: int, furnished: bool = True) -> Plan:
    """Return the plan of a seed; its walls are the same with and without furniture."""
    chance = random.Random(f"plan {seed}")
    width, depth = chance.uniform(9, 22), chance.uniform(7, 14)
    thick = chance.uniform(0.1, 0.25)
    slanted = chance.choice([0.0, 0.0, 0.15, 0.35])
    cells = _cut(chance, shapely.box(0, 0, width, depth), slanted)
    doors = _doors(chance, cells, thick)
    outer = shapely.box(0, 0, width, depth)
    lines = shapely.union_all([cell.exterior for cell in cells])
    holes = [door.posts.buffer(thick, cap_style="flat") for door in doors]
    walls = lines.buffer(thick / 2, join_style="mitre").intersection(
        outer.buffer(thick / 2, join_style="mitre")
    )
    rooms = [cell.buffer(-thick / 2, join_style="mitre") for cell in cells]
    things: list[shapely.Geometry] = []
    walls = walls.difference(shapely.union_all(holes))
    if furnished:
        own = random.Random(f"furniture {seed}")
        for room in rooms:
            things += _furniture(own, room, doors)
        things += _leaves(own, doors, rooms, thick)
    turn = chance.choice([0.0, 0.0, chance.uniform(-45, 45)])

    def turned(shape: shapely.Geometry) -> shapely.Geometry:
        return affinity.rotate(shape, turn, origin=(0, 0))

    return Plan(
        tuple(turned(room) for room in rooms),
        tuple(PlanDoor(door.rooms, turned(door.posts)) for door in doors),
        turned(walls),
        turned(shapely.union_all(things)),
    )


def _cut(chance: random.Random, cell: Polygon, slanted: float) -> list[Polygon]:
    """Cut a convex cell into rooms by lines across its longer side, of which some are slanted."""
    corners = shapely.get_coordinates(cell.minimum_rotated_rectangle)[:3]
    sides = np.diff(corners, axis=0)
    lengths = np.hypot(*sides.T)
    long = int(lengths.argmax())
    if cell.area < 9 or (cell.area < 30 and chance.random() < 0.3) or lengths.max() < 4.2:
        return [cell]
    way = sides[long] / lengths[long]
    share = chance.uniform(0.3, 0.7)
    if chance.random() < 0.25 and lengths.min() > 5:  # a corridor
        long = 1 - long
        way, share = sides[long] / lengths[long], chance.uniform(1.3, 2.0) / lengths[long]
    middle = corners[0 if long == 0 else 1] + share * sides[long]
    middle = middle + 0.5 * sides[1 - long] * (-1 if long == 1 else 1)
    angle = chance.uniform(-40, 40) if chance.random() < slanted else 0.0
    across = affinity.rotate(
        LineString([middle - 99 * way, middle + 99 * way]), 90 + angle, origin=tuple(middle)
    )
    parts = list(shapely.ops.split(cell, across).geoms)
    if len(parts) != 2 or any(_narrow(part) for part in parts):
        return [cell]
    return [room for part in parts for room in _cut(chance, part, slanted)]


def _narrow(cell: Polygon) -> bool:
    """Whether no one furnishes a room like this."""
    return bool(cell.area < 4.5 or cell.buffer(-0.6).is_empty or cell.buffer(-0.6).area < 0.2)


def _doors(chance: random.Random, cells: Sequence[Polygon], thick: float) -> list[PlanDoor]:
    """A tree of doors between neighbours, and some more; one leads outside."""
    edges = []
    for a in range(len(cells)):
        for b in range(a + 1, len(cells)):
            shared = shapely.line_merge(
                cells[a].buffer(1e-6).intersection(cells[b].exterior)
                if cells[a].distance(cells[b]) < 1e-6
                else LineString()
            )
            longest = max(
                (p for p in shapely.get_parts(shared) if p.geom_type == "LineString"),
                key=lambda part: part.length,
                default=None,
            )
            if longest is not None and longest.length > 1.4 + 2 * thick:
                ends = shapely.get_coordinates(longest)[[0, -1]]
                edges.append((a, b, LineString(ends)))
    chance.shuffle(edges)
    group = list(range(len(cells)))
    doors = []
    for a, b, edge in edges:
        if group[a] == group[b] and chance.random() < 0.75:
            continue
        group = [group[a] if g == group[b] else g for g in group]
        free = edge.length - 2 * thick - 0.3
        width = min(free, chance.uniform(0.75, 1.1) if chance.random() < 0.85 else 1.8)
        start = thick + 0.15 + chance.uniform(0, free - width)
        doors.append(PlanDoor((a, b), shapely.ops.substring(edge, start, start + width)))
    return doors


def _furniture(
    chance: random.Random, room: Polygon, doors: Sequence[PlanDoor]
) -> list[shapely.Geometry]:
    """Furniture that leaves free the floor before doors, and the way round."""
    ways = shapely.union_all([door.posts.buffer(0.75, cap_style="square") for door in doors])
    placed: list[shapely.Geometry] = []
    found: list[shapely.Geometry] = []
    corners = shapely.get_coordinates(shapely.geometry.polygon.orient(room).exterior)
    for _ in range(chance.randrange(1, 3 + int(room.area / 4))):
        k = chance.randrange(len(corners) - 1)
        side = corners[k + 1] - corners[k]
        length = float(np.hypot(*side))
        angle = math.degrees(math.atan2(side[1], side[0]))
        shape, size, at_wall = _piece(chance)
        if at_wall and length > size[0] + 0.1:
            at = corners[k] + side / length * chance.uniform(0.0, length - size[0])
            placed_at = affinity.rotate(shape, angle, origin=(0, 0))
            outline = affinity.rotate(shapely.box(0, 0, *size), angle, origin=(0, 0))
        elif not at_wall:
            x0, y0, x1, y1 = room.bounds
            at = np.array([chance.uniform(x0, x1), chance.uniform(y0, y1)])
            turn = angle if chance.random() < 0.7 else chance.uniform(0, 90)
            placed_at = affinity.rotate(shape, turn, origin=(0, 0))
            outline = affinity.rotate(shapely.box(0, 0, *size), turn, origin=(0, 0))
        else:
            continue
        outline = affinity.translate(outline, *at)
        if shapely.Polygon(outline.exterior.coords).intersection(room).area < 1e-3:
            continue
        if not at_wall and not room.buffer(-0.5).contains(outline):
            continue
        if not room.buffer(0.02).contains(outline) or outline.intersects(ways):
            continue
        if not at_wall and any(outline.distance(other) < 0.45 for other in placed):
            continue
        if any(outline.buffer(-0.01).intersects(other) for other in placed):
            continue
        left = room.difference(shapely.union_all([*placed, outline]).buffer(0.25))
        parts = [p for p in shapely.get_parts(left) if p.area > 0.3]
        if len(parts) != 1:  # a robot gets round it
            continue
        placed.append(outline)
        found.append(affinity.translate(placed_at, *at))
    return found


def _piece(chance: random.Random) -> tuple[shapely.Geometry, tuple[float, float], bool]:
    """A piece of furniture with a corner at the origin, the sides of its box, if at a wall."""
    kind = chance.choice(
        [
            "wardrobe",
            "bed",
            "counter",
            "sofa",
            "shelf",
            "desk",
            "table",
            "chairs",
            "island",
            "plant",
        ]
    )
    wide, deep = {
        "wardrobe": (chance.uniform(0.8, 2.4), chance.uniform(0.45, 0.65)),
        "bed": (chance.uniform(0.9, 1.8), 2.0),
        "counter": (chance.uniform(1.5, 3.5), 0.6),
        "sofa": (chance.uniform(1.6, 2.4), chance.uniform(0.8, 1.0)),
        "shelf": (chance.uniform(0.8, 2.0), chance.uniform(0.25, 0.4)),
        "desk": (chance.uniform(1.2, 1.8), 0.75),
        "table": (chance.uniform(0.8, 2.0), chance.uniform(0.8, 1.0)),
        "chairs": (0.5, 0.5),
        "island": (chance.uniform(1.0, 2.2), chance.uniform(0.3, 0.9)),
        "plant": (0.4, 0.4),
    }[kind]
    solid = shapely.box(0, 0, wide, deep)
    if kind in ("desk", "table", "chairs"):
        legs = [(0, 0), (wide - 0.06, 0), (0, deep - 0.06), (wide - 0.06, deep - 0.06)]
        solid = shapely.union_all([shapely.box(x, y, x + 0.06, y + 0.06) for x, y in legs])
    at_wall = kind in ("wardrobe", "bed", "counter", "sofa", "shelf", "desk")
    return solid, (wide, deep), at_wall


def _leaves(
    chance: random.Random, doors: Sequence[PlanDoor], rooms: Sequence[Polygon], thick: float
) -> list[shapely.Geometry]:
    """Open leaves of doors of one leaf, at the post where they hang."""
    found = []
    for door in doors:
        if door.posts.length > 1.2 or chance.random() < 0.4:
            continue
        one, other = shapely.get_coordinates(door.posts)[:: chance.choice([1, -1])]
        way = (other - one) / door.posts.length
        side = chance.choice([1, -1]) * np.array([-way[1], way[0]])
        hinge = one + side * thick / 2
        angle = math.radians(chance.uniform(70, 110))
        tip = hinge + (math.cos(angle) * way + math.sin(angle) * side) * door.posts.length
        leaf = LineString([hinge, tip]).buffer(0.025, cap_style="flat")
        if any(room.buffer(0.05).contains(leaf) for room in rooms):
            found.append(leaf)
    return found


def drawn(plan: Plan) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """Return the shades of a map drawn from above (rows from the bottom), and its origin."""
    inside, built, origin = _cells(plan)
    shades = np.full(inside.shape, 205, np.uint8)
    shades[inside] = 254
    shades[built] = 0
    return shades, origin


def seen(plan: Plan, seed: int) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """Return the shades of the map of a scanner that was in all rooms, and its origin."""
    rng = np.random.default_rng(seed)
    inside, built, origin = _cells(plan)
    clear = ndimage.distance_transform_edt(~built & inside) * SIDE > 0.3
    hits, passes = (np.zeros(inside.shape, np.int64) for _ in range(2))
    steps = np.arange(0.5, RANGE / SIDE, 0.5)
    for room in plan.rooms:
        y, x = np.nonzero(clear)
        at = (np.stack([x, y], axis=1) + 0.5) * SIDE + origin
        spots = at[shapely.contains_xy(room, *at.T)]
        for spot in rng.permutation(spots)[: 2 + int(room.area / 4)]:
            angles = rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, RAYS, endpoint=False)
            way = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            points = (spot - origin) / SIDE + steps[:, None, None] * way
            cells = points.astype(np.int64)
            out = ((cells < 0) | (cells >= inside.shape[::-1])).any(axis=-1)
            cells = np.where(out[..., None], 0, cells)
            hit = built[cells[..., 1], cells[..., 0]] | out
            first = np.where(hit.any(axis=0), hit.argmax(axis=0), len(steps))
            ranges = np.where(first < len(steps), steps[np.minimum(first, len(steps) - 1)], 1e9)
            noisy = ranges + rng.normal(0, NOISE / SIDE, RAYS)
            before = (steps[:, None] < noisy - 0.5) & ~out
            np.add.at(passes, (cells[..., 1][before], cells[..., 0][before]), 1)
            ended = first < len(steps)
            ends = ((spot - origin) / SIDE + noisy[ended, None] * way[ended]).astype(np.int64)
            fine = ((ends >= 0) & (ends < inside.shape[::-1])).all(axis=1)
            np.add.at(hits, (ends[fine, 1], ends[fine, 0]), 1)
    shades = np.full(inside.shape, 205, np.uint8)
    shades[passes > 0] = 254
    shades[hits > 0.25 * (passes + hits)] = np.where(
        (hits > 0)[hits > 0.25 * (passes + hits)], 0, 205
    )
    return shades, origin


def _cells(plan: Plan) -> tuple[Cells, Cells, tuple[float, float]]:
    """The cells of the inside, and of walls and furniture, and the origin."""
    whole = shapely.union_all([*plan.rooms, plan.walls])
    low, high = np.array(whole.bounds).reshape(2, 2) + np.array([[-0.5], [0.5]])
    columns, rows = np.ceil((high - low) / SIDE).astype(int)
    y, x = (np.mgrid[:rows, :columns] + 0.5) * SIDE
    x, y = x + low[0], y + low[1]
    inside = shapely.contains_xy(whole.buffer(1e-6), x, y)
    doorways = shapely.union_all([door.posts.buffer(0.3, cap_style="flat") for door in plan.doors])
    inside |= shapely.contains_xy(doorways, x, y)
    half = SIDE / 2
    built = np.zeros_like(inside)
    for shape in shapely.get_parts(shapely.union_all([plan.walls, plan.furniture])):
        near = shape.buffer(half * 0.8)
        built |= shapely.contains_xy(near, x, y)
    return inside, built & inside, (float(low[0]), float(low[1]))


def write(shades: NDArray[np.uint8], origin: tuple[float, float], folder: Path) -> Path:
    """Write a ``map.yaml`` with its image."""
    folder.mkdir(parents=True, exist_ok=True)
    Image.fromarray(shades[::-1]).save(folder / "map.pgm")
    path = folder / "map.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "image": "map.pgm",
                "mode": "trinary",
                "resolution": SIDE,
                "origin": [*origin, 0.0],
                "negate": 0,
                "occupied_thresh": 0.65,
                "free_thresh": 0.196,
            }
        )
    )
    return path


def found_in(path: Path) -> FoundRooms:
    """Return what is found in a map file, as its import finds it."""
    world = read_explored_map(path)
    entities = []
    for number, entry in enumerate(world.entries):
        for shape in entry.shapes:
            vertices, faces = shape.mesh.vertices, shape.mesh.faces
            types = () if entry.type is None else (entry.type,)
            entity = SceneEntity(number, entry.name, "object", types, vertices[faces])
            entities.append(replace(entity, properties=entry.properties))
    try:
        return find_rooms(StoreyScene("ground", 0.0, tuple(entities)))
    except ValueError as error:
        return FoundRooms("ground", 0.0, problem=str(error))


@dataclass
class Sums:
    """The sums of all plans that were judged in one way."""

    rooms: Score = NONE
    doors: Score = NONE
    areas: tuple[list[float], ...] = ()
    right_rooms: tuple[tuple[bool, float], ...] = ()
    right_doors: tuple[tuple[bool, float], ...] = ()

    def add(self, plan: Plan, here: FoundRooms) -> None:
        """Judge what was found in a plan."""
        outlines = [room.outline for room in here.rooms]
        doors = [door.posts.coords for door in plan.doors]
        self.rooms += score_rooms(plan.rooms, outlines)
        self.doors += score_doors(doors, [way.line.coords for way in here.doorways])
        self.areas += (areas(plan.rooms, outlines),)
        self.right_rooms += (*right_rooms(plan.rooms, here),)
        self.right_doors += (*right_doors(doors, here),)

    def __str__(self) -> str:
        numbers = [n for s in (self.rooms, self.doors) for n in (s.recall, s.precision)]
        return "".join(f"{n:8.3f}" for n in (*numbers, *np.mean(self.areas, axis=0)))


def calibration(right: Sequence[tuple[bool, float]]) -> str:
    """Return per level of confidence how many there are, and the part that is right."""
    row = ""
    for low, high in itertools.pairwise(LEVELS):
        these = [each for each, confidence in right if low <= confidence < high]
        row += f"{len(these):6} {np.mean(these) if these else math.nan:5.2f}"
    return row


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.buildings.slam_plans")
    parser.add_argument("--count", type=int, default=40, help="how many plans")
    parser.add_argument("--first", type=int, default=0, help="the seed of the first")
    given = parser.parse_args()
    ways = {(kind, state): Sums() for kind in ("drawn", "seen") for state in ("empty", "furnished")}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(given.first, given.first + given.count):
            for (kind, state), sums in ways.items():
                plan = random_plan(seed, state == "furnished")
                image = drawn(plan) if kind == "drawn" else seen(plan, seed)
                sums.add(plan, found_in(write(*image, Path(folder))))
    names = ("rooms R", "rooms P", "doors R", "doors P", "areas R", "areas P", "MCC")
    print(f"{'':18}" + "".join(f"{name:>8}" for name in names))
    for (kind, state), sums in ways.items():
        print(f"{kind}, {state}".ljust(18), sums, sep="")
    print(f"\n{'confidence':25}" + "".join(f"{a:>7.2f} to" + "  " for a in LEVELS[:-1]))
    for (kind, state), sums in ways.items():
        for what, right in (("rooms", sums.right_rooms), ("doors", sums.right_doors)):
            print(f"{kind}, {state}, {what}".ljust(25), calibration(right), sep="")


if __name__ == "__main__":
    main()
