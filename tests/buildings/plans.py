"""The judge of plans: goals by chance, for stored robots and the one of which nothing is known.

A plan is followed action by action in a world of its own, made of the building's description.
What cannot be reached is refused with a reason that names what is in the way.
"""

from __future__ import annotations

import itertools
import random
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import networkx as nx
import shapely

import semmap
from tests.buildings.building import Building, Door, Item, room_of
from tests.buildings.ways import BODY, Body, Ground, doors_of, refusal
from tests.robot.robots import REAL, real_robot

LIFTED = (0.0, 1.6)
"""Lowest and highest middle of what robots lift, metres above the floor."""

WIDEST = 0.6
"""Metres of the second longest side of what robots lift."""

HANDS: dict[str | None, float] = {"tiago": 0.07, "stretch": 0.14}
HAND = 0.09
"""Metres that the hands of robots open, and those of robots that state none."""

ARMS: dict[str | None, tuple[float, float]] = {"stretch": (0.0, 0.95), "tiago": (0.0, 1.05)}
"""Metres from the axis of a robot to what its gripper gets to, at most 0.94 and 1.05 m. Plans
know these arms, so that the reach of the class does not count; they may get to less than that."""

OFFICE = Path(__file__).parents[2] / "examples" / "office"

INSTALLED = {distribution.name for distribution in distributions()}

ROBOTS = ["delivery", *(name for name in ("tiago", "stretch") if REAL[name][0] in INSTALLED)]
"""The example's robot, and the real ones whose packages are installed."""

Relation = tuple[str, str, str]
"""on, in or carries; a thing or the robot; a thing, a room or a thing that the robot carries."""


@dataclass
class Truth:
    """The world that a plan is followed in, from the building's description alone."""

    building: Building
    ground: Ground
    place: str
    robot: str | None = None
    below: dict[str, str] = field(default_factory=dict)
    held: list[str] = field(default_factory=list)
    opened: str | None = None
    called: bool = False
    moved: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.items = {item.name: item for item in self.building.items if item.what == "thing"}
        self.doors = {door.name: door for door in self.building.doors}
        self.storeys = {room.name: room.storey for room in self.building.rooms}
        self.cabins = {room.name for room in self.building.rooms if room.elevator}
        for item in self.items.values():
            self.below[item.name] = item.on or min(room_of(self.building, item), default="")

    def rooms(self, name: str) -> set[str]:
        """The rooms in which a thing may be: by its own ground, once moved by what it stands on."""
        if name in self.storeys:
            return {name}
        if name not in self.items or name in self.held:
            return set()
        if name in self.moved:
            return self.rooms(self.below[name])
        return room_of(self.building, self.items[name])

    # -- actions

    def follow(self, action: Any) -> str | None:
        """Carry an action out; why that cannot be, else None."""
        for step in action.steps:
            wrong = self._drive(step) if step.behaviour == "navigate" else None
            if wrong:
                return wrong
        if action.name == "navigate":
            return None if action.names[0] == self.place else f"the robot is in {self.place}"
        if action.name in ("pickup", "place"):
            return (self._pick if action.name == "pickup" else self._put)(action)
        if action.name == "call_elevator":
            doors = [d for d in self.doors.values() if self.place in d.rooms]
            self.called = any(self.cabins & {*d.rooms} for d in doors)
            return None if self.called else f"no lift comes to {self.place}"
        if action.name == "use_elevator":
            return self._ride(action.names)
        if action.name == "open_door":
            return self._open(self.doors[action.names[0]])
        return self._pass(action.name, *action.names)

    def _open(self, door: Door) -> str | None:
        if self.place not in door.rooms or door.state != "closed":
            return f"{door.name} is {door.state} and joins {door.rooms}"
        self.opened = door.name
        return None

    def _pass(self, behaviour: str, name: str, here: str, there: str) -> str | None:
        door = self.doors[name]
        if here != self.place or {here, there} != {*door.rooms}:
            return f"{name} joins {door.rooms}; the robot is in {self.place}"
        wrong = refusal(self.building, door, door.rooms.index(here), self.ground.body)
        if wrong or behaviour != door.behaviour:
            return f"{name}: {wrong or door.behaviour}"
        lift = door.type == "elevator_door"
        if door.state == "closed" and not lift and self.opened != name:
            return f"{name} is closed"
        if there in self.cabins and not self.called:
            return "the lift was not called"
        self.place, self.opened, self.called = there, None, False
        return None

    def _ride(self, storeys: Sequence[str]) -> str | None:
        there = [c for c in self.cabins if self.storeys[c] == storeys[1]]
        if self.place not in self.cabins or not there or self.storeys[self.place] != storeys[0]:
            return f"no lift leads from {self.place} to {storeys[1]}"
        self.place = there[0]
        return None

    def _pick(self, action: Any) -> str | None:
        name, on = action.names
        item = self.items[name]
        if self.below.get(name) != on and on not in self.rooms(name):
            return f"{name} is on {self.below.get(name)}, not {on}"
        above = [a for a, b in self.below.items() if b == name]
        if self.held or above or not can_be_lifted(self.building, item, self.robot):
            return f"the robot carries {self.held}, on {name} are {above}"
        wrong = self._stands(action.at, name)
        if wrong is None:
            self.below.pop(name)
            self.held = [name]
        return wrong

    def _put(self, action: Any) -> str | None:
        name, on = action.names
        if self.held != [name]:
            return f"the robot carries {self.held}"
        wrong = self._stands(action.at, on)
        if wrong is None:
            self.below[name], self.held = on, []
            self.moved.add(name)
        return wrong

    def _stands(self, at: Any, name: str) -> str | None:
        """Whether the robot is where it reaches a thing, or the floor of a room."""
        rooms = self.rooms(name)
        if self.place not in rooms:
            return f"{name} is in {rooms}, the robot in {self.place}"
        while name in self.moved:
            name = self.below[name]
        if name not in self.items:
            return None
        ground = self.items[name].ground
        away = ground.distance(shapely.Point(at.x, at.y))
        near, far = self.ground.body.reach
        if not near - 0.02 <= away <= far + 0.02:
            return f"{name} is {away:.2f} m from ({at.x:.2f}, {at.y:.2f})"
        if not self.ground.fits(self.place, (at.x, at.y)):
            return f"the robot does not fit at ({at.x:.2f}, {at.y:.2f}) in {self.place}"
        return None

    def _drive(self, step: Any) -> str | None:
        """Whether a drive stays in one free part of a room."""
        if step.approach is None or step.from_place != step.to_place:
            return None
        room = step.from_place
        parts = [self.ground.near(room, (p.x, p.y)) for p in (step.approach, step.leave)]
        return None if parts[0] & parts[1] else f"no way leads through {room}"

    def holds(self, goal: Relation) -> bool:
        """Whether a condition is so."""
        relation, a, b = goal
        if relation == "carries":
            return self.held == [b]
        if a == "robot":
            return self.place == b
        if relation == "in":
            return a not in self.held and b in self.rooms(a)
        return self.below.get(a) == b


def can_be_lifted(building: Building, item: Item, robot: str | None = None) -> bool:
    """Whether a robot lifts a thing, by its size and height."""
    floor = max(z for _, z, _ in building.storeys if z <= (item.low + item.high) / 2)
    sides = sorted([*item.size, item.high - item.low])
    middle = (item.low + item.high) / 2 - floor
    held = sides[0] <= HANDS.get(robot, HAND)
    return held and sides[1] <= WIDEST and LIFTED[0] <= middle <= LIFTED[1]


# -- what can be reached


Node = tuple[str, int]


@dataclass(frozen=True)
class Reach:
    """Where a robot gets: free parts of rooms."""

    truth: Truth
    ground: Ground

    def at(self, name: str) -> set[Any]:
        """The nodes at which the robot reaches a thing, or is in a room."""
        if name not in self.truth.items:
            return {(name, k) for k in range(len(self.ground.parts[name]))}
        item = self.truth.items[name]
        return {(r, k) for r in self.truth.rooms(name) for k in self.ground.reaching(item, r)}

    def start(self) -> set[Any]:
        """The nodes at which the robot may begin."""
        place = self.truth.place
        if not self.ground.sure:
            return self.at(place)
        return {(place, k) for k in self.ground.starts(place)}

    def onward(self, nodes: set[Any], name: str) -> set[Any]:
        """The nodes at a thing or room that are reached from some nodes."""
        seen = set(nodes).union(*(nx.descendants(self.ground.graph, n) for n in nodes))
        return seen & self.at(name)

    def reached(self, goal: Sequence[Relation]) -> bool:
        """Whether deliveries in some order, and then the robot's own goal, can be reached."""
        deliveries = [g for g in goal if g[1] != "robot"]
        ends = [g[2] for g in goal if g[1] == "robot"]
        for order in itertools.permutations(deliveries):
            nodes = self.start()
            for name in [*(n for _, a, b in order for n in (a, b)), *ends]:
                nodes = self.onward(nodes, name)
            if nodes:
                return True
        return False


# -- the judge


def goals(building: Building, chance: random.Random) -> Iterator[list[Relation]]:
    """Goals: where things shall be, and the robot."""
    things = [i for i in building.items if i.what == "thing" and i.points is None]
    sure = [i for i in things if len(room_of(building, i)) == 1]
    small = [i for i in sure if i.on is not None and can_be_lifted(building, i)]
    tables = [
        i for i in sure if i.on is None and 0.29 < i.high - i.low < 1.4 and min(i.size) > 0.35
    ]
    tables = [i for i in tables if any(abs(i.low - z) < 1e-9 for _, z, _ in building.storeys)]
    stuck = [i for i in sure if not can_be_lifted(building, i) and i not in tables]
    rooms = [room.name for room in building.rooms if room.elevator is None]
    yield [("in", "robot", chance.choice([r.name for r in building.rooms]))]
    if small:
        thing = chance.choice(small)
        others = [t for t in tables if t.name != thing.on]
        if others:
            table = chance.choice(others)
            yield [("on", thing.name, table.name)]
            yield [("on", thing.name, table.name), ("in", "robot", chance.choice(rooms))]
        yield [("in", thing.name, chance.choice(rooms))]
        yield [("carries", "robot", thing.name)]
        if len(small) > 1 and len(others) > 1:
            two = chance.sample(small, 2)
            onto = [chance.choice([t for t in tables if t.name != i.on]) for i in two]
            yield [("on", i.name, t.name) for i, t in zip(two, onto, strict=True)]
    if stuck and tables:
        yield [("on", chance.choice(stuck).name, chance.choice(tables).name)]


def judge_plans(building: Building, place: semmap.Map) -> tuple[int, list[str]]:
    """Plans are found where an oracle finds a way, and reach their goal; others say why not."""
    chance = random.Random(f"plans of {building.seed}")
    asked, wrong = 0, []
    name = chance.choice(ROBOTS)
    bodies = {None: BODY, name: stored_robot(place, name)}
    for robot, body in bodies.items():
        sure = Ground(building, body, sure=True)
        may = Ground(building, replace(body, reach=ARMS.get(robot, body.reach)), sure=False)
        for goal in goals(building, chance):
            start = chance.choice([room.name for room in building.rooms])
            asked += 1
            wrong += [
                f"{robot or 'a robot'} in {start}, {text(goal)}: {fault}"
                for fault in _judge(building, place, goal, start, robot, body, sure, may)
            ]
    return asked, wrong


def text(goal: Sequence[Relation]) -> str:
    """A goal as people write it."""
    return " and ".join(f"{relation}({a}, {b})" for relation, a, b in goal)


def _judge(
    building: Building,
    place: semmap.Map,
    goal: Sequence[Relation],
    start: str,
    robot: str | None,
    body: Body,
    sure: Ground,
    may: Ground,
) -> Iterator[str]:
    truth = Truth(building, may, start, robot)
    least, most = Reach(truth, sure), Reach(truth, may)
    moved = [b if relation == "carries" else a for relation, a, b in goal]
    lifted = all(
        n == "robot" or can_be_lifted(building, truth.items[n], robot) or truth.holds(g)
        for n, g in zip(moved, goal, strict=True)
    )
    done = all(truth.holds(each) for each in goal)
    try:
        plan = place.plan(text(goal), start=start, robot=robot)
    except ValueError as error:
        if done:
            yield f"it is so already, but refused: {error}"
        elif not lifted:
            if not any(n in str(error) for n in moved):
                yield f"refused without the thing's name: {error}"
        elif robot == "stretch" and f"is out of reach: the arm of {robot} " in str(error):
            return
        elif least.reached(goal) and not _asks_for_floor(goal, truth):
            yield f"refused, but it can be reached: {error}"
        elif f"is out of reach: the arm of {robot} " in str(error):
            return  # so is the place, for another reason
        elif not _names_what_is_in_the_way(str(error), truth, goal, body):
            yield f"refused, not for what is in the way: {error}"
        return
    if not lifted:
        yield f"{moved} cannot be lifted, but: {[*map(str, plan.actions)]}"
        return
    if not (done or most.reached(goal)):
        yield f"it cannot be reached, but: {[*map(str, plan.actions)]}"
        return
    for action in plan.actions:
        fault = truth.follow(action)
        if fault:
            yield f"{action}: {fault}; {[*map(str, plan.actions)]}"
            return
    if not all(truth.holds(each) for each in goal):
        yield f"the goal does not hold after {[*map(str, plan.actions)]}"


def _asks_for_floor(goal: Sequence[Relation], truth: Truth) -> bool:
    """Whether a goal needs a free place on a floor, which no oracle promises."""
    return any(g[0] == "in" and g[1] in truth.items for g in goal)


def _names_what_is_in_the_way(why: str, truth: Truth, goal: Sequence[Relation], body: Body) -> bool:
    """Whether a way leads farther if all doors and things that a reason names were no hindrance.

    Where things stand in the way of a robot, a shut door on another way may be named.
    """
    building = truth.building
    words = set(re.findall(r"[^\s:;,()]+", why))
    named = {door.name for door in building.doors if door.name in words}
    joined = doors_of(building, body, {d.name for d in building.doors})
    after = doors_of(building, body, named)
    legs = []
    places = [truth.place]
    for _, a, b in goal:
        for name in (a, b):
            rooms = truth.rooms(name) if name in truth.items else {name} - {"robot"}
            legs += [(p, r) for p in places for r in rooms]
            places += [r for r in rooms if r not in places]
    if "nothing joins them" in why or "has no door" in why:
        return any(not nx.has_path(joined, *leg) for leg in legs)
    if named and any(nx.has_path(after, *leg) for leg in legs):
        return True
    spatial = (
        " finds no path in ", " reaches none of its doors", " finds no free place within ",
        " cannot face ", " finds no free floor in ", " fits nowhere ", " no grasp fits ",
    )  # fmt: skip
    names = {*truth.items, *truth.storeys}
    return any(s in why for s in spatial) and bool(words & names)


def stored_robot(place: semmap.Map, name: str) -> Body:
    """Store a robot, and say what shape it has."""
    if name not in place.robots:
        if name == "delivery":
            urdf = OFFICE / "delivery_robot.urdf"
            parts: Path | None = OFFICE / "delivery_robot_parts.yaml"
        else:
            urdf, parts = real_robot(name), None
        place.database.add_robot(name, urdf, parts=parts)
    parts_of = place.robots[name].parts
    base = parts_of[0]
    return Body(
        base.inscribed_radius,
        max(part.circumscribed_radius for part in parts_of),
        max(float(p.footprint[:, 1].max() - p.footprint[:, 1].min()) for p in parts_of),
        (max(base.interval[0], 0.02), base.interval[1]),
        max(part.interval[1] for part in parts_of),
    )
