"""Random buildings: storeys, rooms, doors, slabs, walls and things, under names in no list."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import shapely
from shapely import Polygon

FLOORS = [
    "slab",
    "deck",
    "platform",
    "foundation",
    "parquet",
    "concrete_base",
    "carpet_tiles",
    "Boden",
    "Estrich",
    "Bodenplatte",
    "plancher",
    "dalle",
    "carrelage",
    "qxv",
]
WALLS = [
    "partition",
    "brickwork",
    "masonry",
    "Wand",
    "Mauer",
    "Trennwand",
    "mur",
    "cloison",
    "paroi",
    "vvk",
]
CEILINGS = ["upper_deck", "cover_plate", "Decke", "Zwischendecke", "plafond", "faux_plafond", "rrt"]
FURNITURE = [
    "desk",
    "Tisch",
    "Schrank",
    "Regal",
    "meuble",
    "armoire",
    "bahut",
    "unit",
    "bloc",
    "zzp",
]
SMALL = ["mug", "plate", "Tasse", "Teller", "Dose", "assiette", "bol", "gobelet", "item", "qq"]

SIDES = 2.4
"""Least side of a room, metres."""


@dataclass(frozen=True)
class Item:
    """A box: its ground in the map's frame, its heights, what it is, and what bears it."""

    name: str
    what: str
    ground: Polygon
    low: float
    high: float
    centre: tuple[float, float]
    size: tuple[float, float]
    on: str | None = None


@dataclass(frozen=True)
class Room:
    """A room: its outline in the map's frame and its heights."""

    name: str
    storey: str
    outline: Polygon
    floor: float
    ceiling: float


@dataclass(frozen=True)
class Door:
    """A gap in the wall between two rooms of a storey."""

    name: str
    rooms: tuple[str, str]
    ends: tuple[tuple[float, float], tuple[float, float]]


@dataclass
class Building:
    """What was made, as the truth, and where it stands on the map."""

    seed: int
    angle: float
    origin: tuple[float, float]
    storeys: list[tuple[str, float, float]] = field(default_factory=list)
    rooms: list[Room] = field(default_factory=list)
    doors: list[Door] = field(default_factory=list)
    items: list[Item] = field(default_factory=list)

    def placed(self, x: float, y: float) -> tuple[float, float]:
        """A point of the building's own frame in that of the map."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return (self.origin[0] + cos * x - sin * y, self.origin[1] + sin * x + cos * y)

    def outline(self, shape: Polygon) -> Polygon:
        """An outline of the building's own frame in that of the map."""
        return Polygon([self.placed(*point) for point in shape.exterior.coords])

    def add(
        self,
        name: str,
        what: str,
        box: tuple[float, float, float, float],
        low: float,
        high: float,
        on: str | None = None,
    ) -> Item:
        """Add a box of the building's own frame."""
        x0, y0, x1, y1 = box
        taken = {item.name for item in self.items}
        unique = f"{name}_{next(n for n in range(1000) if f'{name}_{n}' not in taken)}"
        item = Item(
            unique,
            what,
            self.outline(shapely.box(*box)),
            low,
            high,
            self.placed((x0 + x1) / 2, (y0 + y1) / 2),
            (x1 - x0, y1 - y0),
            on,
        )
        self.items.append(item)
        return item

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write the building as an SDF world and its rooms as GeoJSON; return both paths."""
        folder.mkdir(parents=True, exist_ok=True)
        world, rooms = folder / f"b{self.seed}.sdf", folder / f"b{self.seed}_rooms.geojson"
        world.write_text(
            f'<sdf version="1.7"><world name="b{self.seed}">{"".join(map(self._model, self.items))}'
            "</world></sdf>"
        )
        rooms.write_text(
            json.dumps({"type": "FeatureCollection", "features": list(self._features())})
        )
        return world, rooms

    def _model(self, item: Item) -> str:
        (x, y), (dx, dy) = item.centre, item.size
        geometry = f"<geometry><box><size>{dx} {dy} {item.high - item.low}</size></box></geometry>"
        return (
            f'<model name="{item.name}"><static>true</static>'
            f"<pose>{x} {y} {(item.low + item.high) / 2} 0 0 {self.angle}</pose>"
            f'<link name="l"><visual name="v">{geometry}</visual>'
            f'<collision name="c">{geometry}</collision></link></model>'
        )

    def _features(self) -> Iterator[dict[str, object]]:
        for name, elevation, height in self.storeys:
            yield _feature(None, kind="storey", name=name, elevation=elevation, height=height)
        for room in self.rooms:
            yield _feature(
                shapely.geometry.mapping(room.outline),
                kind="room",
                name=room.name,
                storey=room.storey,
            )
        for door in self.doors:
            line = {"type": "LineString", "coordinates": door.ends}
            storey = next(r.storey for r in self.rooms if r.name == door.rooms[0])
            joins = ",".join(door.rooms)
            yield _feature(line, kind="connector", name=door.name, joins=joins, storey=storey)


def _feature(geometry: object, **properties: object) -> dict[str, object]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


Box = tuple[float, float, float, float]


def random_building(seed: int) -> Building:
    """The building of a seed: one to four storeys, turned and anywhere on the map."""
    chance = random.Random(seed)
    angle = chance.choice([0.0, math.pi / 2, chance.uniform(-math.pi, math.pi)])
    building = Building(seed, angle, (chance.uniform(-50, 50), chance.uniform(-50, 50)))
    width, depth = chance.uniform(7, 16), chance.uniform(6, 12)
    thick, height = chance.uniform(0.08, 0.3), chance.uniform(2.6, 3.2)
    bottom = chance.choice([0.0, 0.0, chance.uniform(-4, 20)])
    for number in range(chance.choice([1, 1, 2, 3, 4])):
        elevation = bottom + number * (height + 0.3)
        building.storeys.append((f"s{number}", elevation, height))
        _add_storey(building, chance, number, (0.0, 0.0, width, depth), thick)
    return building


def _split(chance: random.Random, box: Box) -> list[Box]:
    """Cut a rectangle into cells, each with sides of `SIDES` at least."""
    x0, y0, x1, y1 = box
    wide = x1 - x0 >= y1 - y0
    low, high = (x0, x1) if wide else (y0, y1)
    if high - low < 2 * SIDES + 0.4 or (high - low < 6 and chance.random() < 0.3):
        return [box]
    cut = chance.uniform(low + SIDES, high - SIDES)
    halves = (
        ((x0, y0, cut, y1), (cut, y0, x1, y1)) if wide else ((x0, y0, x1, cut), (x0, cut, x1, y1))
    )
    return [cell for half in halves for cell in _split(chance, half)]


def _add_storey(
    building: Building, chance: random.Random, number: int, box: Box, thick: float
) -> None:
    storey, floor, height = building.storeys[number]
    cells = _split(chance, box)
    chance.shuffle(cells)
    slab = chance.uniform(0.05, 0.28)
    name = chance.choice(FLOORS)
    covers = [box] if chance.random() < 0.6 else cells
    for cover in covers:
        building.add(name, "floor", cover, floor - slab, floor)
    if chance.random() < 0.5:
        building.add(chance.choice(CEILINGS), "ceiling", box, floor + height, floor + height + 0.02)
    for k, cell in enumerate(cells):
        inner = shapely.box(*cell).buffer(-thick / 2, join_style="mitre")
        building.rooms.append(
            Room(f"r{number}_{k}", storey, building.outline(inner), floor, floor + height)
        )
    gaps = _add_doors(building, chance, number, cells)
    _add_walls(building, chance, cells, gaps, box, thick, floor, height)
    _add_things(building, chance, number, cells, gaps, thick, floor, height)


@dataclass(frozen=True)
class Gap:
    """An opening in the wall between two cells, in the building's own frame."""

    cells: tuple[int, int]
    upright: bool
    at: float
    low: float
    high: float


def _shared(a: Box, b: Box) -> tuple[bool, float, float, float] | None:
    """Whether the common edge of two cells is upright, where it is, and from where to where."""
    for upright, (i, j) in ((True, (0, 2)), (False, (1, 3))):
        for near, far in ((a, b), (b, a)):
            if math.isclose(near[j], far[i], abs_tol=1e-9):
                low = max(a[1 - i % 2], b[1 - i % 2])
                high = min(a[3 - i % 2], b[3 - i % 2])
                if high - low > 1.3:
                    return upright, near[j], low, high
    return None


def _add_doors(
    building: Building, chance: random.Random, number: int, cells: Sequence[Box]
) -> list[Gap]:
    """A spanning tree of doors between neighbouring cells, and some more."""
    edges = [
        (a, b, shared)
        for a in range(len(cells))
        for b in range(a + 1, len(cells))
        if (shared := _shared(cells[a], cells[b]))
    ]
    chance.shuffle(edges)
    group = list(range(len(cells)))
    gaps = []
    for a, b, (upright, at, low, high) in edges:
        if group[a] == group[b] and chance.random() < 0.7:
            continue
        group = [group[a] if g == group[b] else g for g in group]
        width = chance.uniform(0.8, min(2.4, high - low - 0.2))
        start = chance.uniform(low + 0.1, high - 0.1 - width)
        gaps.append(Gap((a, b), upright, at, start, start + width))
        ends = [(at, start), (at, start + width)] if upright else [(start, at), (start + width, at)]
        building.doors.append(
            Door(
                f"d{number}_{len(gaps)}",
                (f"r{number}_{a}", f"r{number}_{b}"),
                (building.placed(*ends[0]), building.placed(*ends[1])),
            )
        )
    return gaps


def _add_walls(
    building: Building,
    chance: random.Random,
    cells: Sequence[Box],
    gaps: Sequence[Gap],
    box: Box,
    thick: float,
    floor: float,
    height: float,
) -> None:
    """Walls along all edges of cells, in pieces between the doors."""
    name = chance.choice(WALLS)
    lines: dict[tuple[bool, float], list[tuple[float, float]]] = {}
    for x0, y0, x1, y1 in cells:
        for upright, at, low, high in (
            (True, x0, y0, y1),
            (True, x1, y0, y1),
            (False, y0, x0, x1),
            (False, y1, x0, x1),
        ):
            lines.setdefault((upright, round(at, 9)), []).append((low, high))
    for (upright, at), spans in lines.items():
        solid = shapely.unary_union([shapely.LineString([(a, 0), (b, 0)]) for a, b in spans])
        open_ = [
            shapely.LineString([(g.low, 0), (g.high, 0)])
            for g in gaps
            if g.upright == upright and math.isclose(g.at, at, abs_tol=1e-8)
        ]
        rest = solid.difference(shapely.unary_union(open_)) if open_ else solid
        for piece in shapely.get_parts(rest):
            low, _, high, _ = piece.bounds
            if high - low < 0.05:
                continue
            sides = (at - thick / 2, low, at + thick / 2, high)
            if not upright:
                sides = (low, at - thick / 2, high, at + thick / 2)
            what = "wall" if high - low >= 1.6 else "stub"
            building.add(name, what, sides, floor, floor + height)


def _add_things(
    building: Building,
    chance: random.Random,
    number: int,
    cells: Sequence[Box],
    gaps: Sequence[Gap],
    thick: float,
    floor: float,
    height: float,
) -> None:
    """Furniture in rooms and openings, things on it, on the floor, on walls and at ceilings."""
    for cell in cells:
        x0, y0, x1, y1 = cell
        taken: list[Polygon] = []
        for _ in range(chance.randrange(4)):
            dx, dy, dz = (
                chance.uniform(0.4, 1.2),
                chance.uniform(0.4, 1.0),
                chance.uniform(0.3, 1.1),
            )
            x = chance.uniform(x0 + thick, x1 - thick - dx)
            y = chance.uniform(y0 + thick, y1 - thick - dy)
            ground = shapely.box(x, y, x + dx, y + dy)
            if any(ground.buffer(0.05).intersects(other) for other in taken):
                continue
            taken.append(ground)
            table = building.add(
                chance.choice(FURNITURE), "thing", ground.bounds, floor, floor + dz
            )
            _add_on(building, chance, table, ground.bounds)
        if chance.random() < 0.5:
            x, y = chance.uniform(x0 + 0.5, x1 - 0.8), chance.uniform(y0 + 0.5, y1 - 0.8)
            top = floor + height
            lamp = (x, y, x + 0.3, y + 0.3)
            building.add(chance.choice(SMALL), "thing", lamp, top - 0.4, top - 0.1)
        if chance.random() < 0.5:  # a picture on the left wall
            y = chance.uniform(y0 + 0.5, y1 - 1.2)
            picture = (x0 + thick / 2, y, x0 + thick / 2 + 0.03, y + 0.6)
            building.add(chance.choice(SMALL), "thing", picture, floor + 1.4, floor + 1.8)
    for gap in gaps:
        if gap.high - gap.low > 1.5 and chance.random() < 0.6:
            middle = (gap.low + gap.high) / 2
            half = chance.uniform(0.4, 0.7)
            shift = chance.uniform(-0.3, 0.3)
            sides = (gap.at + shift - half, middle - 0.4, gap.at + shift + half, middle + 0.4)
            if not gap.upright:
                sides = (sides[1], sides[0], sides[3], sides[2])
            overlap = shapely.box(*sides).buffer(0.02)
            own = building.outline(overlap)
            if any(
                item.what in ("thing", "wall", "stub")
                and item.low < floor + 0.8
                and item.high > floor + 0.01
                and own.intersects(item.ground)
                for item in building.items
            ):
                continue
            table = building.add(chance.choice(FURNITURE), "thing", sides, floor, floor + 0.72)
            _add_on(building, chance, table, sides)


def _add_on(building: Building, chance: random.Random, table: Item, box: Box) -> None:
    """Put at most one small thing on a piece of furniture."""
    if chance.random() < 0.6:
        x = chance.uniform(box[0] + 0.05, box[2] - 0.15)
        y = chance.uniform(box[1] + 0.05, box[3] - 0.15)
        small = (x, y, x + 0.1, y + 0.1)
        building.add(chance.choice(SMALL), "thing", small, table.high, table.high + 0.1, table.name)


def room_of(building: Building, item: Item) -> set[str]:
    """The rooms that an independent judge accepts as that of an item, by Shapely.

    One room, where one has clearly most of its ground; the two nearest, where they have as much.
    """
    middle = (item.low + item.high) / 2
    shares = {
        room.name: room.outline.intersection(item.ground).area / item.ground.area
        for room in building.rooms
        if room.floor - 0.03 <= middle <= room.ceiling + 0.03
    }
    inside = {name: share for name, share in shares.items() if share > 0}
    if sum(inside.values()) >= 0.5:
        most = max(inside.values())
        return {name for name, share in inside.items() if share > most - 1e-4}
    centre = item.ground.centroid
    away = {
        room.name: room.outline.distance(centre)
        for room in building.rooms
        if room.name in shares and room.outline.distance(centre) < 1.0
    }
    least = min(away.values(), default=0.0)
    return {name for name, distance in away.items() if distance < least + 1e-4}
