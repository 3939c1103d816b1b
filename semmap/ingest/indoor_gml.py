"""IndoorGML 1.0 and 1.1 (OGC 14-005r5, 19-011r4): cells as rooms, transitions as what joins them.

The storey of a cell is in its description (``storey="F1":type="stairs"``), as the tools of STEM Lab
write it, else it follows from the heights of floors. Cells of the navigation module that are doors
join their neighbours. A transition between cells of two storeys is a stair. What semmap exported
has its features as GeoJSON in `gml:metaDataProperty`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point

from semmap.geometry.levels import separate
from semmap.geometry.morphology import polygons
from semmap.geometry.overlay import united
from semmap.ingest.annotation.annotation import draft_entries
from semmap.ingest.annotation.draft_world import DraftWorld
from semmap.ingest.annotation.feature_file import (
    Feature,
    FeatureFile,
    checked_properties,
    into_metres,
    read_collection,
)
from semmap.ingest.floor_plan import middle_of
from semmap.ingest.georeference import northing_first
from semmap.ingest.naming import guess_type
from semmap.ingest.world import OUTSIDE, Refused, World, WorldError
from semmap.ingest.xml_file import read_xml
from semmap.limits import EXTENT, VERTICES

DOOR_CELLS = ("ConnectionSpace", "AnchorSpace")
"""Cells of the navigation module that stand for a door."""

DOOR_WIDTH = 0.9
"""Metres, of a transition without a boundary."""

LEVEL = 1e-3
"""Metres within which a face is level."""

DESCRIBED = re.compile(r'(\w+)\s*=\s*(?:"([^"]*)"|([^:"]+))')
"""A key and its value in a description."""

ID = "{http://www.opengis.net/gml/3.2}id"
HREF = "{http://www.w3.org/1999/xlink}href"


@dataclass
class Cell:
    """A cell space: its area, its heights where it has some, and what is known of it."""

    name: str
    kind: str
    area: Any
    low: float | None
    high: float | None
    properties: dict[str, Any]
    crs: str | None
    own: bool

    @property
    def is_door(self) -> bool:
        """Whether it stands for a door."""
        return self.kind in DOOR_CELLS or "door" in str(self.properties.get("type", "")).lower()


def read_indoor_gml(
    path: Path,
    types: Collection[str] | None = None,
    georeference: Mapping[str, float] | None = None,
) -> World:
    """Return the world of an IndoorGML file; types and georeference as of `read_annotation`.

    Raises
    ------
    WorldError
        The file is not IndoorGML, is malformed, or has no cells. A cell or transition that cannot
        be used is in `skipped`.
    """
    root = read_xml(path)
    if _local(root) != "IndoorFeatures":
        problem = f"is not the expected root, <IndoorFeatures>, but <{_local(root)}>"
        raise WorldError(path, "root", problem, "Give an IndoorGML file.")
    file = _Reader(path, root).file()
    return draft_entries(DraftWorld(path, into_metres(path, file, georeference), types))


class _Reader:
    """Makes features of the elements of a file."""

    def __init__(self, path: Path, root: Element) -> None:
        self.root = root
        about = _metadata(root)
        self.out = FeatureFile() if about is None else read_collection(path, about)
        self.by_id = {e.get(ID): e for e in root.iter() if e.get(ID)}
        self.cells: dict[str, Cell] = {}
        for element in _named(root, "Space"):
            with self.out.leaving_out(_where(element), _name(element)):
                self.cells[str(element.get(ID))] = self.cell(element)
        self.by_state = {
            state: cell for cell in self.cells for state in _links(self.by_id[cell], "duality")
        }
        if not self.cells:
            raise WorldError(path, "file", "has no cell spaces", "Give a file with geometry.")

    def file(self) -> FeatureFile:
        """Return all features."""
        drawn = [cell for cell in self.cells.values() if cell.area is not None and not cell.own]
        elevations = self.storeys([cell for cell in drawn if not cell.is_door])
        for cell in self.cells.values():
            if cell.own and cell.area is not None:
                self.add(cell.name, cell.area, cell.properties, cell.crs)
        for cell in (each for each in drawn if not each.is_door):
            floor = (cell.low or 0.0) - elevations[cell.properties["storey"]]
            top = None if cell.high is None else floor + cell.high - (cell.low or 0.0)
            guess = guess_type(str(cell.properties.get("type", "")), "room")
            about = {"kind": "room", "name": cell.name, "floor": floor, "ceiling": top}
            about["type"] = None if guess is None else guess.type
            self.add(cell.name, cell.area, {**cell.properties, **about}, cell.crs)
        for element in _named(self.root, "Boundary"):
            about = _metadata(element)
            if isinstance(about, dict):
                with self.out.leaving_out(_where(element), about.get("name")):
                    self.add(_name(element), _line(element), about, _srs(element))
        self.transitions()
        return self.out

    def add(self, where: str, geometry: Any, properties: dict[str, Any], crs: str | None) -> None:
        given = checked_properties({k: v for k, v in properties.items() if v is not None})
        self.out.features.append(Feature(where, None, geometry, given, crs))

    def cell(self, element: Element) -> Cell:
        area, low, high = _extent(element)
        about, crs = _metadata(element), _srs(element)
        if isinstance(about, dict):
            kind, name = "CellSpace", str(about.get("name", _name(element)))
            return Cell(name, kind, area, low, high, about, crs, own=True)
        described = next((e.text or "" for e in element if _local(e) == "description"), "")
        found = {
            key.lower(): (quoted or plain).strip()
            for key, quoted, plain in DESCRIBED.findall(described)
        }
        for word in ("usage", "function", "class"):  # elements of the navigation module, too
            text = next((e.text for e in element if _local(e) == word), None) or found.pop(word, "")
            found.setdefault("type", text.strip())
        return Cell(_name(element), _local(element), area, low, high, found, crs, own=False)

    def storeys(self, cells: list[Cell]) -> dict[str, float]:
        """Add the storeys of cells; return the elevations by their names."""
        levels = separate([cell.low or 0.0 for cell in cells])
        for cell in cells:
            below = [z for z in levels if z <= (cell.low or 0.0) + LEVEL] or levels[:1]
            cell.properties.setdefault("storey", f"storey_{levels.index(below[-1])}")
        elevations: dict[str, float] = {}
        for cell in sorted(cells, key=lambda each: each.low or 0.0):
            elevations.setdefault(cell.properties["storey"], cell.low or 0.0)
        for name, elevation in elevations.items():
            self.add(name, None, {"kind": "storey", "name": name, "elevation": elevation}, None)
        return elevations

    def transitions(self) -> None:
        """Add what joins cells: of doors that are cells, of transitions that cross a border."""
        neighbours: dict[str, list[str]] = {}
        seen = set()
        for element in _named(self.root, "Transition"):
            with self.out.leaving_out(_where(element), _name(element)):
                ends = [self.cell_of(each) for each in _links(element, "connects")]
                if len(ends) != 2:
                    raise Refused(f"connects {len(ends)} states", "Connect two states.")
                about = _metadata(element)
                if isinstance(about, dict):
                    self.add(_name(element), self.way(element), about, _srs(element))
                    continue
                a, b = (self.cells[end] for end in ends)
                if a.is_door or b.is_door:
                    for door, other in (ends, ends[::-1]):
                        if self.cells[door].is_door and other not in neighbours.setdefault(
                            door, []
                        ):
                            neighbours[door].append(other)
                    continue
                border = next(iter(_links(element, "duality")), None)
                line = None if border not in self.by_id else _line(self.by_id[border])
                if border in self.by_id and isinstance(_metadata(self.by_id[border]), dict):
                    continue
                geometry, passage = _passage(a, b, line)
                key = (frozenset(ends), tuple(np.round(geometry.centroid.coords[0], 3)))
                if a is not b and key not in seen:
                    seen.add(key)
                    self.add(_name(element), geometry, passage, a.crs)
        for cell, beside in neighbours.items():
            self.door_cell(self.cells[cell], [self.cells[each] for each in beside])

    def cell_of(self, state: str) -> str:
        """Return the cell of a state, which either of them names."""
        element = self.by_id.get(state)
        found = [] if element is None else _links(element, "duality")
        cell = next((each for each in found if each in self.cells), self.by_state.get(state))
        if cell is None:
            raise Refused(f"connects {state}, which has no cell", "Give the state's duality.")
        return cell

    def way(self, element: Element) -> LineString | None:
        """Return the line of a transition that semmap wrote, without the points of its states."""
        points = _points(element)
        states = [self.by_id.get(each) for each in _links(element, "connects")]
        first, last = (state is not None and len(_points(state)) > 0 for state in states)
        inner = points[int(first) : len(points) - int(last), :2]
        return LineString(inner) if len(inner) > 1 else None

    def door_cell(self, door: Cell, beside: list[Cell]) -> None:
        """Add the connector of a cell that is a door, between its neighbours."""
        with self.out.leaving_out(door.name, door.name):
            if not 1 <= len(beside) <= 2:
                raise Refused(f"is a door with {len(beside)} neighbours", "Connect one or two.")
            if any(each.area is None or each.area.is_empty for each in (door, *beside)):
                raise Refused("it or a neighbour has no geometry", "Draw its polygon.")
            near = [Point(shapely.shortest_line(door.area, c.area).coords[1]) for c in beside]
            middle = door.area.centroid
            (ax, ay), (bx, by) = near[0].coords[0], (near[1:] or [middle])[0].coords[0]
            heading = math.atan2(by - ay, bx - ax)
            across = shapely.get_coordinates(door.area) @ (-math.sin(heading), math.cos(heading))
            joins = [each.name for each in beside] + [OUTSIDE] * (2 - len(beside))
            about: dict[str, Any] = {"kind": "connector", "type": "door", "name": door.name}
            about |= {"joins": joins, "heading": heading, "width": float(np.ptp(across))}
            about["storey"] = beside[0].properties.get("storey")
            self.add(door.name, middle, about, door.crs)


def _passage(a: Cell, b: Cell, line: LineString | None) -> tuple[Any, dict[str, Any]]:
    """Return the geometry and properties of what joins two cells."""
    storeys = [each.properties.get("storey") for each in (a, b)]
    about = {"kind": "connector", "joins": [a.name, b.name], "storey": storeys[0]}
    if a.area is None or b.area is None:
        a, b = (a, b) if b.area is None else (b, a)
        about |= {"joins": [a.name, OUTSIDE], "storey": a.properties.get("storey")}
        if line is None or a.area is None:
            raise Refused("leads outside at no place", "Give it a boundary.")
    elif storeys[0] != storeys[1]:
        return LineString([middle_of(a.area), middle_of(b.area)]), {**about, "type": "stairs"}
    if line is not None:
        return line, {**about, "type": "door"}
    border = a.area.boundary.intersection(b.area.boundary)
    at = border.centroid
    if border.length == 0:
        at = shapely.shortest_line(a.area, b.area).centroid
    ring = shapely.get_coordinates(a.area.exterior if a.area.geom_type == "Polygon" else a.area)
    sides = [LineString(ring[k : k + 2]) for k in range(len(ring) - 1)]
    (ax, ay), (bx, by) = min(sides, key=at.distance).coords
    heading = math.atan2(by - ay, bx - ax) + math.pi / 2
    return at, {**about, "type": "opening", "heading": heading, "width": DOOR_WIDTH}


def _extent(element: Element) -> tuple[Any, float | None, float | None]:
    """Return the area of a cell seen from above, and its lowest and highest coordinates."""
    faces = [
        [_points(ring, polygon) for ring in polygon.iter() if _local(ring) == "LinearRing"]
        for polygon in element.iter()
        if _local(polygon) == "Polygon"
    ]
    faces = [[ring for ring in rings if len(ring) > 3] for rings in faces if len(rings[0:1])]
    faces = [rings for rings in faces if rings]
    if not faces:
        return None, None, None
    VERTICES.check(sum(len(r) for rings in faces for r in rings), Refused, "Simplify it.")
    corners = np.concatenate([ring for rings in faces for ring in rings])
    low, high = float(corners[:, 2].min()), float(corners[:, 2].max())
    EXTENT.check(max(-low, high), Refused, "Give heights in metres.", "reaches a height of")
    level = [r for r in faces if np.ptp(r[0][:, 2]) < LEVEL and r[0][0, 2] < low + LEVEL]
    drawn = [
        shapely.Polygon(outer[:, :2], [hole[:, :2] for hole in holes])
        for outer, *holes in level or faces
    ]
    if len(drawn) == 1:
        return drawn[0], low, high if high > low + LEVEL else None
    whole = united(shapely.make_valid(each) for each in drawn)
    parts = polygons(whole)
    area = parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)
    return area, low, high if high > low + LEVEL else None


def _line(element: Element) -> LineString | None:
    """Return the line of a boundary seen from above, from one end to the other."""
    points = _points(element)[:, :2]
    if len(points) < 2:
        return None
    if any(_local(each) == "Polygon" for each in element.iter()):
        away = np.linalg.norm(points[:, None] - points, axis=2) if len(points) < 1000 else None
        if away is None or away.max() == 0:
            return None
        points = points[[*np.unravel_index(away.argmax(), away.shape)]]
    return LineString(points[[0, -1]])


def _points(element: Element, polygon: Element | None = None) -> NDArray[np.float64]:
    """Return all positions in an element, (N, 3); z is 0 where there is none."""
    found = []
    for each in element.iter():
        kind, text = _local(each), (each.text or "").replace(",", " ")
        if kind in ("pos", "posList", "coordinates"):
            words = text.split()
            given = each.get("srsDimension") or (
                None if polygon is None else polygon.get("srsDimension")
            )
            size = len(words) if kind == "pos" else 2 if given == "2" or len(words) % 3 else 3
            try:
                rows = np.array(words, float).reshape(-1, min(max(size, 2), 3))
            except ValueError:
                problem = f"has the positions {text.strip()[:60]!r}"
                raise Refused(problem, "Give two or three numbers each.") from None
            found.append(np.pad(rows, ((0, 0), (0, 3 - rows.shape[1]))))
    points = np.concatenate(found) if found else np.empty((0, 3))
    if not np.isfinite(points).all():
        raise Refused("has a position that is not finite", "Correct it.")
    srs = _srs(element) or (None if polygon is None else _srs(polygon))
    return points[:, [1, 0, 2]] if srs and northing_first(srs) else points


def _srs(element: Element) -> str | None:
    return next((str(e.get("srsName")) for e in element.iter() if e.get("srsName")), None)


def _local(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _named(root: Element, ending: str) -> Iterator[Element]:
    """Yield the features whose element ends so: ``CellSpace`` and ``TransferSpace``."""
    return (e for e in root.iter() if _local(e).endswith(ending) and e.get(ID))


def _name(element: Element) -> str:
    named = next((e.text for e in element if _local(e) == "name" and e.text), None)
    return (named or "").strip() or str(element.get(ID))


def _where(element: Element) -> str:
    return f"{_local(element)} {element.get(ID)}"


def _links(element: Element, tag: str) -> list[str]:
    """Return the ids to which the elements of a tag refer, or that they hold."""
    found = []
    for each in element:
        if _local(each) == tag:
            inner = each.get(HREF, "").lstrip("#") or next((e.get(ID) for e in each), None)
            found += [inner] if inner else []
    return found


def _metadata(element: Element) -> Any:
    """Return what semmap wrote into an element's metadata; None where it did not."""
    for each in element:
        inner = next(iter(each), None) if _local(each) == "metaDataProperty" else None
        if inner is not None and inner.text and inner.text.lstrip().startswith("{"):
            try:
                return json.loads(inner.text)
            except (ValueError, RecursionError):
                return None
    return None
