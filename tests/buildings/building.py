"""Random buildings: storeys, rooms, doors, slabs, walls and things, under names in no list.

Doors are of all kinds, with a lift and stairs from storey to storey (`tests.buildings.ways`).
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, affinity

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
TILES = ["flagstone", "Fliese", "Diele", "carreau", "lame", "qqw"]
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
DOORS = {
    "door": 5,
    "opening": 2,
    "sliding_door": 2,
    "folding_door": 1,
    "revolving_door": 1,
    "double_door": 1,
    "fire_door": 1,
    "gate": 1,
}
"""The types of doors inside of a storey, and how often they occur."""

CABIN = 1.7
"""Metres of the sides of a lift's cabin."""

SMALL = ["mug", "plate", "Tasse", "Teller", "Dose", "assiette", "bol", "gobelet", "item", "qq"]

SIDES = 2.4
"""Least side of a room, metres."""

OUTSIDE = "outside"
"""The place beyond the building."""


@dataclass(frozen=True)
class Item:
    """A solid: its ground in the map's frame, its heights, what it is, and what bears it.

    `centre` is a point of it, the middle of a box; `size` are its sides in the building's frame.
    """

    name: str
    what: str
    ground: Polygon
    low: float
    high: float
    centre: tuple[float, float]
    size: tuple[float, float]
    on: str | None = None
    points: NDArray[np.float64] | None = None
    """(N, 3) in the map's frame, of what was scanned: it has no mesh."""
    shape: Polygon | None = None
    """Its ground about its centre in the building's frame, where it is no rectangle."""


@dataclass(frozen=True)
class Room:
    """A room: its outline in the map's frame and its heights."""

    name: str
    storey: str
    outline: Polygon
    floor: float
    ceiling: float
    elevator: str | None = None


@dataclass(frozen=True)
class Door:
    """What joins two rooms, or a room and the outside: a door, an opening, stairs, a ramp.

    Stairs and ramps lead from the first end, in the first room, to the second; other ends are the
    posts. `step` is the height of the threshold, `height` that of the clear opening, metres.
    """

    name: str
    rooms: tuple[str, str]
    ends: tuple[tuple[float, float], tuple[float, float]]
    type: str = "door"
    state: str = "open"
    direction: str = "both"
    permission: str | None = None
    height: float | None = None
    step: float = 0.0
    behaviour: str = "pass_door"

    @property
    def climbs(self) -> bool:
        """Whether it leads from one storey to another."""
        return self.type in ("stairs", "escalator", "ramp")

    @property
    def width(self) -> float:
        """Metres from end to end."""
        return math.dist(*self.ends)


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
        shape: Polygon | None = None,
    ) -> Item:
        """Add a box of the building's own frame; or a shape about the middle of the box."""
        x0, y0, x1, y1 = box
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        ground = shapely.box(*box) if shape is None else affinity.translate(shape, x, y)
        left, near, right, far = ground.bounds
        taken = {item.name for item in self.items}
        unique = f"{name}_{next(n for n in range(1000) if f'{name}_{n}' not in taken)}"
        item = Item(
            unique,
            what,
            self.outline(ground),
            low,
            high,
            self.placed(x, y),
            (right - left, far - near),
            on,
            shape=shape,
        )
        self.items.append(item)
        return item

    def room(self, name: str) -> Room:
        """The room of a name."""
        return next(room for room in self.rooms if room.name == name)

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write the building as an SDF world and its rooms as GeoJSON; return both paths."""
        folder.mkdir(parents=True, exist_ok=True)
        world, rooms = folder / f"b{self.seed}.sdf", folder / f"b{self.seed}_rooms.geojson"
        world.write_text(
            f'<sdf version="1.7"><world name="b{self.seed}">'
            + "".join(self._model(item) for item in self.items if item.points is None)
            + "</world></sdf>"
        )
        rooms.write_text(
            json.dumps({"type": "FeatureCollection", "features": list(self.features())})
        )
        return world, rooms

    def _model(self, item: Item) -> str:
        (x, y), (dx, dy) = item.centre, item.size
        height, z = item.high - item.low, (item.low + item.high) / 2
        solid = f"<box><size>{dx} {dy} {height}</size></box>"
        if item.shape is not None:
            corners = [f"<point>{px} {py}</point>" for px, py in item.shape.exterior.coords[:-1]]
            solid = f"<polyline>{''.join(corners)}<height>{height}</height></polyline>"
            z = item.low
        geometry = f"<geometry>{solid}</geometry>"
        return (
            f'<model name="{item.name}"><static>true</static>'
            f"<pose>{x} {y} {z} 0 0 {self.angle}</pose>"
            f'<link name="l"><visual name="v">{geometry}</visual>'
            f'<collision name="c">{geometry}</collision></link></model>'
        )

    def features(self) -> Iterator[dict[str, object]]:
        """The storeys, rooms and doors as GeoJSON."""
        for name, elevation, height in self.storeys:
            yield _feature(None, kind="storey", name=name, elevation=elevation, height=height)
        for room in self.rooms:
            yield _feature(
                shapely.geometry.mapping(room.outline),
                kind="room",
                name=room.name,
                storey=room.storey,
                elevator=room.elevator,
            )
        for door in self.doors:
            yield _feature(
                {"type": "LineString", "coordinates": door.ends},
                kind="connector",
                type=door.type,
                name=door.name,
                joins=",".join(door.rooms),
                storey=self.room(door.rooms[0]).storey,
                state=door.state,
                direction=door.direction,
                permissions=door.permission,
                height=door.height,
                step=door.step,
                behaviour=None if door.type in OWN_BEHAVIOUR else door.behaviour,
            )


OWN_BEHAVIOUR = ("opening", "elevator_door", "stairs", "escalator", "ramp")
"""The types whose behaviour follows from the type; doors state theirs."""


def _feature(geometry: object, **properties: object) -> dict[str, object]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


Box = tuple[float, float, float, float]


def random_building(seed: int, *, plain: bool = False) -> Building:
    """The building of a seed: one to four storeys, turned and anywhere on the map.

    In a `plain` one, outlines of rooms are the faces of walls, and no furniture is like a wall.
    """
    chance = random.Random(seed)
    angle = chance.choice([0.0, math.pi / 2, chance.uniform(-math.pi, math.pi)])
    building = Building(seed, angle, (chance.uniform(-50, 50), chance.uniform(-50, 50)))
    width, depth = chance.uniform(7, 16), chance.uniform(6, 12)
    thick, height = chance.uniform(0.08, 0.3), chance.uniform(2.6, 3.2)
    bottom = chance.choice([0.0, 0.0, chance.uniform(-4, 20)])
    count = chance.choice([1, 1, 2, 3, 4])
    kinds = random.Random(f"doors of {seed}")  # of its own: what else there is stays the same
    lift = kinds.uniform(0.1, depth - CABIN - 0.1) if count > 1 and kinds.random() < 0.8 else None
    for number in range(count):
        elevation = bottom + number * (height + 0.3)
        building.storeys.append((f"s{number}", elevation, height))
        _add_storey(building, chance, kinds, number, (0.0, 0.0, width, depth), thick, lift, plain)
    for number in range(count - 1):
        _add_stairs(building, kinds, number)
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
    building: Building,
    chance: random.Random,
    kinds: random.Random,
    number: int,
    box: Box,
    thick: float,
    lift: float | None,
    plain: bool,
) -> None:
    storey, floor, height = building.storeys[number]
    cells = _split(chance, box)
    chance.shuffle(cells)
    slab = chance.uniform(0.05, 0.28)
    name = chance.choice(FLOORS)
    covers = [box] if chance.random() < 0.6 else cells
    drawn = random.Random(f"outlines of {building.seed}")  # at the faces of walls, or in them
    inset, shift = thick / 2, 0.0
    if drawn.random() < 0.4 and not plain:
        inset, shift = 0.0, thick * drawn.uniform(-0.45, 0.45)
    laid = random.Random(f"tiles of {building.seed} {number}")
    tiled = laid.choice(covers) if len(covers) > 1 and laid.random() < 0.4 and not plain else None
    for cover in covers:
        if cover is tiled:
            _add_tiles(building, laid, cover, floor)
        else:
            building.add(name, "floor", cover, floor - slab, floor)
    if chance.random() < 0.5:
        building.add(chance.choice(CEILINGS), "ceiling", box, floor + height, floor + height + 0.02)
    for k, cell in enumerate(cells):
        inner = shapely.box(*cell).buffer(-inset, join_style="mitre")
        building.rooms.append(
            Room(f"r{number}_{k}", storey, building.outline(inner), floor, floor + height)
        )
    gaps = _add_doors(building, chance, kinds, number, cells)
    gaps += _add_way_out(building, kinds, number, cells)
    if lift is not None:
        gaps += _add_cabin(building, kinds, number, cells, thick, lift)
    _add_walls(building, chance, cells, gaps, box, thick, floor, height, shift)
    left, lower = (
        [cell[k] + thick / 2 + (shift if cell[k] > box[k] else 0.0) for cell in cells]
        for k in (0, 1)
    )
    _add_things(building, chance, number, cells, left, gaps, thick, floor, height)
    if not plain:
        _add_against_walls(building, number, cells, lower, gaps, floor, height)
    for k in range(len(cells)):
        _add_corner(building, f"r{number}_{k}", cells[k])


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


def _add_tiles(building: Building, chance: random.Random, cover: Box, floor: float) -> None:
    """A floor of tiles or planks with joints of up to 3 mm, none as wide as a slab."""
    x0, y0, x1, y1 = cover
    name, joint = chance.choice(TILES), chance.uniform(0.0, 0.003)
    thick, size = chance.uniform(0.012, 0.04), chance.uniform(0.4, 0.9)
    long = size * chance.choice([1, 1, 4])
    along, across = max(1, round((x1 - x0) / long)), math.ceil((y1 - y0) / size)
    dx, dy = (x1 - x0) / along, (y1 - y0) / across
    for i in range(along):
        for k in range(across):
            x, y = x0 + i * dx, y0 + k * dy
            tile = (x, y, x + dx - joint, y + dy - joint)
            building.add(name, "floor", tile, floor - thick, floor)


def _add_doors(
    building: Building,
    chance: random.Random,
    kinds: random.Random,
    number: int,
    cells: Sequence[Box],
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
            _door(
                kinds,
                f"d{number}_{len(gaps)}",
                (f"r{number}_{a}", f"r{number}_{b}"),
                (building.placed(*ends[0]), building.placed(*ends[1])),
            )
        )
    return gaps


Ends = tuple[tuple[float, float], tuple[float, float]]


def _door(kinds: random.Random, name: str, rooms: tuple[str, str], ends: Ends) -> Door:
    """A door of any kind: what opens, what is locked, what leads one way, what some may pass."""
    (type_,) = kinds.choices([*DOORS], [*DOORS.values()])
    if type_ == "opening":
        return Door(name, rooms, ends, type_, behaviour="drive_through")
    (state,) = kinds.choices(["open", "closed", "locked"], [12, 6, 1])
    (direction,) = kinds.choices(["both", "forward", "backward"], [38, 1, 1])
    by_itself = type_ == "sliding_door" and state == "open" and kinds.random() < 0.5
    return Door(
        name,
        rooms,
        ends,
        type_,
        state,
        direction,
        "staff" if kinds.random() < 0.03 else None,
        1.0 if kinds.random() < 0.03 else kinds.choice([None, kinds.uniform(1.9, 2.2)]),
        0.05 if kinds.random() < 0.03 else kinds.choice([0.0, 0.01]),
        "drive_through" if by_itself else "pass_door",
    )


def _add_way_out(
    building: Building, kinds: random.Random, number: int, cells: Sequence[Box]
) -> list[Gap]:
    """A door in the left wall of the lowest storey, or none."""
    fronts = [k for k, cell in enumerate(cells) if cell[0] == 0.0]
    if number or kinds.random() < 0.4:
        return []
    cell = kinds.choice(fronts)
    start = kinds.uniform(cells[cell][1] + 0.3, cells[cell][3] - 1.3)
    ends = building.placed(0.0, start), building.placed(0.0, start + 1.0)
    way_out = _door(kinds, "way_out", (f"r{number}_{cell}", OUTSIDE), ends)
    if way_out.type != "opening":
        way_out = replace(way_out, type="exterior_door")
    building.doors.append(way_out)
    return [Gap((cell, cell), True, 0.0, start, start + 1.0)]


def _add_cabin(
    building: Building,
    kinds: random.Random,
    number: int,
    cells: Sequence[Box],
    thick: float,
    start: float,
) -> list[Gap]:
    """The lift at the right wall: its shaft, its cabin and its door, where no wall meets them."""
    storey, floor, height = building.storeys[number]
    edge = max(cell[2] for cell in cells)
    middle, near, far = start + CABIN / 2, edge + thick / 2, edge + thick / 2 + CABIN
    served = [
        k
        for k, cell in enumerate(cells)
        if cell[2] == edge and cell[1] + thick < middle - 0.45 and middle + 0.45 < cell[3] - thick
    ]
    if not served:
        return []
    for box in (
        (near, start - 0.1, far + 0.1, start),
        (near, start + CABIN, far + 0.1, start + CABIN + 0.1),
        (far, start, far + 0.1, start + CABIN),
    ):
        building.add(kinds.choice(WALLS), "wall", box, floor, floor + height)
    name = f"cabin{number}"
    _add_in_cabin(building, number, (near, start, far, start + CABIN), floor)
    outline = building.outline(shapely.box(near, start, far, start + CABIN))
    building.rooms.append(Room(name, storey, outline, floor, floor + height, "lift"))
    ends = building.placed(edge, middle - 0.45), building.placed(edge, middle + 0.45)
    state = kinds.choice(["open", "closed", "closed"])
    joins = (f"r{number}_{served[0]}", name)
    building.doors.append(Door(f"lift_door{number}", joins, ends, "elevator_door", state))
    return [Gap((served[0], served[0]), True, edge, middle - 0.45, middle + 0.45)]


def _add_in_cabin(building: Building, number: int, box: Box, floor: float) -> None:
    """In one cabin of three a thing that may fill it, or stand before its door."""
    chance = random.Random(f"cabin {number} of {building.seed}")
    if chance.random() < 1 / 3:
        dx, dy = chance.uniform(0.1, 1.3), chance.uniform(0.2, 1.3)
        x = chance.uniform(box[0] + 0.1, box[2] - 0.1 - dx)
        y = chance.uniform(box[1] + 0.1, box[3] - 0.1 - dy)
        name = chance.choice(FURNITURE)
        building.add(name, "thing", (x, y, x + dx, y + dy), floor, floor + chance.uniform(0.4, 1.0))


def _add_stairs(building: Building, kinds: random.Random, number: int) -> None:
    """Stairs or a ramp to the storey above, from free floor to free floor, or none."""
    if kinds.random() < 0.3:
        return
    type_ = kinds.choice(["stairs", "stairs", "escalator", "ramp"])
    ends, names = [], []
    for level in (number, number + 1):
        storey, floor, _ = building.storeys[level]
        taken = shapely.union_all(
            [i.ground for i in building.items if i.low < floor + 1.8 and i.high > floor + 0.05]
        )
        rooms = [r for r in building.rooms if r.storey == storey and r.elevator is None]
        room = kinds.choice(rooms)
        for _ in range(20):
            x0, y0, x1, y1 = room.outline.bounds
            at = shapely.Point(kinds.uniform(x0, x1), kinds.uniform(y0, y1))
            if room.outline.contains(at) and taken.distance(at) > 0.6:
                ends.append((at.x, at.y))
                names.append(room.name)
                break
    if len(ends) == 2 and math.dist(*ends) > 1:
        behaviour = "drive_through" if type_ == "ramp" else "climb_stairs"
        (direction,) = kinds.choices(["both", "forward", "backward"], [4, 1, 1])
        name, rooms = f"{type_}{number}", (names[0], names[1])
        way = (ends[0], ends[1])
        stairs = Door(name, rooms, way, type_, "open", direction, behaviour=behaviour)
        building.doors.append(stairs)
        _add_on_stairs(building, stairs)


def _add_on_stairs(building: Building, stairs: Door) -> None:
    """Across stairs now and then a thing that stands on the floor below, and is above the steps."""
    chance = random.Random(f"thing on {stairs.name} of {building.seed}")  # what else there is stays
    room = building.room(stairs.rooms[0])
    rise = building.room(stairs.rooms[1]).floor - room.floor
    line = shapely.LineString(stairs.ends)
    rooms = [r.outline for r in building.rooms if r.storey == room.storey and not r.elevator]
    doors = [shapely.LineString(d.ends) for d in building.doors if not d.climbs]
    for _ in range(chance.choice([0, 20]) if line.length > rise else 0):
        part, size = chance.uniform(0.25, 0.5), chance.uniform(0.2, 0.8)
        at = line.interpolate(part, normalized=True)
        beside = chance.uniform(0.0, 0.4), chance.uniform(-math.pi, math.pi)
        x, y = at.x + beside[0] * math.cos(beside[1]), at.y + beside[0] * math.sin(beside[1])
        flat = affinity.translate(shapely.Point(x, y), -building.origin[0], -building.origin[1])
        flat = affinity.rotate(flat, -building.angle, origin=(0, 0), use_radians=True)
        box = (flat.x - size / 2, flat.y - size / 2, flat.x + size / 2, flat.y + size / 2)
        ground = building.outline(shapely.box(*box))
        high = room.floor + min(rise * part + chance.uniform(0.1, 0.8), 2.2)
        others = [i.ground for i in building.items if i.low < high and i.high > room.floor + 0.01]
        if (
            any(outline.contains(ground.buffer(0.1)) for outline in rooms)
            and all(other.distance(ground) > 0.1 for other in others)
            and all(door.distance(ground) > 1.2 for door in doors)
        ):
            building.add(chance.choice(FURNITURE), "thing", box, room.floor, high)
            return


def _add_walls(
    building: Building,
    chance: random.Random,
    cells: Sequence[Box],
    gaps: Sequence[Gap],
    box: Box,
    thick: float,
    floor: float,
    height: float,
    shift: float,
) -> None:
    """Walls along all inner edges of cells and at the outer ones, in pieces between the doors.

    Inner ones may be beside the edge by a `shift`, metres.
    """
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
            outer = any(math.isclose(at, box[k], abs_tol=1e-8) for k in (1 - upright, 3 - upright))
            near = at - thick / 2 + (0.0 if outer else shift)
            sides = (near, low, near + thick, high)
            if not upright:
                sides = (low, near, high, near + thick)
            building.add(name, "wall", sides, floor, floor + height)


def _add_things(
    building: Building,
    chance: random.Random,
    number: int,
    cells: Sequence[Box],
    faces: Sequence[float],
    gaps: Sequence[Gap],
    thick: float,
    floor: float,
    height: float,
) -> None:
    """Furniture in rooms and openings, things on it, on the floor, on walls and at ceilings."""
    for cell, face in zip(cells, faces, strict=True):
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
            picture = (face, y, face + 0.03, y + 0.6)
            name = chance.choice(SMALL)
            if not any(shapely.box(*picture).intersects(_before(gap)) for gap in gaps):
                building.add(name, "thing", picture, floor + 1.4, floor + 1.8)
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
                item.what in ("thing", "wall")
                and item.low < floor + 0.8
                and item.high > floor + 0.01
                and own.intersects(item.ground)
                for item in building.items
            ):
                continue
            table = building.add(chance.choice(FURNITURE), "thing", sides, floor, floor + 0.72)
            _add_on(building, chance, table, sides)


def _add_against_walls(
    building: Building,
    number: int,
    cells: Sequence[Box],
    faces: Sequence[float],
    gaps: Sequence[Gap],
    floor: float,
    height: float,
) -> None:
    """A partition that ends in the room, and furniture like it: shelves, wardrobes, boards.

    All lead from the face of the lower wall, or stand along it, where there is room.
    """
    chance = random.Random(f"against walls of {building.seed} {number}")
    for (x0, _, x1, _), y in zip(cells, faces, strict=True):
        kind = chance.choice(["none", "partition", "wardrobe", "shelf", "divider", "board"])
        bottom, top = floor, floor + chance.uniform(1.5, 2.2)
        dx, dy = chance.uniform(0.6, 1.2), chance.uniform(0.2, 0.4)
        if kind == "partition":
            dx, dy = chance.uniform(0.05, 0.2), chance.uniform(0.6, 1.2)
            top = floor + height - chance.uniform(0.0, 0.25)
        elif kind == "wardrobe":
            dy, top = 0.3, floor + 2.2
        elif kind == "divider":
            dx, dy = chance.uniform(0.25, 0.4), chance.uniform(0.6, 1.2)
        elif kind == "board":
            dy, bottom, top = chance.uniform(0.02, 0.08), floor + 0.8, floor + 2.0
        x = chance.uniform(x0 + 0.6, x1 - 0.6 - dx)
        name = chance.choice(WALLS if kind == "partition" else FURNITURE)
        if bottom > floor and name in ("desk", "Tisch"):  # a table hangs on no wall
            name = "board"
        around = building.outline(shapely.box(x, y, x + dx, y + dy).buffer(0.05))
        ways = [building.outline(_before(gap)) for gap in gaps]
        if kind == "none" or any(around.intersects(way) for way in ways):
            continue
        if any(
            item.low < top and item.high > bottom + 0.01 and item.ground.intersects(around)
            for item in building.items
            if item.what == "thing"
        ):
            continue
        what = "wall" if kind == "partition" else "thing"
        building.add(name, what, (x, y, x + dx, y + dy), bottom, top)


def _before(gap: Gap) -> Polygon:
    """The ground before an opening, on both of its sides."""
    sides = (gap.at - 1.0, gap.low - 0.3, gap.at + 1.0, gap.high + 0.3)
    return shapely.box(*(sides if gap.upright else (sides[1], sides[0], sides[3], sides[2])))


def _add_on(building: Building, chance: random.Random, table: Item, box: Box) -> None:
    """Put at most one small thing on a piece of furniture."""
    if chance.random() < 0.6:
        x = chance.uniform(box[0] + 0.05, box[2] - 0.15)
        y = chance.uniform(box[1] + 0.05, box[3] - 0.15)
        side = random.Random(f"{building.seed} {table.name}").choice([0.05, 0.05, 0.1])
        small = (x, y, x + side, y + side)
        building.add(
            chance.choice(SMALL), "thing", small, table.high, table.high + side, table.name
        )


def _add_corner(building: Building, name: str, cell: Box) -> None:
    """Furniture like an L or U in a room, with something on the floor between its arms."""
    chance = random.Random(f"corner of {name} in {building.seed}")  # what else there is stays
    room = building.room(name)
    for _ in range(chance.choice([0, 0, 8])):
        wide, deep, arm = (
            chance.uniform(0.9, 1.6),
            chance.uniform(0.8, 1.4),
            chance.uniform(0.25, 0.4),
        )
        right = chance.choice([0.0, arm])  # the second arm of a U
        shape = shapely.box(0, 0, wide, deep) - shapely.box(arm, arm, wide - right, deep)
        shape = affinity.translate(shape, -wide / 2, -arm / 2)
        turn = chance.choice([0, 90, 180, 270])
        x, y = chance.uniform(cell[0], cell[2]), chance.uniform(cell[1], cell[3])
        shape = affinity.rotate(shape, turn, origin=(0, 0))
        ground = building.outline(affinity.translate(shape.convex_hull, x, y))
        high = room.floor + chance.uniform(0.3, 1.1)
        if not room.outline.contains(ground.buffer(0.02)) or any(
            item.low < high + 0.2 and item.high > room.floor and item.ground.distance(ground) < 0.05
            for item in building.items
        ):
            continue
        at = (x, y, x, y)
        table = building.add(chance.choice(FURNITURE), "thing", at, room.floor, high, shape=shape)
        side = min(chance.uniform(0.1, 0.25), wide - right - arm - 0.02)
        between = (arm + wide - right) / 2 - wide / 2, arm / 2 + (deep - arm) / 2
        spot = affinity.rotate(shapely.Point(between), turn, origin=(0, 0))
        low = (x + spot.x - side / 2, y + spot.y - side / 2)
        top = room.floor + chance.uniform(0.1, 0.6)
        box = (*low, low[0] + side, low[1] + side)
        building.add(chance.choice(SMALL), "thing", box, room.floor, top)
        _add_on(building, chance, table, (x - 0.1, y - 0.1, x + 0.15, y + 0.15))
        return


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
