"""The floor plan of the office: storeys, rooms, doors, windows, regions, and what stands where.

After Figure 4 of Deeken et al.: who brings the muffin from desk4 to desk1 passes door7, the
nearer one to door8; who comes for it from the elevator passes door6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

WALL = 0.2
"""Thickness of all walls, metres: so far are the polygons of neighbouring rooms apart."""

OUTER = (-WALL, -WALL, 18.0 + WALL, 10.0 + WALL)
"""The building from outside: x and y from, x and y to."""

DOOR_HEIGHT = 2.1
WINDOW = (0.9, 2.2)
"""Sill and head of all windows, above the floor."""


@dataclass(frozen=True)
class Storey:
    """`height` is the clear one, from floor to ceiling."""

    name: str
    short: str
    elevation: float
    height: float = 3.0


FIRST = Storey("floor-1st", "1st", 0.0)
THIRD = Storey("floor-3rd", "3rd", 7.0)
STOREYS = (FIRST, THIRD)


@dataclass(frozen=True)
class Room:
    """`inside` is what its walls' inner faces enclose: x and y from, x and y to."""

    name: str
    type: str
    label: str
    storey: Storey
    inside: tuple[float, float, float, float]
    elevator: str | None = None


ROOMS = (
    Room("lab1", "lab", "lab", FIRST, (10.6, 0, 18, 4)),
    Room("corridor1", "corridor", "corridor", FIRST, (4.4, 4.2, 18, 6.2)),
    Room("foyer-1st", "foyer", "foyer", FIRST, (0, 0, 4.2, 7.2)),
    Room("elevator-1st", "elevator_cabin", "elevator", FIRST, (2.2, 7.4, 3.8, 9.2), "elevator"),
    Room("kitchen", "kitchen", "kitchen", FIRST, (4.4, 6.4, 10.4, 10)),
    Room("office2", "office", "office", FIRST, (4.4, 0, 10.4, 4)),
    Room("meeting1", "meeting_room", "meeting room", FIRST, (10.6, 6.4, 18, 10)),
    Room("restroom1", "restroom", "restroom", FIRST, (0, 7.4, 2, 10)),
    Room("elevator-3rd", "elevator_cabin", "elevator", THIRD, (2.2, 7.4, 3.8, 9.2), "elevator"),
    Room("foyer-3rd", "foyer", "foyer", THIRD, (0, 3, 4.2, 7.2)),
    Room("corridor3", "corridor", "corridor", THIRD, (4.4, 4.2, 13.8, 6.2)),
    Room("office4", "office", "office", THIRD, (4.4, 0, 13.8, 4)),
    Room("lab2", "lab", "lab", THIRD, (14, 0, 18, 10)),
    Room("office5", "office", "office", THIRD, (4.4, 6.4, 9, 10)),
    Room("meeting3", "meeting_room", "meeting room", THIRD, (9.2, 6.4, 13.8, 10)),
    Room("copyroom3", "copy_room", "copy room", THIRD, (0, 0, 4.2, 2.8)),
    Room("restroom3", "restroom", "restroom", THIRD, (0, 7.4, 2, 10)),
)


@dataclass(frozen=True)
class Door:
    """A door in the middle of its wall; `along` is the axis that its opening lies along."""

    name: str
    joins: tuple[str, str]
    storey: Storey
    middle: tuple[float, float]
    along: str
    width: float = 0.9
    type: str = "door"
    state: str = "open"
    behaviour: str = "pass_door"

    @property
    def line(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The ends of the opening."""
        (x, y), half = self.middle, self.width / 2
        if self.along == "x":
            return (x - half, y), (x + half, y)
        return (x, y - half), (x, y + half)


ELEVATOR_DOOR = (0.9, "elevator_door", "closed", "call_elevator")
EXTERIOR = (1.2, "exterior_door", "locked")
OUTSIDE = "outside"

DOORS = (
    Door("door1", ("lab1", "corridor1"), FIRST, (13.0, 4.1), "x"),
    Door("door2", ("corridor1", "foyer-1st"), FIRST, (4.3, 5.2), "y"),
    Door("door3", ("corridor1", "kitchen"), FIRST, (7.4, 6.3), "x"),
    Door("door4", ("corridor1", "office2"), FIRST, (7.0, 4.1), "x"),
    Door("door9", ("corridor1", "meeting1"), FIRST, (12.0, 6.3), "x"),
    Door("door10", ("foyer-1st", "restroom1"), FIRST, (1.0, 7.3), "x", state="closed"),
    Door("entrance", ("foyer-1st", OUTSIDE), FIRST, (2.2, -0.1), "x", *EXTERIOR),
    Door("edoor1", ("foyer-1st", "elevator-1st"), FIRST, (3.0, 7.3), "x", *ELEVATOR_DOOR),
    Door("edoor3", ("elevator-3rd", "foyer-3rd"), THIRD, (3.0, 7.3), "x", *ELEVATOR_DOOR),
    Door("door5", ("foyer-3rd", "corridor3"), THIRD, (4.3, 5.2), "y"),
    Door("door6", ("corridor3", "office4"), THIRD, (5.7, 4.1), "x"),
    Door("door7", ("office4", "corridor3"), THIRD, (12.6, 4.1), "x"),
    Door("door8", ("corridor3", "lab2"), THIRD, (13.9, 5.2), "y"),
    Door("door11", ("foyer-3rd", "copyroom3"), THIRD, (1.4, 2.9), "x"),
    Door("door12", ("foyer-3rd", "restroom3"), THIRD, (1.0, 7.3), "x", state="closed"),
    Door("door13", ("corridor3", "office5"), THIRD, (6.7, 6.3), "x", state="locked"),
    Door("door14", ("corridor3", "meeting3"), THIRD, (10.2, 6.3), "x"),
)

SOUTH, NORTH, WEST, EAST = "south", "north", "west", "east"

WINDOWS: tuple[tuple[Storey, str, float, float], ...] = (
    *((FIRST, SOUTH, x, 1.4) for x in (5.9, 8.9, 12.1, 14.3, 16.5)),
    *((FIRST, NORTH, x, 1.4) for x in (6.2, 9.2, 12.4, 14.4, 16.4)),
    (FIRST, EAST, 5.2, 1.2),
    *((THIRD, SOUTH, x, 1.4) for x in (2.1, 6.3, 9.2, 12.1, 16.0)),
    *((THIRD, NORTH, x, 1.4) for x in (5.7, 7.7, 10.5, 12.5)),
    *((THIRD, EAST, y, 1.4) for y in (1.8, 4.2, 7.4)),
    (THIRD, WEST, 5.1, 1.4),
)
"""Storey, wall, where along the wall its middle is, width."""

STAIR_HOLE = (0.0, 1.8, 1.2, 4.6)
"""Where the floor of the foyer gives way to stairs that lead down from its north end."""


@dataclass(frozen=True)
class Region:
    """A drawn part of a room; heights above the storey."""

    name: str
    type: str
    storey: Storey
    outline: tuple[float, float, float, float]
    properties: dict[str, object]


REGIONS = (
    Region("home", "home_region", FIRST, (15.4, 2.5, 16.8, 3.7), {"home": True}),
    Region(
        "staircase",
        "staircase",
        FIRST,
        STAIR_HOLE,
        {"blocked": True, "floor": -1.7, "ceiling": 2.1, "leads": "down"},
    ),
    Region(
        "slow-foyer",
        "speed_zone",
        THIRD,
        (2.0, 5.6, 4.2, 7.2),
        {"floor": 0.0, "ceiling": 2.1, "speed_limit": 0.3},
    ),
)


@dataclass(frozen=True)
class Item:
    """An instance of a model; its front looks along `yaw`, degrees; z is above the storey."""

    name: str
    model: str
    room: str
    x: float
    y: float
    yaw: float = 0.0
    z: float = 0.0
    on: str | None = None

    def beside(self, forward: float, left: float) -> tuple[float, float]:
        """A point of the map so far in front of this item and to the left of its front."""
        c, s = math.cos(math.radians(self.yaw)), math.sin(math.radians(self.yaw))
        return round(self.x + c * forward - s * left, 4), round(self.y + s * forward + c * left, 4)


def _items() -> tuple[Item, ...]:
    items: dict[str, Item] = {}

    def put(name: str, model: str, room: str, x: float, y: float, yaw: float = 0.0) -> None:
        items[name] = Item(name, model, room, x, y, yaw)

    def seat(name: str, model: str, at: str, forward: float, left: float, yaw: float = 180) -> None:
        """A chair before something, which it faces."""
        holder = items[at]
        x, y = holder.beside(forward, left)
        items[name] = Item(name, model, holder.room, x, y, (holder.yaw + yaw) % 360)

    def lay(
        name: str, model: str, on: str, forward: float, left: float, z: float, yaw: float = 0.0
    ) -> None:
        """A thing on a surface of another, at height z above that one's own base."""
        holder = items[on]
        x, y = holder.beside(forward, left)
        items[name] = Item(
            name, model, holder.room, x, y, (holder.yaw + yaw) % 360, round(holder.z + z, 4), on
        )

    def shelve(shelf: str, levels: dict[float, int], first: int) -> int:
        """Books upright in rows on the boards of a shelf."""
        for height, count in levels.items():
            for i in range(count):
                lay(f"book{first}", "book", shelf, 0.03, 0.5 - 0.045 * i, height)
                first += 1
        return first

    def workplace(number: int, room: str, x: float, y: float, yaw: float, chair: int) -> None:
        put(f"desk{number}", "desk", room, x, y, yaw)
        seat(f"office_chair{chair}", "office_chair", f"desk{number}", 0.62, 0.05, 172)
        lay(f"monitor{chair}", "monitor", f"desk{number}", -0.22, 0.0, 0.74)

    # first floor
    workplace(2, "lab1", 12.1, 0.45, 90, 1)
    workplace(3, "lab1", 14.3, 0.45, 90, 2)
    put("lab_bench1", "lab_bench", "lab1", 17.58, 1.6, 180)
    lay("laptop1", "laptop", "lab_bench1", 0.05, 0.4, 0.90)
    lay("toolbox_tray", "tray", "lab_bench1", 0.0, -0.5, 0.90)
    put("bookshelf1", "bookshelf", "lab1", 10.8, 1.8, 0)
    put("whiteboard1", "whiteboard", "lab1", 15.6, 3.98, 270)
    put("trash_can1", "trash_can", "lab1", 13.2, 0.25)

    workplace(5, "office2", 5.9, 0.45, 90, 3)
    workplace(6, "office2", 8.9, 0.45, 90, 4)
    put("bookshelf2", "bookshelf", "office2", 10.2, 2.6, 180)
    put("potted_plant1", "potted_plant", "office2", 4.85, 3.5)
    put("trash_can2", "trash_can", "office2", 7.4, 0.25)

    put("kitchen_counter1", "kitchen_counter", "kitchen", 6.2, 9.69, 270)
    put("refrigerator1", "refrigerator", "kitchen", 7.85, 9.66, 270)
    lay("microwave1", "microwave", "kitchen_counter1", 0.0, -0.8, 0.90)
    lay("coffee_machine1", "coffee_machine", "kitchen_counter1", 0.0, -0.2, 0.90)
    put("kitchen_table1", "kitchen_table", "kitchen", 8.5, 8.0, 90)
    for number, (forward, left) in enumerate(((0.75, 0.4), (0.75, -0.4)), 1):
        seat(f"chair{number}", "chair", "kitchen_table1", forward, left)
        seat(f"chair{number + 2}", "chair", "kitchen_table1", -forward, left, 0)
    lay("tray1", "tray", "kitchen_table1", 0.1, 0.35, 0.75)
    lay("cup1", "cup", "tray1", 0.05, 0.1, 0.015, 40)
    lay("cup2", "cup", "tray1", -0.06, -0.09, 0.015, 130)
    lay("plate1", "plate", "kitchen_table1", 0.2, -0.4, 0.75)
    lay("cup3", "cup", "kitchen_table1", -0.22, -0.3, 0.75, 200)
    put("trash_can3", "trash_can", "kitchen", 4.7, 9.7)

    put("conference_table1", "conference_table", "meeting1", 14.4, 8.2, 90)
    for number, left in enumerate((0.8, 0.0, -0.8), 5):
        seat(f"chair{number}", "chair", "conference_table1", 0.9, left)
        seat(f"chair{number + 3}", "chair", "conference_table1", -0.9, left, 0)
    put("whiteboard2", "whiteboard", "meeting1", 17.98, 8.2, 180)
    put("potted_plant2", "potted_plant", "meeting1", 17.5, 9.5)

    put("sofa1", "sofa", "foyer-1st", 3.76, 2.4, 180)
    put("coffee_table1", "coffee_table", "foyer-1st", 2.75, 2.4, 180)
    put("potted_plant3", "potted_plant", "foyer-1st", 3.75, 0.45)
    put("stairs_down", "stair_flight", "foyer-1st", 0.6, 4.6)
    put("printer1", "printer", "corridor1", 16.6, 5.9, 270)
    put("potted_plant4", "potted_plant", "corridor1", 17.6, 4.65)
    put("toilet1", "toilet", "restroom1", 0.6, 9.6, 270)
    put("sink1", "sink", "restroom1", 1.55, 9.75, 270)

    # third floor
    put("sofa2", "sofa", "foyer-3rd", 0.45, 4.8, 0)
    put("coffee_table2", "coffee_table", "foyer-3rd", 1.45, 4.8)
    put("potted_plant5", "potted_plant", "foyer-3rd", 3.8, 3.45)

    workplace(4, "office4", 9.2, 0.45, 90, 5)
    workplace(7, "office4", 6.3, 0.45, 90, 6)
    lay("muffin1", "muffin", "desk4", 0.12, -0.5, 0.74)
    lay("cup4", "cup", "desk4", 0.1, -0.35, 0.74, 75)
    lay("laptop2", "laptop", "desk7", 0.12, 0.5, 0.74, 20)
    put("bookshelf3", "bookshelf", "office4", 4.6, 1.9, 0)
    put("sofa3", "sofa", "office4", 13.34, 1.7, 180)
    put("coffee_table3", "coffee_table", "office4", 12.35, 1.7, 180)
    put("potted_plant6", "potted_plant", "office4", 11.2, 0.45)
    put("trash_can4", "trash_can", "office4", 7.75, 0.25)

    workplace(1, "lab2", 17.55, 4.2, 180, 7)
    put("lab_bench2", "lab_bench", "lab2", 17.58, 7.6, 180)
    put("lab_bench3", "lab_bench", "lab2", 15.8, 0.42, 90)
    # 30 cm apart: the pole of the delivery robot fits between them, its base beneath
    put("workbench1", "workbench", "lab2", 14.94, 2.35, 90)
    put("workbench2", "workbench", "lab2", 17.06, 2.35, 90)
    lay("laptop3", "laptop", "lab_bench3", 0.05, -0.3, 0.90)
    lay("tray2", "tray", "lab_bench2", 0.05, 0.3, 0.90)
    put("bookshelf4", "bookshelf", "lab2", 14.2, 8.2, 0)
    put("whiteboard3", "whiteboard", "lab2", 16.0, 9.98, 270)

    workplace(8, "office5", 5.7, 9.55, 270, 8)
    put("bookshelf5", "bookshelf", "office5", 8.8, 8.2, 180)
    put("potted_plant7", "potted_plant", "office5", 8.5, 9.5)
    put("conference_table2", "conference_table", "meeting3", 11.5, 8.3, 90)
    for number, left in enumerate((0.6, -0.6), 11):
        seat(f"chair{number}", "chair", "conference_table2", 0.9, left)
        seat(f"chair{number + 2}", "chair", "conference_table2", -0.9, left, 0)
    put("whiteboard4", "whiteboard", "meeting3", 13.78, 8.3, 180)
    put("printer2", "printer", "copyroom3", 0.6, 0.3, 90)
    put("printer3", "printer", "copyroom3", 1.4, 0.3, 90)
    put("bookshelf6", "bookshelf", "copyroom3", 4.0, 1.4, 180)
    put("toilet2", "toilet", "restroom3", 0.6, 9.6, 270)
    put("sink2", "sink", "restroom3", 1.55, 9.75, 270)
    put("potted_plant8", "potted_plant", "corridor3", 13.4, 5.8)

    first = shelve("bookshelf1", {0.45: 9, 1.25: 14, 1.65: 5}, 1)
    first = shelve("bookshelf2", {0.85: 12, 1.25: 7}, first)
    first = shelve("bookshelf3", {0.45: 16, 0.85: 11, 1.25: 20}, first)
    first = shelve("bookshelf4", {0.85: 8, 1.65: 6}, first)
    shelve("bookshelf5", {1.25: 10}, first)
    for name in ("whiteboard1", "whiteboard2", "whiteboard3", "whiteboard4"):
        board = items[name]
        items[name] = Item(name, board.model, board.room, board.x, board.y, board.yaw, 0.85)
    return tuple(items.values())


ITEMS = _items()
