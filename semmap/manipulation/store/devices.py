"""Robots, grippers and sensors, how they are mounted, and paths that they took."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from psycopg.types.json import Jsonb

from semmap.belief.store.beliefs import Session
from semmap.manipulation.action_record import pose_of
from semmap.manipulation.error import ManipulationError
from semmap.manipulation.store.database_answers import column, number, refusals
from semmap.suggestions import suggestion

CAPABILITIES = {
    "gripper": ("gripping", "pushing"),
    "robot": ("reaching",),
    "sensor": ("sensing",),
}
"""The capabilities of components, where nothing else is stated."""

ABLE = ("gripping", "pushing", "reaching", "sensing", "seeing", "ranging", "orienting", "feeling")
"""All capabilities of the ontology."""


def add_device(
    session: Session,
    name: str,
    kind: str,
    *,
    urdf: str | None = None,
    source: Path | str | None = None,
    joints: Mapping[str, tuple[float, float]] | None = None,
    capabilities: Sequence[str] | None = None,
) -> int:
    """Store a robot, gripper or sensor, or update the one of this name; return its id.

    `source` is the file of the URDF, `joints` are limits by name, radians or metres.
    """
    if kind not in CAPABILITIES:
        raise ManipulationError(f"{name}: {kind} is not one of {', '.join(CAPABILITIES)}")
    limits = {joint: list(pair) for joint, pair in (joints or {}).items()}
    able = list(CAPABILITIES[kind] if capabilities is None else capabilities)
    with refusals(), session.transaction():
        row = session.execute("SELECT kind FROM device WHERE name = %s", (name,)).fetchone()
        if row is not None and row[0] != kind:
            raise ManipulationError(f"{name}: there is a {row[0]} of this name: choose another one")
        return number(
            session.execute(
                "INSERT INTO device (name, kind, urdf, source, joints, capabilities) "
                "VALUES (%s, %s, %s, %s, %s, %s) ON CONFLICT (name) DO UPDATE SET "
                "urdf = excluded.urdf, source = excluded.source, joints = excluded.joints, "
                "capabilities = excluded.capabilities RETURNING id",
                (name, kind, urdf, None if source is None else str(source), Jsonb(limits), able),
            )
        )


def add_gripper(
    session: Session,
    name: str,
    *,
    form: str,
    opening: float,
    depth: float,
    swept: float | None = None,
    force: float | None = None,
    urdf: str | None = None,
    source: Path | str | None = None,
    joints: Mapping[str, tuple[float, float]] | None = None,
    preferred: bool | None = None,
) -> int:
    """Store a gripper, or update the one of this name; return its id.

    `opening` is the widest object that it closes on, `depth` how deep its fingers are, metres, and
    `swept` the volume that they pass, m³. Of a suction cup, they are the diameter of its lip and
    its length, and `force` is that of its vacuum, newtons. The `preferred` one is meant where a
    query names none; by default, if none is yet. ManipulationError for bad numbers, and where
    actions are stored of a cup of this name that has another radius or force.
    """
    if not (math.isfinite(opening) and opening > 0):
        raise ManipulationError(f"gripper {name}: its opening is {opening}: give metres above 0")
    if not (math.isfinite(depth) and depth >= 0):
        raise ManipulationError(f"gripper {name}: its depth is {depth}: give metres, at least 0")
    if swept is not None and not (math.isfinite(swept) and swept > 0):
        raise ManipulationError(f"gripper {name}: its fingers pass {swept}: give m³ above 0")
    if force is not None and not (math.isfinite(force) and force > 0):
        raise ManipulationError(f"gripper {name}: its force is {force}: give newtons above 0")
    if force is not None and form != "suction":
        raise ManipulationError(
            f"gripper {name}: only suction cups have a force: leave it out, or state form=suction"
        )
    with refusals(), session.transaction():
        _refuse_another_lip(session, name, form, opening, force)
        id_ = add_device(session, name, "gripper", urdf=urdf, source=source, joints=joints)
        if preferred is None:
            found = session.execute("SELECT FROM gripper WHERE preferred").fetchone()
            preferred = found is None
        if preferred:
            session.execute("UPDATE gripper SET preferred = false WHERE preferred")
        session.execute(
            "INSERT INTO gripper (device_id, form, opening, depth, swept, force, preferred) "
            "VALUES (%s, %s, %s, %s, %s, %s, %s) ON CONFLICT (device_id) DO UPDATE SET "
            "form = excluded.form, opening = excluded.opening, depth = excluded.depth, "
            "swept = excluded.swept, force = excluded.force, "
            "preferred = excluded.preferred OR gripper.preferred",
            (id_, form, opening, depth, swept, force, preferred),
        )
    return id_


def _refuse_another_lip(
    session: Session, name: str, form: str, opening: float, force: float | None
) -> None:
    """Refuse another cup by the name of one whose actions are stored: they were for its lip."""
    row = session.execute(
        "SELECT g.form, g.opening, g.force, "
        "(SELECT count(*) FROM action a WHERE a.gripper_id = g.device_id) "
        "FROM gripper g JOIN device d ON d.id = g.device_id WHERE d.name = %s",
        (name,),
    ).fetchone()
    if row is None or row[3] == 0 or "suction" not in (row[0], form):
        return
    if not is_same_gripper(row[:3], (form, opening, force)):
        raise ManipulationError(
            f"gripper {name}: {row[3]} actions are stored of it as it is now, "
            f"{gripper_words(*row[:3])}: give {gripper_words(form, opening, force)} another name"
        )


def is_same_gripper(
    one: tuple[str, float, float | None], other: tuple[str, float, float | None]
) -> bool:
    """Whether grippers by form, opening (metres) and force (newtons) are equal, but for rounding.

    >>> is_same_gripper(("suction", 0.03, 60), ("suction", 0.03, 30))
    False
    """
    near = 1e-4 if one[0] == "suction" else 1e-3
    if one[0] != other[0] or abs(one[1] - other[1]) > near:
        return False
    return math.isclose(one[2] or 0.0, other[2] or 0.0, rel_tol=1e-3)


def gripper_words(form: str, opening: float, force: float | None = None) -> str:
    """A gripper in words.

    >>> gripper_words("suction", 0.03, 60), gripper_words("parallel", 0.09)
    ('a suction cup of 0.03 m and 60 N', 'a parallel gripper that opens 0.09 m')
    """
    if form == "suction":
        return f"a suction cup of {opening:g} m" + ("" if force is None else f" and {force:g} N")
    return f"a {form} gripper that opens {opening:g} m"


def add_automaton(
    session: Session,
    name: str,
    robot: str,
    gripper: str | None = None,
    sensor: str | None = None,
    posture: Mapping[str, float] | None = None,
) -> int:
    """Store a robot with a gripper, a sensor and its driving posture; return its id."""
    ids: list[int | None] = []
    for kind, device in (("robot", robot), ("gripper", gripper), ("sensor", sensor)):
        row = session.execute(
            "SELECT id FROM device WHERE kind = %s AND name = %s", (kind, device)
        ).fetchone()
        if device is not None and row is None:
            known = column(session, "SELECT name FROM device WHERE kind = %s", (kind,))
            raise LookupError(f"there is no {kind} {device}{suggestion(device, known)}")
        ids.append(None if row is None else row[0])
    with refusals():
        return number(
            session.execute(
                "INSERT INTO automaton (name, robot_id, gripper_id, sensor_id, posture) "
                "VALUES (%s, %s, %s, %s, %s) ON CONFLICT (name) DO UPDATE SET "
                "robot_id = excluded.robot_id, gripper_id = excluded.gripper_id, "
                "sensor_id = excluded.sensor_id, posture = excluded.posture RETURNING id",
                (name, *ids, Jsonb(dict(posture or {}))),
            )
        )


def gripper_id(session: Session, name: str | None = None) -> int:
    """The id of a gripper, by default of the preferred or the only one; LookupError for none."""
    if name is not None:
        known = column(
            session, "SELECT d.name FROM device d JOIN gripper g ON g.device_id = d.id ORDER BY 1"
        )
        if name not in known:
            stored = f"stored are {', '.join(known)}; " if known else ""
            hint = suggestion(name, known, f"{stored}semmap manipulation add-gripper URDF adds one")
            raise LookupError(f"there is no gripper {name}{hint}")
    with refusals():
        return number(session.execute("SELECT gripper_named(%s)", (name,)))


def add_path(
    session: Session,
    automaton: str,
    poses: Sequence[Any],
    *,
    link: str = "",
    positions: Mapping[str, Sequence[float]] | None = None,
) -> int:
    """Store the poses that led a robot, or a link of it, through the map; return the path's id.

    The poses are at least two, (4, 4) or seven numbers, map's frame; `link` is empty for the base;
    `positions` are those of an arm's joints by name at each pose, radians or metres. LookupError
    without the automaton, ManipulationError where a pose is none or there are fewer than two.
    """
    rows = [pose_of(pose, f"pose {n} of the path").row for n, pose in enumerate(poses, 1)]
    if len(rows) < 2:
        raise ManipulationError(f"a path has at least two poses, not {len(rows)}")
    joints = at_poses = None
    if positions is not None:
        joints = list(positions)
        at_poses = [[float(v) for v in at] for at in zip(*positions.values(), strict=True)]
    row = session.execute("SELECT id FROM automaton WHERE name = %s", (automaton,)).fetchone()
    if row is None:
        known = column(session, "SELECT name FROM automaton")
        raise LookupError(f"there is no automaton {automaton}{suggestion(automaton, known)}")
    with refusals():
        return number(
            session.execute(
                "INSERT INTO path (map_id, automaton_id, link, poses, joints, positions) "
                "VALUES (current_map(), %s, %s, %s, %s, %s) RETURNING id",
                (row[0], link, rows, joints, at_poses),
            )
        )
