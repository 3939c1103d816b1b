"""Route graphs that people drew for Nav2's route server (GeoJSON): regions and links.

Each node is a region of type waypoint, held by the room that it lies in; each edge is a link
`nav2_edge` from node to node with its cost and what else the file says. A node at which a robot
stands before a connector has a link `stands_before` to that connector.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import psycopg
from psycopg.types.json import Jsonb

from semmap.geometry.pose import Pose
from semmap.ingest.annotation_file import Refused, checked_property, parse_json
from semmap.ingest.naming import unique_name
from semmap.ingest.world import Entry, Link, Skipped, World, WorldError
from semmap.limits import EXTENT, TEXT_BYTES

__all__ = [
    "EDGE",
    "STANDS_BEFORE",
    "check_names",
    "is_route_graph",
    "read_route_graph",
    "settle_nodes",
]

EDGE = "nav2_edge"
"""The relation of a link that is an edge."""

STANDS_BEFORE = "stands_before"
"""The relation of a node to the connector that one passes from there."""

MOST_IDS = 65_535
"""Nav2's messages hold ids as uint16."""

AT_STAND = 0.25
"""Metres from a connector's pose within which a node is at it."""

BELOW, ABOVE = 0.5, 0.5
"""How far under its floor and over its ceiling a room holds a node, metres."""

LINES = ("LineString", "MultiLineString")
TRIGGERS = ("NODE", "ON_ENTER", "ON_EXIT")
ENDS = ("startid", "endid")


def is_route_graph(path: Path) -> bool:
    """Whether a line in a GeoJSON file has `startid` and `endid`, which no annotation has."""
    try:
        large = TEXT_BYTES.exceeded_by(path.stat().st_size)  # refused when it is read
        if large or path.suffix.lower() == ".gpkg" or b'"startid"' not in path.read_bytes():
            return False
    except OSError:
        return False
    root = parse_json(path)
    features = root.get("features") if isinstance(root, dict) else None
    return isinstance(features, list) and any(
        _kind(f) in LINES and all(key in _properties(f) for key in ENDS) for f in features
    )


def read_route_graph(path: Path) -> World:
    """Read a route graph as Nav2's loader does: a file that it would refuse is refused.

    A node's name is that in its metadata or properties, else ``FILE-nodeID``; its heading is `yaw`
    of its metadata, radians. Its height is its third coordinate, else that of the storey named by
    `storey` (of its metadata or properties, or beside `features`), or by its frame (the storey's
    name, or ``map_STOREY``): see `settle_nodes`. Coordinates are metres in the map's frame.

    Raises
    ------
    WorldError
        The file is malformed; the message names the feature at fault.
    """
    return _Reader(path).world()


def _properties(feature: Any) -> Mapping[str, Any]:
    properties = feature.get("properties") if isinstance(feature, dict) else None
    return properties if isinstance(properties, dict) else {}


def _kind(feature: Any) -> str | None:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    return kind if isinstance(kind, str) else None


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.root = parse_json(path)
        self.out = World(path.stem, path)
        self.nodes: dict[int, str] = {}
        self.names: set[str] = set()
        self.edges: set[int] = set()
        if self.root.get("crs") is not None:
            self.out.notes.append(
                "the CRS is ignored: coordinates are metres of the map's own frame"
            )

    def world(self) -> World:
        features = list(enumerate(self.root["features"]))
        nodes = [(n, f) for n, f in features if _kind(f) == "Point"]
        edges = [(n, f) for n, f in features if _kind(f) in LINES]
        for number, feature in features:
            if _kind(feature) not in ("Point", *LINES):
                self.out.skipped.append(
                    Skipped(
                        f"features[{number}]",
                        f"is {_kind(feature) or 'without geometry'}, no node or edge",
                        "Draw nodes as points and edges as lines, the rest in a file of its own.",
                    )
                )
        if not nodes:
            raise WorldError(self.path, "features", "have no node", "Draw nodes as points.")
        for number, feature in nodes:
            self.attempt(f"features[{number}] (node {_id_of(feature)})", self.node, feature)
        for number, feature in edges:
            self.attempt(f"features[{number}] (edge {_id_of(feature)})", self.edge, feature)
        return self.out

    def attempt(self, where: str, read: Any, feature: Any) -> None:
        try:
            read(feature)
        except Refused as refused:
            raise WorldError(self.path, where, refused.problem, refused.mend) from None

    def node(self, feature: Any) -> None:
        said = _properties(feature)
        number = _id(said, "id")
        if number in self.nodes:
            raise Refused(f"its id {number} is another node's, too", "Give each node its own id.")
        about, metadata = _about(said), _metadata(said)
        frame = said.get("frame", "map")
        if not isinstance(frame, str):
            raise Refused(f"its frame is {frame!r}", "Give a name, or leave it out.")
        x, y, *z = _position(feature["geometry"].get("coordinates"))
        yaw = metadata.get("yaw", 0.0)
        if isinstance(yaw, bool) or not isinstance(yaw, int | float):
            raise Refused(f"its yaw is {yaw!r}", "Give radians, or leave it out.")
        name = next((n for n in (metadata.get("name"), said.get("name")) if n is not None), None)
        if name is not None and (not isinstance(name, str) or not name.strip()):
            raise Refused(f"its name is {name!r}", "Give a text, or leave it out.")
        storey = metadata.get("storey", said.get("storey", self.root.get("storey")))
        if storey is not None and not isinstance(storey, str):
            raise Refused(f"its storey is {storey!r}", "Give its name, or leave it out.")
        about |= {"id": number, "frame": frame, "metadata": metadata}
        about |= {"storey": storey} if storey is not None else {}
        self.nodes[number] = unique_name(
            name.strip() if name else f"{self.path.stem}-node{number}", self.names
        )
        self.names.add(self.nodes[number])
        self.out.entries.append(
            Entry(
                self.nodes[number],
                "region",
                "waypoint",
                properties=about | ({"z_said": True} if z else {}),
                pose=Pose.planar(x, y, float(yaw), z[0] if z else 0.0),
            )
        )

    def edge(self, feature: Any) -> None:
        said = _properties(feature)
        number = _id(said, "id")
        if number in self.edges:
            raise Refused(f"its id {number} is another edge's, too", "Give each edge its own id.")
        self.edges.add(number)
        start, end = (_id(said, key) for key in ENDS)
        for key, node in zip(ENDS, (start, end), strict=True):
            if node not in self.nodes:
                raise Refused(
                    f"its {key} is {node}, which is no node", "Draw that node, or correct the id."
                )
        about = _about(said) | {"id": number, "metadata": _metadata(said)}
        about |= {"cost": _cost(said), "overridable": said.get("overridable", True)}
        if not isinstance(about["overridable"], bool):
            raise Refused(f"overridable is {about['overridable']!r}", "Give true or false.")
        ends = (self.nodes[start], self.nodes[end])
        for link in self.out.links:
            if (link.subject, link.object) == ends:  # nodes that several edges join have one link
                link.properties.setdefault("also", []).append(about)
                return
        self.out.links.append(Link(ends[0], EDGE, ends[1], about))


def _id_of(feature: Any) -> Any:
    return _properties(feature).get("id", "without id")


def _id(said: Mapping[str, Any], key: str) -> int:
    value = said.get(key)
    whole = isinstance(value, int | float) and not isinstance(value, bool) and value == value // 1
    if not whole or not 0 <= value <= MOST_IDS:  # type: ignore[operator]
        problem = f"has no {key}" if value is None else f"its {key} is {value!r}"
        raise Refused(problem, f"Give a whole number from 0 to {MOST_IDS}.")
    return int(value)  # type: ignore[arg-type]


def _position(coordinates: Any) -> list[float]:
    numbers = [
        float(c)
        for c in (coordinates if isinstance(coordinates, list) else [])
        if isinstance(c, int | float) and not isinstance(c, bool) and not EXTENT.exceeded_by(abs(c))
    ]
    if len(numbers) < 2 or len(numbers) != len(coordinates):
        raise Refused(
            f"has the position {str(coordinates)[:60]}",
            f"Give x and y in metres of the map's frame, within {EXTENT.value:,.0f} m. "
            f"{EXTENT.variable} raises the limit.",
        )
    return numbers[:3]


def _cost(said: Mapping[str, Any]) -> float:
    cost = said.get("cost", 0.0)
    if isinstance(cost, bool) or not isinstance(cost, int | float) or not 0 <= cost < math.inf:
        raise Refused(f"its cost is {cost!r}", "Give a number from zero up, or leave it out.")
    return float(cost)


def _about(said: Mapping[str, Any]) -> dict[str, Any]:
    """The operations, checked, and what else the feature says that the format does not know."""
    known = ("id", "frame", "metadata", "operations", "cost", "overridable", "name", *ENDS)
    about = {k: checked_property(v, k) for k, v in said.items() if k not in known}
    about = {k: v for k, v in about.items() if v is not None}
    operations = said.get("operations")
    if operations is None:
        return about
    if not isinstance(operations, dict):
        raise Refused("its operations are no object", "Write them as name: {type, trigger}.")
    for name, operation in operations.items():
        if not isinstance(operation, dict) or not isinstance(operation.get("type"), str):
            raise Refused(f"its operation {name} has no type", "Name the route server's plugin.")
        if operation.get("trigger") not in TRIGGERS:
            raise Refused(
                f"the trigger of its operation {name} is {operation.get('trigger')!r}",
                f"Use one of {', '.join(TRIGGERS)}.",
            )
        _metadata(operation)
    return about | {"operations": checked_property(operations, "operations")}


def _metadata(said: Mapping[str, Any]) -> dict[str, Any]:
    metadata = said.get("metadata")
    if metadata is None:
        return {}
    if not isinstance(metadata, dict):
        raise Refused("its metadata is no object", "Write it as name: value.")
    checked_property(metadata, "metadata")
    _check_primitives(metadata, "metadata")
    return metadata


def _check_primitives(metadata: Mapping[str, Any], where: str) -> None:
    """Nav2's loader throws for null, and for arrays of anything but primitives."""
    for key, value in metadata.items():
        if isinstance(value, dict):
            _check_primitives(value, f"{where}.{key}")
            continue
        for inner in value if isinstance(value, list) else [value]:
            if not isinstance(inner, bool | int | float | str):
                said = "null" if inner is None else "an array of arrays or objects"
                raise Refused(f"{where}.{key} is {said}, for which Nav2 throws", "Remove it.")


# -- in the map -------------------------------------------------------------------------------


def check_names(
    connection: psycopg.Connection[Any], map_id: int, world: World, source: str
) -> None:
    """Refuse a graph whose nodes would pass for those of another file of its name.

    Raises
    ------
    WorldError
        Two graphs, of two storeys for instance, number their nodes alike.
    """
    numbered = [e.name for e in world.entries if e.name.startswith(f"{world.name}-node")]
    row = connection.execute(
        "SELECT name, source FROM entity WHERE map_id = %s AND name = ANY(%s) "
        "AND source IS DISTINCT FROM %s ORDER BY id LIMIT 1",
        (map_id, numbered, source),
    ).fetchone()
    if row is not None:
        raise WorldError(
            world.source,
            row[0],
            f"is in the map already, from {row[1]}",
            f"Rename this file, or import it with --source {row[1]} to replace that graph.",
        )


def settle_nodes(
    connection: psycopg.Connection[Any], map_id: int, world: World, source: str
) -> None:
    """Put the nodes of a graph on their storeys and into their rooms; join them with connectors.

    Within the caller's transaction. A node that says a storey, or whose frame names one, is at that
    storey's elevation; one that says none is on the only storey, or where its third coordinate is.

    Raises
    ------
    WorldError
        A node says a storey that the map does not have, or none where it has several.
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
    said = properties.get("storey")
    if said is None:
        frame = properties["frame"]
        said = next((s for s in storeys if frame in (s, "map_" + re.sub(r"\W+", "_", s))), None)
    if said is None and len(storeys) == 1:
        return next(iter(storeys))
    if said is None and properties.get("z_said"):
        return None
    if said not in storeys:
        problem = f"is on storey {said}" if said is not None else "says no storey"
        raise WorldError(
            world.source,
            name,
            f"{problem}, and the map has {', '.join(storeys)}",
            'Add "storey": "NAME" to its metadata, or beside "features" for all nodes.',
        )
    return str(said)


def _room_at(
    connection: psycopg.Connection[Any], map_id: int, x: float, y: float, z: float
) -> int | None:
    """The room around a point; of several the smallest."""
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
    """Links from nodes to the connectors at whose poses they lie, in the place on that side."""
    values = {"map": map_id, "source": source, "near": AT_STAND, "relation": STANDS_BEFORE}
    connection.execute(
        "DELETE FROM link l USING entity e WHERE e.id = l.from_id AND e.map_id = %(map)s "
        "AND e.source = %(source)s AND l.relation = %(relation)s",
        values,
    )
    found = connection.execute(
        "SELECT e.id, c.entity_id, s.side FROM entity e JOIN world w ON w.entity_id = e.id "
        "JOIN placement p ON p.entity_id = e.id, connector c "
        "JOIN entity ce ON ce.id = c.entity_id JOIN world cw ON cw.entity_id = c.entity_id, "
        "LATERAL (VALUES (0, pose_compose(cw.pose, c.pose_a), c.place_a), "
        "(1, pose_compose(cw.pose, c.pose_b), c.place_b)) s (side, pose, place) "
        "WHERE e.map_id = %(map)s AND e.source = %(source)s AND e.type = 'waypoint' "
        "AND ce.map_id = %(map)s AND p.holder_id = s.place "
        "AND ST_DWithin(ST_Point(w.pose[1], w.pose[2]), ST_Point(s.pose[1], s.pose[2]), %(near)s) "
        "AND abs(w.pose[3] - s.pose[3]) <= 1.0",
        values,
    ).fetchall()
    with connection.cursor() as cursor:
        cursor.executemany(
            "INSERT INTO link (from_id, relation, to_id, properties) VALUES (%s, %s, %s, %s)",
            [(node, STANDS_BEFORE, c, Jsonb({"side": side})) for node, c, side in found],
        )
