"""Reads and stores classes of robots, with how long their behaviours take."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from psycopg.rows import namedtuple_row
from sqlalchemy import Connection, text

from navgrid.terrain import DriveLimits
from planner.readers.rows import fetch_rows
from planner.robot_class import Durations, RobotClass
from semmap.query.snapshot import Snapshot
from semmap.robot import Part
from semmap.suggestions import suggestion

_SAME_NAME = ("speed", "opens", "unlocks", "outside", "capacity")
"""Attributes of `RobotClass` whose columns have the same name."""

_DURATIONS = {
    "call": "call_seconds",
    "ride": "ride_seconds",
    "ride_per_metre": "ride_seconds_per_metre",
    "open": "open_seconds",
    "unlock": "unlock_seconds",
    "pickup": "pickup_seconds",
    "place": "place_seconds",
}
"""Attributes of `Durations`, and their columns."""

_SAME_TRAVEL = """
SELECT id, parts = CAST(:parts AS jsonb) AND max_step = :max_step AND max_slope = :max_slope
       AND speed = :speed AS same
FROM robot_class WHERE name = :name
"""

_READ = """
SELECT r.*, md5(r::text) AS digest,
       CASE WHEN reaches_back(t.cursor)
            THEN ARRAY(SELECT unnest(s.entities) FROM changes_since(t.cursor) s
                       WHERE s.map_id = t.map_id) END AS unmeasured,
       CASE WHEN reaches_back(t.cursor)
            THEN EXISTS (SELECT FROM changes_since(t.cursor) s
                         WHERE s.map_id = t.map_id AND s.what = 'field') END AS fields_changed,
       (SELECT jsonb_agg(jsonb_build_array(d.behaviour, e.name, d.seconds))
        FROM mean_duration d JOIN entity e ON e.id = d.entity_id
        WHERE d.robot_class_id = r.id AND e.map_id = current_map()) AS measured
FROM robot_class r
LEFT JOIN travel_time_map t ON t.robot_class_id = r.id AND t.map_id = (SELECT current_map())
WHERE r.name = %s
"""


class StoredRobotClass(NamedTuple):
    """A class of robots as the database has it, with the means measured in the current map.

    The digest changes whenever the class is stored with other values. `unmeasured` are the ids of
    the entities of the map that changed after all travel times of the class were measured; None if
    they never were, or if the changes since then are not all kept. `fields_changed`: fields were
    stored or deleted since then.
    """

    id: int
    robot: RobotClass
    durations: Durations
    digest: str
    unmeasured: frozenset[int] | None
    fields_changed: bool


def store_robot_class(
    connection: Connection,
    robot: RobotClass,
    durations: Durations | None = None,
    *,
    urdf: Path | None = None,
) -> int:
    """Store a class of robots, or replace the one of its name; returns its id.

    `urdf` is the file that it was made from, to make costmaps of it in another posture. Travel
    times that were measured for another shape, other limits or another speed are deleted.
    """
    durations = durations or Durations()
    row: dict[str, Any] = {
        "name": robot.name,
        "urdf": None if urdf is None else str(urdf.absolute()),
        "parts": json.dumps([vars(p) | {"footprint": p.footprint.tolist()} for p in robot.parts]),
        "width": max((float(np.ptp(p.footprint[:, 1])) for p in robot.parts), default=None),
        "height": max((p.interval[1] for p in robot.parts), default=None),
        "max_step": robot.drive_limits.max_step,
        "max_slope": robot.drive_limits.max_slope,
        "behaviours": None if robot.behaviours is None else sorted(robot.behaviours),
        "permissions": sorted(robot.permissions),
        "reach": [*map(float, robot.reach)],
        "heights": [*map(float, robot.heights)],
        **{name: getattr(robot, name) for name in _SAME_NAME},
        **{column: getattr(durations, name) for name, column in _DURATIONS.items()},
    }
    before = connection.execute(text(_SAME_TRAVEL), row).one_or_none()
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
    if before is not None and not before.same:
        for table in ("travel_time", "travel_time_place", "travel_time_map"):
            connection.execute(
                text(f"DELETE FROM {table} WHERE robot_class_id = :id"), {"id": number}
            )
    return int(number)


def delete_robot_class(connection: Connection, name: str) -> None:
    """Delete a class of robots and its travel times; LookupError without one of this name."""
    found = connection.execute(text("DELETE FROM robot_class WHERE name = :name"), {"name": name})
    if not found.rowcount:
        raise _no_class(connection, name)


def read_robot_class_names(seen: Snapshot) -> list[str]:
    """The names of all classes of robots, in alphabetical order."""
    return _names(seen.connection)


def read_robot_class(seen: Snapshot, name: str) -> StoredRobotClass:
    """The class of robots of this name; a LookupError has the names of all."""
    found = fetch_rows(seen, _READ, (name,), namedtuple_row)
    if not found:
        raise _no_class(seen.connection, name)
    (row,) = found
    robot = RobotClass(
        row.name,
        tuple(_part(part) for part in row.parts),
        DriveLimits(row.max_step, row.max_slope),
        behaviours=None if row.behaviours is None else frozenset(row.behaviours),
        permissions=frozenset(row.permissions or ()),
        reach=(row.reach[0], row.reach[1]),
        heights=(row.heights[0], row.heights[1]),
        **{name: getattr(row, name) for name in _SAME_NAME},
    )
    durations = Durations(
        **{name: getattr(row, column) for name, column in _DURATIONS.items()},
        measured={(behaviour, of): float(mean) for behaviour, of, mean in row.measured or ()},
    )
    unmeasured = None if row.unmeasured is None else frozenset(row.unmeasured)
    return StoredRobotClass(
        row.id, robot, durations, row.digest, unmeasured, bool(row.fields_changed)
    )


def _names(connection: Connection) -> list[str]:
    return [*connection.execute(text("SELECT name FROM robot_class ORDER BY name")).scalars()]


def _no_class(connection: Connection, name: str) -> LookupError:
    names = _names(connection)
    known = f"there are: {', '.join(names)}" if names else "semmap robot add makes one from a URDF"
    return LookupError(f"there is no robot class named {name}{suggestion(name, names, known)}")


def read_agent_class(seen: Snapshot, agent: str | None = None) -> str | None:
    """The stored class of an agent, by default of the only one; None where it is not known."""
    found = seen.connection.execute(text(_AGENT_CLASSES), {"name": agent}).scalars().all()
    return found[0] if len(found) == 1 else None


_AGENT_CLASSES = """
SELECT r.name FROM entity e LEFT JOIN robot_class r ON r.name = e.properties->>'robot_class'
WHERE e.map_id = current_map() AND e.kind = 'agent' AND e.name = coalesce(:name, e.name)
"""


def read_robot_urdf(seen: Snapshot, name: str) -> Path:
    """The URDF that a class of robots was made from.

    Raises LookupError: there is no such class, or its file is not known or is gone.
    """
    read_robot_class(seen, name)
    found = seen.session.execute("SELECT urdf FROM robot_class WHERE name = %s", (name,)).fetchone()
    urdf = found and found[0]
    if urdf is None or not Path(urdf).is_file():
        where = "was stored without its URDF" if urdf is None else f"was made from {urdf}, now gone"
        raise LookupError(f"the robot class {name} {where}: give the URDF in place of the name")
    return Path(urdf)


def read_robot_class_digest(seen: Snapshot, robot_class: int) -> str | None:
    """The present digest of a class of robots by its id; None if it was deleted."""
    digest = seen.connection.execute(
        text("SELECT md5(r::text) FROM robot_class r WHERE id = :id"), {"id": robot_class}
    ).scalar()
    return None if digest is None else str(digest)


def _part(value: dict[str, Any]) -> Part:
    low, high = value["interval"]
    arrays = {"links": tuple(value["links"]), "footprint": np.array(value["footprint"])}
    return Part(**value | arrays | {"interval": (low, high)})
