"""Small random houses with tables and cups, for properties."""

from __future__ import annotations

import math
from typing import NamedTuple

from hypothesis import strategies as st

from planner.robot_class import RobotClass
from planner.tasks.world import TaskObject, TaskState, TaskWorld
from planner.topology import Place, PlaceConnector, Topology
from semmap.geometry.pose import Pose


class House(NamedTuple):
    topology: Topology
    robot: RobotClass
    world: TaskWorld
    state: TaskState
    goal: str
    limits: dict[str, int]


@st.composite
def houses(draw, most_things: int = 3) -> House:
    """Up to 6 rooms on two storeys, up to 3 cups on tables, each goal one table a cup."""
    rooms = draw(st.integers(2, 6))
    upstairs = draw(st.integers(0, 2)) if rooms > 3 else 0
    places, connectors = [], []
    centres = {}
    for i in range(rooms):
        up = i >= rooms - upstairs
        z = 3.0 if up else 0.0
        centres[i] = Pose(6.0 * (i % 3), 6.0 * (i // 3), z)
        places.append(
            Place(
                f"room{i}",
                "kitchen" if i % 2 else "office",
                storey="second" if up else "first",
                floor=z,
            )
        )

    def door(name: str, a: str, b: str, pa: Pose, pb: Pose, **more) -> None:
        connectors.append(PlaceConnector(name, (a, b), (pa, pb), **more))

    down = list(range(rooms - upstairs))
    up = list(range(rooms - upstairs, rooms))
    for level in (down, up):
        for j, i in enumerate(level[1:], 1):
            to = level[draw(st.integers(0, j - 1))]
            a, b = centres[to], centres[i]
            mid = ((a.x + b.x) / 2 + draw(st.integers(-2, 2)) / 2, (a.y + b.y) / 2)
            turn = math.atan2(b.y - a.y, b.x - a.x)
            frame = Pose.planar(*mid, turn, a.z)
            state = draw(st.sampled_from(["open", "open", "closed", "locked"]))
            way = draw(st.sampled_from(["both", "both", "both", "forward", "backward"]))
            door(
                f"door{i}",
                f"room{to}",
                f"room{i}",
                frame @ Pose.planar(-0.5, 0.0),
                frame @ Pose.planar(0.5, 0.0, math.pi),
                state=state,
                direction=way,
            )
    if up:
        for level, name, z in ((down, "cabin1", 0.0), (up, "cabin2", 3.0)):
            places.append(
                Place(name, storey="first" if z == 0 else "second", elevator="lift", floor=z)
            )
            frame = Pose.planar(-3.0, 0.0, math.pi, z)
            door(
                f"e{name}",
                f"room{level[0]}",
                name,
                frame @ Pose.planar(-0.5, 0.0),
                frame @ Pose.planar(0.5, 0.0, math.pi),
                type="elevator_door",
                state="closed",
                behaviour="call_elevator",
            )
    near = st.integers(-4, 4).map(lambda k: k / 2)
    tables = []
    for k in range(draw(st.integers(2, 3))):
        i = draw(st.integers(0, rooms - 1))
        centre = centres[i]
        tables.append(
            TaskObject(
                f"table{k}",
                ("table", "furniture"),
                None,
                f"room{i}",
                f"room{i}",
                Pose(centre.x + draw(near), centre.y + draw(near), centre.z + 0.4),
                height=0.4,
                size=(1, 1, 0.8),
            )
        )
    cups: list[TaskObject] = []
    for k in range(draw(st.integers(1, most_things))):
        free = [c for c in cups if not any(o.holder == c.name for o in cups)]
        if free and draw(st.integers(0, 3)) == 0:
            under = draw(st.sampled_from(free))
        else:
            under = draw(st.sampled_from(tables))
        p = under.pose
        cups.append(
            TaskObject(
                f"cup{k}",
                ("cup",),
                None,
                under.name,
                under.place,
                Pose(p.x + draw(near) / 4, p.y, p.z + 0.4),
                height=p.z + 0.4 - (3.0 if p.z > 3 else 0),
                size=(0.1, 0.1, 0.1),
            )
        )
    wanted = draw(st.lists(st.sampled_from(cups), min_size=1, max_size=len(cups), unique=True))
    atoms = [f"on({c.name}, {draw(st.sampled_from(tables)).name})" for c in wanted]
    if draw(st.integers(0, 3)) == 0:
        atoms.append(f"in(robot, room{draw(st.integers(0, rooms - 1))})")
    limits = {}
    for c in cups:
        below = {c.holder}
        while any(o.name in below and o.holder not in below for o in cups):
            below |= {o.holder for o in cups if o.name in below}
        goal = any(a.startswith(f"on({c.name},") for a in atoms)
        limits[c.name] = int(goal) + int(bool(below & ({w.name for w in wanted})))
    capacity = draw(st.integers(1, 2))
    start = draw(st.integers(0, rooms - 1))
    centre = centres[start]
    return House(
        Topology.of(places, connectors),
        RobotClass(capacity=capacity),
        TaskWorld([*tables, *cups]),
        TaskState(f"room{start}", Pose(centre.x + 0.25, centre.y, centre.z)),
        " and ".join(atoms),
        limits,
    )
