"""Classes of robots, and how long they take."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np
from psycopg.rows import namedtuple_row
from sqlalchemy import Connection, text

from navgrid.terrain import DriveLimits
from planner.robot_class import RobotClass
from planner.source.rows import ask
from planner.times import Times
from semmap.robot import Part

__all__ = [
    "Kept",
    "class_state",
    "delete_robot_class",
    "keep_robot_class",
    "read_robot_class",
    "read_robot_names",
]

_PLAIN = ("speed", "opens", "unlocks", "outside", "capacity")
_TIMES = {
    "call": "call_seconds", "ride": "ride_seconds", "ride_per_metre": "ride_seconds_per_metre",
    "open": "open_seconds", "unlock": "unlock_seconds", "pickup": "pickup_seconds",
    "place": "place_seconds",
}  # fmt: skip


def keep_robot_class(connection: Connection, robot: RobotClass, times: Times | None = None) -> int:
    """Keep a class of robots under its name, in place of a former one; its id.

    Walks that were measured for a robot of another shape, gait or speed are forgotten.
    """
    times = times or Times()
    shaped = bool(robot.parts)
    row: dict[str, Any] = {
        "name": robot.name,
        "parts": json.dumps([_as_json(part) for part in robot.parts]),
        "width": max(float(np.ptp(p.footprint[:, 1])) for p in robot.parts) if shaped else None,
        "height": max(p.interval[1] for p in robot.parts) if shaped else None,
        "max_step": robot.gait.max_step,
        "max_slope": robot.gait.max_slope,
        "behaviours": None if robot.behaviours is None else sorted(robot.behaviours),
        "permissions": sorted(robot.permissions),
        "reach": list(robot.reach),
        "heights": list(robot.heights),
        **{name: getattr(robot, name) for name in _PLAIN},
        **{column: getattr(times, name) for name, column in _TIMES.items()},
    }
    known = connection.execute(
        text("SELECT id, parts = CAST(:parts AS jsonb) AND max_step = :max_step "
             "AND max_slope = :max_slope AND speed = :speed AS same FROM robot_class "
             "WHERE name = :name"), row
    ).one_or_none()  # fmt: skip
    columns = list(row)
    values = ", ".join("CAST(:parts AS jsonb)" if c == "parts" else f":{c}" for c in columns)
    updates = ", ".join(f"{c} = EXCLUDED.{c}" for c in columns if c != "name")
    number = connection.execute(
        text(
            f"INSERT INTO robot_class ({', '.join(columns)}) VALUES ({values}) "
            f"ON CONFLICT (name) DO UPDATE SET {updates} RETURNING id"
        ),
        row,
    ).scalar_one()
    if known is not None and not known.same:
        for table in ("walk", "walked_place", "walked_map"):
            connection.execute(
                text(f"DELETE FROM {table} WHERE robot_class_id = :id"), {"id": number}
            )
    return int(number)


def delete_robot_class(connection: Connection, name: str) -> None:
    """Forget a class of robots and its walks.

    Raises
    ------
    LookupError
    """
    read_robot_class(connection, name)
    connection.execute(text("DELETE FROM robot_class WHERE name = :name"), {"name": name})


def read_robot_names(connection: Connection) -> list[str]:
    """The names of the classes of robots."""
    return [*connection.execute(text("SELECT name FROM robot_class ORDER BY name")).scalars()]


class Kept(NamedTuple):
    """A class of robots as the database keeps it.

    Attributes
    ----------
    id : in the database
    robot, times : what it can do, and how long that takes; learned times in the current map, too
    state : a digest of all that the database has of the class itself
    unwalked : the entities of the current map that changed since all of its walks were measured;
        None where they never were, or before the history begins
    """

    id: int
    robot: RobotClass
    times: Times
    state: str
    unwalked: frozenset[int] | None


_CLASS = """
SELECT r.*, md5(r::text) AS state,
       CASE WHEN reaches_back(w.cursor)
            THEN ARRAY(SELECT unnest(s.entities) FROM changes_since(w.cursor) s
                       WHERE s.map_id = w.map_id) END AS unwalked,
       (SELECT jsonb_agg(jsonb_build_array(l.behaviour, e.name, l.seconds))
        FROM learned l JOIN entity e ON e.id = l.entity_id
        WHERE l.robot_class_id = r.id AND e.map_id = current_map()) AS learned
FROM robot_class r
LEFT JOIN walked_map w ON w.robot_class_id = r.id AND w.map_id = (SELECT current_map())
WHERE r.name = %s
"""


def read_robot_class(connection: Connection, name: str) -> Kept:
    """A class of robots by name.

    Raises
    ------
    LookupError
        There is none of that name; the message names those that there are.
    """
    found = ask(connection, _CLASS, (name,), namedtuple_row)
    if not found:
        known = ", ".join(read_robot_names(connection))
        raise LookupError(
            f"there is no class of robots named {name}; "
            + (f"there are: {known}" if known else "semmap robot add makes one from a URDF")
        )
    (row,) = found
    robot = RobotClass(
        row.name,
        tuple(_part(said) for said in row.parts),
        DriveLimits(row.max_step, row.max_slope),
        behaviours=None if row.behaviours is None else frozenset(row.behaviours),
        permissions=frozenset(row.permissions or ()),
        reach=(row.reach[0], row.reach[1]),
        heights=(row.heights[0], row.heights[1]),
        **{name: getattr(row, name) for name in _PLAIN},
    )
    times = Times(
        **{name: getattr(row, column) for name, column in _TIMES.items()},
        learned={(behaviour, of): float(seconds) for behaviour, of, seconds in row.learned or ()},
    )
    unwalked = None if row.unwalked is None else frozenset(row.unwalked)
    return Kept(row.id, robot, times, row.state, unwalked)


def _as_json(part: Part) -> dict[str, Any]:
    return {
        "name": part.name,
        "links": list(part.links),
        "interval": list(part.interval),
        "footprint": part.footprint.tolist(),
        "inscribed_radius": part.inscribed_radius,
        "circumscribed_radius": part.circumscribed_radius,
        "inflate_by": part.inflate_by,
    }


def _part(said: dict[str, Any]) -> Part:
    return Part(
        said["name"], tuple(said["links"]), (said["interval"][0], said["interval"][1]),
        np.array(said["footprint"]), said["inscribed_radius"], said["circumscribed_radius"],
        said["inflate_by"],
    )  # fmt: skip


def class_state(connection: Connection, robot_class: int) -> str | None:
    """A digest of all that the database has of a class of robots itself; None if it is gone."""
    said = connection.execute(
        text("SELECT md5(r::text) FROM robot_class r WHERE id = :id"), {"id": robot_class}
    ).scalar()
    return None if said is None else str(said)
