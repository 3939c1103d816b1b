"""A map as IndoorGML 1.1 (OGC 19-011r4), core module: cells, boundaries, and their dual graph.

A room is a cell and a state, a door the boundary between two cells and a transition between their
states; stairs are transitions alone. The outside is a cell without geometry. What IndoorGML has no
element for (types, heights of doors, furniture, ...) is GeoJSON in `gml:metaDataProperty`, where
GML 3.2.1 (OGC 07-036, annex I) takes any content.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from lxml import etree
from lxml.builder import ElementMaker

from semmap.export.features import MapFeature, MapFeatures
from semmap.export.gis_file import collection
from semmap.geometry.morphology import polygons
from semmap.ingest.floor_plan import middle_of
from semmap.ingest.georeference import northing_first
from semmap.ingest.world import OUTSIDE

NAMESPACES = {
    "core": "http://www.opengis.net/indoorgml/1.0/core",
    "gml": "http://www.opengis.net/gml/3.2",
    "xlink": "http://www.w3.org/1999/xlink",
}
ID, HREF = f"{{{NAMESPACES['gml']}}}id", f"{{{NAMESPACES['xlink']}}}href"

_CORE = ElementMaker(namespace=NAMESPACES["core"], nsmap=NAMESPACES)
_GML = ElementMaker(namespace=NAMESPACES["gml"], nsmap=NAMESPACES)


class _Document:
    """The elements of a file, each with an id of its own."""

    def __init__(self, found: MapFeatures) -> None:
        self.found = found
        self.numbers = count(1)
        self.srs = {} if found.crs is None else {"srsName": srs_name(found.crs)}
        self.swap = bool(self.srs) and northing_first(self.srs["srsName"])

    def gml(self, tag: str, *content: Any, **attributes: str) -> Any:
        """An element of GML with an id."""
        return _GML(tag, {ID: f"g{next(self.numbers)}"}, *content, **attributes)

    def positions(self, tag: str, points: Iterable[Sequence[float]]) -> Any:
        given = [(y, x, z) if self.swap else (x, y, z) for x, y, z in points]
        return _GML(tag, " ".join(repr(float(v)) for point in given for v in point))

    def ring(self, points: Iterable[Sequence[float]]) -> Any:
        return _GML("LinearRing", self.positions("posList", points))

    def polygon(self, rings: Sequence[Any]) -> Any:
        outer, *holes = rings
        return self.gml(
            "Polygon",
            _GML("exterior", outer),
            *(_GML("interior", hole) for hole in holes),
            srsDimension="3",
            **self.srs,
        )

    def level(self, area: shapely.Polygon, z: float, up: bool = True) -> Any:
        """A level polygon that faces up or down."""
        area = shapely.normalize(area)  # whose outer ring is clockwise
        rings = [area.exterior, *area.interiors]
        return self.polygon(
            [self.ring([(*p, z) for p in ring.coords[:: -1 if up else 1]]) for ring in rings]
        )

    def room_geometry(self, area: Any, low: float, high: float) -> Any:
        """The solid of an area in one piece; of several its level surface."""
        parts = polygons(area)
        if len(parts) != 1:
            members = [_GML("surfaceMember", self.level(part, low)) for part in parts]
            return _CORE("Geometry2D", self.gml("CompositeSurface", *members))
        (part,) = parts
        faces = [self.level(part, low, up=False), self.level(part, high)]
        solid = shapely.normalize(part)
        for ring in (solid.exterior, *solid.interiors):
            corners = ring.coords[::-1]
            for (ax, ay), (bx, by) in pairwise(corners):
                side = [(ax, ay, low), (bx, by, low), (bx, by, high), (ax, ay, high), (ax, ay, low)]
                faces.append(self.polygon([self.ring(side)]))
        shell = _GML("Shell", *(_GML("surfaceMember", face) for face in faces))
        return _CORE("Geometry3D", self.gml("Solid", _GML("exterior", shell), **self.srs))

    def line(self, points: Sequence[Sequence[float]]) -> Any:
        positions = self.positions("posList", points)
        return self.gml("LineString", positions, srsDimension="3", **self.srs)


def srs_name(crs: str) -> str:
    """Return the URN of a CRS, for WGS 84 the one with the longitude first."""
    if crs == "EPSG:4326":
        return "urn:ogc:def:crs:OGC:1.3:CRS84"
    return f"urn:ogc:def:crs:{crs.replace(':', '::')}" if crs.startswith("EPSG:") else crs


class _Passage(NamedTuple):
    """What joins two cells: a boundary between them, or a way from one storey to another."""

    number: int
    door: MapFeature
    way: list[tuple[float, ...]]  # the corners of its line
    line: list[tuple[float, ...]]  # from the middle of a room, through it, to that of the next
    is_boundary: bool


def write_indoor_gml(found: MapFeatures, path: Path) -> None:
    """Write a map as IndoorGML, which consists of rooms; ValueError without any."""
    if not any(map(_has_area, found.all("rooms"))):
        raise ValueError("IndoorGML consists of rooms, and the map has none: semmap rooms find")
    made = _Document(found)
    rooms = {each.name: each for each in found.all("rooms")}
    middles = {name: _middle(room, found.floor_of(room)) for name, room in rooms.items()}
    passages = _passages(found, middles)
    numbers = {name: number for number, name in enumerate(rooms, 1)}
    if any(OUTSIDE in each.door.places for each in passages):
        numbers[OUTSIDE] = 0
    cells, states = [], []
    for name, number in numbers.items():
        own = [each for each in passages if name in each.door.places]
        cells.append(_cell(made, number, name, rooms.get(name), own))
        states.append(_state(made, number, middles.get(name), own))
    edges = [_transition(made, each, numbers) for each in passages]
    boundaries = [_boundary(made, each) for each in passages if each.is_boundary]
    primal = _CORE("PrimalSpaceFeatures", {ID: "PS1"}, *cells, *boundaries)
    root = _CORE(
        "IndoorFeatures",
        {ID: "IF1"},
        _meta(collection(_rest(found, passages))),
        _GML("name", _clean(found.name)),
        _CORE("primalSpaceFeatures", primal),
    )
    if states:  # a graph has nodes
        layer = _CORE("SpaceLayer", {ID: "L1"}, _CORE("nodes", {ID: "N1"}, *states))
        if edges:
            layer.append(_CORE("edges", {ID: "E1"}, *edges))
        layers = _CORE("spaceLayers", {ID: "SL1"}, _CORE("spaceLayerMember", layer))
        graph = _CORE("MultiLayeredGraph", {ID: "MG1"}, layers)
        root.append(_CORE("multiLayeredGraph", graph))
    etree.ElementTree(root).write(
        str(path), encoding="UTF-8", xml_declaration=True, pretty_print=True
    )


def _passages(
    found: MapFeatures, middles: Mapping[str, tuple[float, ...] | None]
) -> list[_Passage]:
    """The doors and ways between two cells; others, such as doors within a room, are left."""
    passages: list[_Passage] = []
    for door in found.all("doors"):
        a, b = door.places
        if a == b or not {a, b} <= {*middles, OUTSIDE}:
            continue
        z = found.floor_of(door)
        way = [] if door.geometry is None else [(*point, z) for point in door.geometry.coords]
        is_boundary = bool(way) and door.keys.get("type") not in ("stairs", "ramp", "escalator")
        through = [tuple(np.mean(way, axis=0).tolist())] if is_boundary else way
        line = [each for each in (middles.get(a), *through, middles.get(b)) if each is not None]
        passages.append(_Passage(len(passages) + 1, door, way, line, is_boundary))
    return passages


def _rest(found: MapFeatures, passages: Sequence[_Passage]) -> MapFeatures:
    """The features that no cell, boundary or transition has."""
    passed = {each.door.name for each in passages}
    rest = dict(found.layers)
    rest["rooms"] = [each for each in found.all("rooms") if not _has_area(each)]
    rest["doors"] = [each for each in found.all("doors") if each.name not in passed]
    return replace(found, layers=rest)


def _cell(
    made: _Document,
    number: int,
    name: str,
    room: MapFeature | None,
    passages: Sequence[_Passage],
) -> Any:
    """The cell of a room; without one, of the outside."""
    space = _CORE("CellSpace", {ID: f"C{number}"})
    space.extend([_GML("name", name)] if room is None else _about(room))
    if room is not None and _has_area(room):
        low = made.found.floor_of(room)
        top = room.keys["ceiling"] if "ceiling" in room.keys else room.keys["top"]
        high = low + top - room.keys.get("floor", 0.0)
        geometry = made.room_geometry(room.geometry, low, high)
        space.append(_CORE("cellSpaceGeometry", geometry))
    space.append(_link("duality", f"S{number}"))
    bounds = (each for each in passages if each.is_boundary)
    space.extend(_link("partialboundedBy", f"B{each.number}") for each in bounds)
    return _CORE("cellSpaceMember", space)


def _state(
    made: _Document,
    number: int,
    middle: tuple[float, ...] | None,
    passages: Sequence[_Passage],
) -> Any:
    """The state of a cell, in its middle."""
    state = _CORE("State", {ID: f"S{number}"}, _link("duality", f"C{number}"))
    state.extend(_link("connects", f"T{each.number}") for each in passages)
    if middle is not None:
        point = made.gml("Point", made.positions("pos", [middle]), **made.srs)
        state.append(_CORE("geometry", point))
    return _CORE("stateMember", state)


def _boundary(made: _Document, passage: _Passage) -> Any:
    """The boundary between the cells that a door joins: the line of its opening."""
    boundary = _CORE("CellSpaceBoundary", {ID: f"B{passage.number}"}, *_about(passage.door))
    boundary.append(_link("duality", f"T{passage.number}"))
    line = _CORE("geometry2D", made.line(passage.way))
    boundary.append(_CORE("cellSpaceBoundaryGeometry", line))
    return _CORE("cellSpaceBoundaryMember", boundary)


def _transition(made: _Document, passage: _Passage, numbers: Mapping[str, int]) -> Any:
    """The transition between the states of the cells that a door or way joins."""
    edge = _CORE("Transition", {ID: f"T{passage.number}"})
    edge.extend([] if passage.is_boundary else _about(passage.door))
    edge.append(_CORE("weight", repr(_length(passage.line))))
    edge.extend(_link("connects", f"S{numbers[place]}") for place in passage.door.places)
    if passage.is_boundary:
        edge.append(_link("duality", f"B{passage.number}"))
    if passage.line:
        points = passage.line if len(passage.line) > 1 else 2 * passage.line
        edge.append(_CORE("geometry", made.line(points)))
    return _CORE("transitionMember", edge)


def _has_area(room: MapFeature) -> bool:
    return room.geometry is not None and room.geometry.area > 0


def _middle(room: MapFeature, floor: float) -> tuple[float, float, float] | None:
    if room.geometry is None:
        return None
    area = room.geometry
    point = middle_of(area) if area.area > 0 else area.centroid
    return point.x, point.y, floor


def _length(line: Sequence[Sequence[float]]) -> float:
    return float(np.linalg.norm(np.diff(np.array(line), axis=0), axis=1).sum()) if line else 0.0


def _about(each: MapFeature) -> list[Any]:
    """Metadata, description and name; the storey is in the description, as of STEM Lab's tools."""
    storey = each.keys.get("storey")
    described = [] if storey is None else [_GML("description", f'storey="{_clean(storey)}":')]
    return [_meta(each.properties), *described, _GML("name", _clean(each.name))]


def _meta(content: Any) -> Any:
    return _GML("metaDataProperty", _GML("GenericMetaData", json.dumps(content)))


def _link(tag: str, target: str) -> Any:
    return _CORE(tag, {HREF: f"#{target}"})


def _clean(text: str) -> str:
    """Return a text without the characters that XML does not have."""
    return "".join(c if c.isprintable() else "_" for c in text)
