"""Open-RMF ``building.yaml`` as its editor wrote it: checked, typed, in its own units, y up."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from semmap.ingest.georeference import WGS84, into_frame, lowest, on_true_scale, scale_note
from semmap.ingest.text_file import read_text
from semmap.ingest.world import Refused, Skipped, WorldError
from semmap.yaml_file import FAST, check_structure

IS_IT_ONE = "Is it a building.yaml of the traffic editor?"

LARGEST = 1e9
"""Pixels, metres or radians; also excludes NaN and infinity."""

NEAR = 1000.0
"""Metres from its stated origin within which a building in degrees keeps it."""

COORDINATE_SYSTEMS = {"reference_image": -1.0, "cartesian_meters": 1.0, "wgs84": 1.0}
"""The factor by which y points up; in `wgs84` x and y are longitude and latitude, degrees."""


@dataclass(frozen=True)
class Vertex:
    """A corner or a waypoint: position in the level's drawing units, y up."""

    x: float
    y: float
    name: str
    params: dict[str, Any]


@dataclass(frozen=True)
class Edge:
    """A wall, door, lane or measurement between two usable vertices of its level."""

    start: int
    end: int
    params: dict[str, Any]
    element: str


@dataclass(frozen=True)
class FloorOutline:
    """The outline of a floor: the numbers of its vertices."""

    vertices: tuple[int, ...]
    element: str


@dataclass(frozen=True)
class RmfModel:
    """A piece of furniture: drawing units, y up; z in metres above the level; yaw in radians."""

    name: str
    model: str
    x: float
    y: float
    z: float
    yaw: float
    static: bool
    element: str


@dataclass(frozen=True)
class LiftDoor:
    """Metres and radians in the cabin's frame."""

    name: str
    x: float
    y: float
    width: float
    yaw: float
    type: int


@dataclass(frozen=True)
class Lift:
    """Centre in the drawing units of `reference_level`, y up; width (x) and depth (y) in metres."""

    name: str
    x: float
    y: float
    yaw: float
    width: float
    depth: float
    reference_level: str
    initial_level: str
    doors: dict[str, LiftDoor]
    level_doors: dict[str, tuple[str, ...]]
    element: str


@dataclass
class LevelPlan:
    """One level. An unusable vertex is None, so that the others keep their numbers."""

    name: str
    elevation: float
    vertices: list[Vertex | None]
    fiducials: dict[str, tuple[float, float]]
    measurements: list[Edge]
    walls: list[Edge]
    doors: list[Edge]
    lanes: list[Edge]
    floors: list[FloorOutline]
    models: list[RmfModel]


@dataclass
class Building:
    """A whole file; `skipped` has the elements that cannot be used."""

    path: Path
    name: str
    in_pixels: bool
    reference_level: str
    levels: dict[str, LevelPlan]
    lifts: list[Lift]
    skipped: list[Skipped] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    georeference: dict[str, float] | None = None


def read_building(path: Path, georeference: Mapping[str, float] | None = None) -> Building:
    """Read a file, of degrees into the frame of a map with a georeference.

    A WorldError refuses one that is not a building, or is malformed.
    """
    reader = _Reader(path, georeference)
    return reader.building(reader.load())


def _number(value: object, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Refused(f"{what} is {value!r}, not a number", f"Give {what} as a number.")
    if not abs(value) <= LARGEST:
        raise Refused(f"{what} is too large", f"Give {what} a sensible value.")
    return float(value)


def _text(value: object) -> str:
    """Return a name without characters that cannot be printed, such as NUL."""
    return "".join(c for c in str(value) if c.isprintable()).strip()


def _mapping(value: object, what: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise Refused(f"{what} is not a mapping", f"Write {what} as key: value pairs.")
    return value


def _params(value: object) -> dict[str, Any]:
    """Return the values of ``name: [type, value]``."""
    found: dict[str, Any] = {}
    for name, typed in _mapping({} if value is None else value, "its parameters").items():
        if not isinstance(typed, list) or len(typed) != 2:
            raise Refused(f"parameter {name} is not [type, value]", "Write it as such.")
        given = typed[1]
        if not isinstance(given, str | bool):
            _number(given, f"parameter {name}")
        found[_text(name)] = _text(given) if isinstance(given, str) else given
    return found


def _drawn_places(levels: dict[str, Any]) -> NDArray[np.float64]:
    """Return the longitudes and latitudes (N, 2) of all vertices that can be used."""
    places: list[tuple[float, float]] = []
    for level in levels.values():
        vertices = level.get("vertices") if isinstance(level, dict) else None
        for vertex in vertices if isinstance(vertices, list) else ():
            with contextlib.suppress(Refused, TypeError, IndexError, KeyError):
                places.append((_number(vertex[0], "x"), _number(vertex[1], "y")))
    return np.array(places).reshape(-1, 2)


class _Reader:
    """Makes a `Building` of a file; collects what is left out."""

    def __init__(self, path: Path, georeference: Mapping[str, float] | None) -> None:
        self.path = path
        self.given = georeference
        self.skipped: list[Skipped] = []
        self.notes: list[str] = []
        self.flip = 1.0
        self.frame: dict[str, float] | None = None  # of degrees
        self.turn = 0.0  # of the east of the stated grid in it
        self.vertices: list[Vertex | None] = []  # of the level that is read

    def fail(self, element: str, problem: str, fix: str) -> WorldError:
        return WorldError(self.path, element, problem, fix)

    def load(self) -> dict[str, Any]:
        text = read_text(self.path)
        try:
            check_structure(
                text, lambda line, p, f: self.fail(f"line {line}", p, f), loader=FAST, aliases=False
            )
            data = yaml.load(text, Loader=FAST)
        except yaml.YAMLError as error:
            mark = getattr(error, "problem_mark", None)
            where = f"line {mark.line + 1}" if mark else "file"
            problem = getattr(error, "problem", None) or str(error).splitlines()[0]
            problem = f"is not valid YAML: {problem}"
            raise self.fail(where, problem, "Is the file complete?") from None
        except ValueError as error:
            problem = f"has a value that YAML cannot hold: {error}"
            raise self.fail("file", problem, "Correct it.") from None
        if not isinstance(data, dict):
            raise self.fail("file", "is not a mapping", IS_IT_ONE)
        return data

    def building(self, data: dict[str, Any]) -> Building:
        system = str(data.get("coordinate_system", "reference_image"))
        if system not in COORDINATE_SYSTEMS:
            known = f"Save the building as one of {', '.join(COORDINATE_SYSTEMS)}."
            raise self.fail("coordinate_system", f"{system!r} is not read", known)
        self.flip = COORDINATE_SYSTEMS[system]
        levels = data.get("levels")
        if not isinstance(levels, dict) or not levels:
            problem = "is missing" if "levels" not in data else "holds no level"
            raise self.fail("levels", problem, IS_IT_ONE)
        if system == "wgs84":
            self.frame = self.frame_of_earth(data)
        plans = {_text(name): self.level(_text(name), level) for name, level in levels.items()}
        if "" in plans:
            raise self.fail("levels", "has a level without a name", "Name it.")
        reference = _text(data.get("reference_level_name") or next(iter(plans)))
        if reference not in plans:
            problem = f"{reference!r} is not a level of this building"
            raise self.fail("reference_level_name", problem, f"Name one of {', '.join(plans)}.")
        name = _text(data.get("building_name") or data.get("name") or "") or self.path.name
        lifts = self.lifts(data.get("lifts"), plans, reference)
        pixels = system == "reference_image"
        made = Building(self.path, name, pixels, reference, plans, lifts, self.skipped, self.notes)
        made.georeference = None if self.given else self.frame
        return made

    def frame_of_earth(self, data: dict[str, Any]) -> dict[str, float]:
        """Return the georeference of a building in degrees, on the grid that it states.

        It is that of the map, if it has one. Else its origin is the `suggested_offset` of the file,
        if the building is near that, or its lowest whole metres. A grid that stretches lengths
        there is replaced by UTM, with the x axis along the former.
        """
        from pyproj import CRS
        from pyproj.exceptions import CRSError

        offsets = [f"suggested_offset_{axis}" for axis in "xy"]
        try:
            given = _params(data.get("parameters"))
            code = re.fullmatch(r"EPSG:(\d{4,6})", str(given.get("generate_crs", "")))
            if code is None:
                problem = f"generate_crs is {given.get('generate_crs')!r}"
                raise Refused(problem, "Set it to the EPSG code of a grid, such as EPSG:32648.")
            x, y = (_number(given.get(offset, 0.0), offset) for offset in offsets)
            if not CRS.from_epsg(int(code[1])).is_projected:
                raise Refused(f"generate_crs {code[0]} is no projection", "Set it to a grid.")
        except Refused as error:
            raise self.fail("parameters", error.problem, error.fix) from None
        except CRSError as error:
            raise self.fail("parameters", f"generate_crs: {error}", "Correct it.") from None
        grid = {
            "crs": int(code[1]),
            "easting": 0.0,
            "northing": 0.0,
            "height": 0.0,
            "rotation": 0.0,
        }
        drawn = into_frame(_drawn_places(data["levels"]), WGS84, grid)
        drawn = drawn[np.isfinite(drawn).all(axis=1)]
        if not len(drawn):
            fix = "Give longitudes and latitudes on the grid of generate_crs."
            raise self.fail("levels", f"has no vertex on {code[0]}", fix)
        stated = set(offsets) <= given.keys()
        if not (stated and np.hypot(*np.median(drawn, axis=0) - (x, y)) <= NEAR):
            x, y = lowest(drawn)
        try:
            frame = self.given or on_true_scale(grid | {"easting": x, "northing": y})
            self.notes += scale_note(drawn, code[0])
        except (ValueError, RuntimeError) as error:  # beyond UTM; pyproj
            raise self.fail(
                "parameters", f"generate_crs {code[0]}: {error}", "Correct it."
            ) from None
        (ax, ay), (bx, by) = into_frame(np.array([(x, y), (x + 1, y)]), code[0], frame)
        self.turn = math.atan2(by - ay, bx - ax)
        self.notes.append(
            "coordinates in degrees are brought into the map's frame, with its origin at "
            f"{frame['easting']:.0f}, {frame['northing']:.0f} of EPSG:{frame['crs']}"
        )
        return dict(frame)

    def at(self, x: object, y: object) -> tuple[float, float]:
        """Return a position in the drawing's units, y up; of degrees, in metres."""
        drawn = _number(x, "x"), self.flip * _number(y, "y")
        if self.frame is None:
            return drawn
        moved = into_frame(np.array([drawn]), WGS84, self.frame)
        if not np.isfinite(moved).all():
            raise Refused(f"{drawn} is not on the grid", "Give longitude and latitude.")
        east, north = moved[0].tolist()
        return east, north

    def level(self, name: str, data: object) -> LevelPlan:
        where = f"levels/{name}"
        if not isinstance(data, dict):
            raise self.fail(where, "is not a mapping", "Write the level as key: value pairs.")
        try:
            elevation = _number(data.get("elevation", 0.0), "elevation")
        except Refused as error:
            raise self.fail(f"{where}/elevation", error.problem, error.fix) from None

        def each(key: str, parse: Callable[..., Any]) -> list[Any]:
            """The elements of a list, which may be missing or empty; None for an unusable one."""
            items = [] if data.get(key) in (None, {}) else data[key]
            if not isinstance(items, list):
                raise self.fail(f"{where}/{key}", "is not a list", "Write one element a line.")
            elements = [(f"{where}/{key}[{number}]", item) for number, item in enumerate(items)]
            return [self.use(element, parse, item, element) for element, item in elements]

        def usable(key: str, parse: Callable[..., Any]) -> list[Any]:
            return [found for found in each(key, parse) if found is not None]

        self.vertices = each("vertices", self.vertex)
        fiducials: dict[str, tuple[float, float]] = {}
        for mark, at in usable("fiducials", self.fiducial):
            fiducials.setdefault(mark, at)
        return LevelPlan(
            name,
            elevation,
            self.vertices,
            fiducials,
            usable("measurements", self.edge),
            usable("walls", self.edge),
            usable("doors", self.edge),
            usable("lanes", self.edge),
            usable("floors", self.floor),
            usable("models", self.model),
        )

    def use(self, element: str, parse: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of `parse`, or None, with the reason in `skipped`."""
        try:
            return parse(*arguments)
        except Refused as error:
            self.skipped.append(Skipped(element, error.problem, error.fix))
            return None

    def vertex(self, item: object, _: str) -> Vertex:
        if not isinstance(item, list) or len(item) < 2:
            raise Refused("is not [x, y, z, name]", "Write it as such.")
        name = _text(item[3]) if len(item) > 3 and item[3] is not None else ""
        params = _params(item[4] if len(item) > 4 else None)
        return Vertex(*self.at(item[0], item[1]), name, params)

    def edge(self, item: object, element: str) -> Edge:
        if not isinstance(item, list) or len(item) < 2:
            raise Refused("is not [start, end, parameters]", "Write it as such.")
        start, end = map(self.reference, item[:2])
        params = _params(item[2] if len(item) > 2 else None)
        if isinstance(params.get("graph_idx"), str):
            raise Refused("parameter graph_idx is not a number", "Write [2, 0] for graph 0.")
        return Edge(start, end, params, element)

    def floor(self, item: object, element: str) -> FloorOutline:
        corners = _mapping(item, "it").get("vertices")
        if not isinstance(corners, list) or len(corners) < 3:
            raise Refused("has fewer than three vertices", "Draw the floor as a polygon.")
        return FloorOutline(tuple(map(self.reference, corners)), element)

    def model(self, item: object, element: str) -> RmfModel:
        data = _mapping(item, "it")
        model = _text(data.get("model_name") or data.get("name") or "")
        if not model:
            raise Refused("has no model_name", "Name the model.")
        return RmfModel(
            _text(data.get("name") or model) or model,
            model,
            *self.at(data.get("x"), data.get("y")),
            _number(data.get("z", 0.0), "z"),
            _number(data.get("yaw", 0.0), "yaw") + self.turn,
            bool(data.get("static", True)),
            element,
        )

    def fiducial(self, item: object, _: str) -> tuple[str, tuple[float, float]]:
        if not isinstance(item, list) or len(item) < 3:
            raise Refused("is not [x, y, name]", "Write it as such.")
        return _text(item[2]), self.at(item[0], item[1])

    def reference(self, index: object) -> int:
        if isinstance(index, bool) or not isinstance(index, int):
            raise Refused(f"refers to vertex {index!r}", "Refer by number.")
        if not 0 <= index < len(self.vertices):
            problem = f"refers to vertex {index}, which does not exist"
            raise Refused(problem, "Draw it again between vertices.")
        if self.vertices[index] is None:
            raise Refused(f"refers to vertex {index}, which is unusable", "Correct the vertex.")
        return index

    def lifts(self, data: object, plans: dict[str, LevelPlan], reference: str) -> list[Lift]:
        if not isinstance(data, dict | None):
            raise self.fail("lifts", "is not a mapping", "Write name: {...} for each lift.")
        found = [
            self.use(f"lifts/{name}", self.lift, _text(name), item, plans, reference)
            for name, item in (data or {}).items()
        ]
        return [lift for lift in found if lift is not None]

    def lift(self, name: str, item: object, plans: dict[str, LevelPlan], reference: str) -> Lift:
        data = _mapping(item, "it")
        if not name:
            raise Refused("has no name", "Name the lift.")
        known = f"Name one of {', '.join(plans)}."
        level = _text(data.get("reference_floor_name") or reference)
        if level not in plans:
            raise Refused(f"refers to level {level!r}", known)
        width, depth = (_number(data.get(key), key) for key in ("width", "depth"))
        if width <= 0 or depth <= 0:
            raise Refused(f"measures {width} x {depth} m", "Give it a size above zero.")
        doors: dict[str, LiftDoor] = {}
        for key, value in _mapping(data.get("doors") or {}, "doors").items():
            door = self.use(f"lifts/{name}/doors/{key}", _lift_door, _text(key), value)
            if door is not None:
                doors[_text(key)] = door
        served: dict[str, tuple[str, ...]] = {}
        for key, value in _mapping(data.get("level_doors") or {}, "level_doors").items():
            element = f"lifts/{name}/level_doors/{key}"
            if _text(key) not in plans:
                self.skipped.append(Skipped(element, "is not a level of this building", known))
                continue
            names = [_text(v) for v in value] if isinstance(value, list) else []
            unknown = [n for n in names if n not in doors]
            if unknown:
                problem = f"names doors that the lift does not have: {unknown}"
                self.skipped.append(Skipped(element, problem, "Correct the name."))
            served[_text(key)] = tuple(n for n in names if n in doors)
        if not served:
            raise Refused("serves no level", "Give it doors in the traffic editor.")
        return Lift(
            name,
            *self.at(data.get("x"), data.get("y")),
            _number(data.get("yaw", 0.0), "yaw") + self.turn,
            width,
            depth,
            level,
            _text(data.get("initial_floor_name") or next(iter(served))),
            doors,
            served,
            f"lifts/{name}",
        )


def _lift_door(name: str, item: object) -> LiftDoor:
    data = _mapping(item, "it")
    width = _number(data.get("width"), "width")
    if width <= 0:
        raise Refused(f"is {width} m wide", "Give it a width above zero.")
    yaw = _number(data.get("motion_axis_orientation", 0.0), "motion_axis_orientation")
    x, y = (_number(data.get(key), key) for key in ("x", "y"))
    return LiftDoor(name, x, y, width, yaw, int(_number(data.get("door_type", 0), "door_type")))
