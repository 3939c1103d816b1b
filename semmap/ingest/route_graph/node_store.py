"""The nodes of a route graph in the map: on their storeys, in their rooms, at their connectors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import psycopg

from semmap.ingest.world import World, WorldError

STANDS_BEFORE = "stands_before"
"""The relation of a node to the connector that a robot passes from there."""

AT_STAND = 0.25
"""Metres from a connector's pose within which a node is at it."""

BELOW, ABOVE = 0.5, 0.5
"""How far under its floor and over its ceiling a room holds a node, metres."""


def check_names(
    connection: psycopg.Connection[Any], map_id: int, world: World, source: str
) -> None:
    """Refuse a graph whose nodes would be taken for those of another file with its name."""
    numbered = [e.name for e in world.entries if e.name.startswith(f"{world.name}-node")]
    row = connection.execute(
        "SELECT name, source FROM entity WHERE map_id = %s AND name = ANY(%s) "
        "AND source IS DISTINCT FROM %s ORDER BY id LIMIT 1",
        (map_id, numbered, source),
    ).fetchone()
    if row is not None:
        name, other = row
        fix = f"Rename this file, or import it with source={other} to replace that graph."
        raise WorldError(world.source, name, f"is in the map already, from {other}", fix)


def settle_nodes(
    connection: psycopg.Connection[Any], map_id: int, world: World, source: str
) -> None:
    """Put the nodes of a graph on their storeys and into their rooms; join them with connectors.

    A node that names a storey, or whose frame does, is at that storey's elevation; any other is on
    the only storey, or at its third coordinate. A WorldError refuses one that names a storey that
    the map does not have, or none where it has several.
    """
    nodes = connection.execute(
        "SELECT e.id, e.name, e.properties, w.pose FROM entity e "
        "JOIN world w ON w.entity_id = e.id JOIN placement p ON p.entity_id = e.id "
        "WHERE e.map_id = %s AND e.source = %s "
        "AND e.type = 'waypoint' AND p.holder_id IS NULL ORDER BY e.id",
        (map_id, source),
    ).fetchall()
    storeys: dict[str, tuple[int, float]] = {
        name: (number, elevation)
        for name, number, elevation in connection.execute(
            "SELECT e.name, e.id, s.elevation FROM entity e JOIN storey s ON s.entity_id = e.id "
            "WHERE e.map_id = %s ORDER BY s.elevation, e.id",
            (map_id,),
        )
    }
    for node, name, properties, pose in nodes:
        storey = _storey(world, name, properties, storeys)
        z = pose[2]
        if storey is not None and not properties.get("z_said"):
            z = storeys[storey][1]
            connection.execute("SELECT move_to(%s, %s, %s, %s)", (node, pose[0], pose[1], z))
        holder = _room_at(connection, map_id, pose[0], pose[1], z)
        if holder is None and storey is not None:
            holder = storeys[storey][0]
        if holder is not None:
            connection.execute("SELECT put(%s, %s)", (node, holder))
    _join_connectors(connection, map_id, source)


def _storey(
    world: World, name: str, properties: Mapping[str, Any], storeys: Mapping[str, Any]
) -> str | None:
    if not storeys:
        return None
    given = properties.get("storey")
    if given is None:
        frame = properties["frame"]
        given = next((s for s in storeys if frame in (s, "map_" + re.sub(r"\W+", "_", s))), None)
    if given is None and len(storeys) == 1:
        return next(iter(storeys))
    if given is None and properties.get("z_said"):
        return None
    if given not in storeys:
        problem = f"is on storey {given}" if given is not None else "names no storey"
        raise WorldError(
            world.source,
            name,
            f"{problem}, and the map has {', '.join(storeys)}",
            'Add "storey": "NAME" to its metadata, or beside "features" for all nodes.',
        )
    return str(given)


def _room_at(
    connection: psycopg.Connection[Any], map_id: int, x: float, y: float, z: float
) -> int | None:
    """Return the room around a point; of several the smallest."""
    row = connection.execute(
        "SELECT e.id FROM entity e JOIN room r ON r.entity_id = e.id "
        "JOIN world w ON w.entity_id = e.id WHERE e.map_id = %s "
        "AND ST_Covers(w.footprint, ST_Point(%s, %s)) "
        "AND %s BETWEEN ST_ZMin(w.box) - %s AND ST_ZMax(w.box) + %s "
        "ORDER BY abs(ST_ZMin(w.box) - %s) > %s, ST_Area(w.footprint), e.id LIMIT 1",
        (map_id, x, y, z, BELOW, ABOVE, z, BELOW),
    ).fetchone()
    return None if row is None else int(row[0])


def _join_connectors(connection: psycopg.Connection[Any], map_id: int, source: str) -> None:
    """Link nodes to the connectors at whose approach poses they lie, in the place on that side."""
    values = {"map": map_id, "source": source, "near": AT_STAND, "relation": STANDS_BEFORE}
    connection.execute(
        "DELETE FROM link l USING entity e WHERE e.id = l.from_id AND e.map_id = %(map)s "
        "AND e.source = %(source)s AND l.relation = %(relation)s",
        values,
    )
    connection.execute(
        "INSERT INTO link (from_id, relation, to_id, properties) "
        "SELECT e.id, %(relation)s, c.entity_id, jsonb_build_object('side', s.side) "
        "FROM entity e JOIN world w ON w.entity_id = e.id "
        "JOIN placement p ON p.entity_id = e.id, connector c "
        "JOIN entity ce ON ce.id = c.entity_id JOIN world cw ON cw.entity_id = c.entity_id, "
        "LATERAL (VALUES (0, pose_compose(cw.pose, c.pose_a), c.place_a), "
        "(1, pose_compose(cw.pose, c.pose_b), c.place_b)) s (side, pose, place) "
        "WHERE e.map_id = %(map)s AND e.source = %(source)s AND e.type = 'waypoint' "
        "AND ce.map_id = %(map)s AND p.holder_id = s.place "
        "AND ST_DWithin(ST_Point(w.pose[1], w.pose[2]), ST_Point(s.pose[1], s.pose[2]), %(near)s) "
        "AND abs(w.pose[3] - s.pose[3]) <= 1.0",
        values,
    )
