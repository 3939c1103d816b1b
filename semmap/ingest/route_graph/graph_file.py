"""Route graphs drawn for Nav2's route server (GeoJSON): waypoints and links `nav2_edge`."""

from __future__ import annotations

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

from semmap.finite_number import is_finite_number
from semmap.geometry.pose import Pose
from semmap.ingest.annotation.feature_file import (
    CRS_IGNORED,
    checked_properties,
    checked_property,
    parse_json,
)
from semmap.ingest.world import Entry, Refused, Skipped, World, WorldError, WorldLink, unique_name
from semmap.limits import EXTENT, TEXT_BYTES

EDGE = "nav2_edge"
"""The relation of a link that is an edge."""

MOST_IDS = 65_535
"""Nav2's messages hold ids as uint16."""

LINES = ("LineString", "MultiLineString")
TRIGGERS = ("NODE", "ON_ENTER", "ON_EXIT")
ENDS = ("startid", "endid")


def is_route_graph(path: Path) -> bool:
    """Return whether a line of a GeoJSON file has `startid` and `endid`: no annotation has."""
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
    """Return the world of a route graph; a WorldError names a feature that Nav2 would refuse.

    A node's name is that in its metadata or properties, else ``FILE-nodeID``; its heading is `yaw`
    of its metadata, radians. Its height is its third coordinate, else that of the storey named by
    `storey` (of its metadata or properties, or beside `features`), or by its frame (the storey's
    name, or ``map_STOREY``): see `settle_nodes`. Coordinates are metres in the map's frame.
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
            self.out.notes.append(CRS_IGNORED)

    def world(self) -> World:
        found: dict[str, list[tuple[str, Any]]] = {"node": [], "edge": []}
        for number, feature in enumerate(self.root["features"]):
            kind, where = _kind(feature), f"features[{number}]"
            if kind in ("Point", *LINES):
                what = "node" if kind == "Point" else "edge"
                given = _properties(feature).get("id", "without id")
                found[what].append((f"{where} ({what} {given})", feature))
            else:
                problem = f"is {kind or 'without geometry'}, not a node or edge"
                fix = "Draw nodes as points and edges as lines, the rest in another file."
                self.out.skipped.append(Skipped(where, problem, fix))
        if not found["node"]:
            raise WorldError(self.path, "features", "contain no node", "Draw nodes as points.")
        for what, read in (("node", self.node), ("edge", self.edge)):
            for where, feature in found[what]:
                try:
                    read(feature)
                except Refused as refused:
                    raise WorldError(self.path, where, refused.problem, refused.fix) from None
        return self.out

    def node(self, feature: Any) -> None:
        given = _properties(feature)
        number = _own_id(given, "node", self.nodes)
        about, metadata = _about(given), _metadata(given)
        frame = given.get("frame", "map")
        if not isinstance(frame, str):
            raise Refused(f"its frame is {frame!r}", "Give a name, or leave it out.")
        x, y, *z = _position(feature["geometry"].get("coordinates"))
        yaw = metadata.get("yaw", 0.0)
        if not is_finite_number(yaw):
            raise Refused(f"its yaw is {yaw!r}", "Give radians, or leave it out.")
        name = next((n for n in (metadata.get("name"), given.get("name")) if n is not None), None)
        if name is not None and (not isinstance(name, str) or not name.strip()):
            raise Refused(f"its name is {name!r}", "Give a text, or leave it out.")
        storey = metadata.get("storey", given.get("storey", self.root.get("storey")))
        if storey is not None and not isinstance(storey, str):
            raise Refused(f"its storey is {storey!r}", "Give its name, or leave it out.")
        about |= {"id": number, "frame": frame, "metadata": metadata}
        about |= {"storey": storey} if storey is not None else {}
        about |= {"z_said": True} if z else {}
        wanted = name.strip() if name else f"{self.path.stem}-node{number}"
        self.nodes[number] = unique_name(wanted, self.names)
        self.names.add(self.nodes[number])
        pose = Pose.planar(x, y, float(yaw), z[0] if z else 0.0)
        self.out.entries.append(
            Entry(self.nodes[number], "region", "waypoint", properties=about, pose=pose)
        )

    def edge(self, feature: Any) -> None:
        given = _properties(feature)
        number = _own_id(given, "edge", self.edges)
        self.edges.add(number)
        ends = []
        for key in ENDS:
            node = _id(given, key)
            if node not in self.nodes:
                problem = f"its {key} is {node}, which is not a node"
                raise Refused(problem, "Draw that node, or correct the id.")
            ends.append(self.nodes[node])
        about = _about(given) | {"id": number, "metadata": _metadata(given)}
        about |= {"cost": _cost(given), "overridable": given.get("overridable", True)}
        if not isinstance(about["overridable"], bool):
            raise Refused(f"overridable is {about['overridable']!r}", "Give true or false.")
        for link in self.out.links:
            if [link.subject, link.object] == ends:  # nodes that several edges join have one link
                link.properties.setdefault("also", []).append(about)
                return
        self.out.links.append(WorldLink(ends[0], EDGE, ends[1], about))


def _id(given: Mapping[str, Any], key: str) -> int:
    value = given.get(key)
    if not is_finite_number(value) or value % 1 or not 0 <= value <= MOST_IDS:
        problem = f"has no {key}" if value is None else f"its {key} is {value!r}"
        raise Refused(problem, f"Give a whole number from 0 to {MOST_IDS}.")
    return int(value)


def _own_id(given: Mapping[str, Any], what: str, taken: Container[int]) -> int:
    number = _id(given, "id")
    if number in taken:
        problem = f"its id {number} is also that of another {what}"
        raise Refused(problem, f"Give each {what} its own id.")
    return number


def _position(coordinates: Any) -> list[float]:
    numbers = [
        float(c)
        for c in (coordinates if isinstance(coordinates, list) else [])
        if is_finite_number(c) and not EXTENT.exceeded_by(abs(c))
    ]
    if len(numbers) < 2 or len(numbers) != len(coordinates):
        raise Refused(
            f"has the position {str(coordinates)[:60]}",
            f"Give x and y in metres of the map's frame, within {EXTENT.value:,.0f} m. "
            f"{EXTENT.variable} raises the limit.",
        )
    return numbers[:3]


def _cost(given: Mapping[str, Any]) -> float:
    cost = given.get("cost", 0.0)
    if not is_finite_number(cost) or cost < 0:
        raise Refused(f"its cost is {cost!r}", "Give a number from zero up, or leave it out.")
    return float(cost)


def _about(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the checked operations and the properties that the format does not define."""
    known = ("id", "frame", "metadata", "operations", "cost", "overridable", "name", *ENDS)
    about = checked_properties({k: v for k, v in given.items() if k not in known})
    about = {k: v for k, v in about.items() if v is not None}
    operations = given.get("operations")
    if operations is None:
        return about
    if not isinstance(operations, dict):
        raise Refused("its operations are not an object", "Write them as name: {type, trigger}.")
    for name, operation in operations.items():
        if not isinstance(operation, dict) or not isinstance(operation.get("type"), str):
            raise Refused(f"its operation {name} has no type", "Name the route server's plugin.")
        trigger = operation.get("trigger")
        if trigger not in TRIGGERS:
            problem = f"the trigger of its operation {name} is {trigger!r}"
            raise Refused(problem, f"Use one of {', '.join(TRIGGERS)}.")
        _metadata(operation)
    return about | {"operations": checked_property(operations, "operations")}


def _metadata(given: Mapping[str, Any]) -> dict[str, Any]:
    metadata = given.get("metadata")
    if metadata is None:
        return {}
    if not isinstance(metadata, dict):
        raise Refused("its metadata is not an object", "Write it as name: value.")
    checked_property(metadata, "metadata")
    _check_primitives(metadata, "metadata")
    return metadata


def _check_primitives(metadata: Mapping[str, Any], where: str) -> None:
    """Refuse null, and arrays of anything but primitives: Nav2's loader fails on them."""
    for key, value in metadata.items():
        if isinstance(value, dict):
            _check_primitives(value, f"{where}.{key}")
            continue
        for inner in value if isinstance(value, list) else [value]:
            if not isinstance(inner, bool | int | float | str):
                given = "null" if inner is None else "an array of arrays or objects"
                problem = f"{where}.{key} is {given}, which makes Nav2's loader fail"
                raise Refused(problem, "Remove it.")
