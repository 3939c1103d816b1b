"""Features of GeoJSON and GeoPackage files: geometries in metres, and properties."""

from __future__ import annotations

import contextlib
import json
import math
import sqlite3
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semmap.finite_number import is_finite_number
from semmap.geometry.extent import extent
from semmap.ingest.georeference import (
    WGS84,
    crs_name,
    frame_of,
    into_frame,
    on_true_scale,
    scale_note,
    to_degrees,
)
from semmap.ingest.text_file import read_text
from semmap.ingest.world import Refused, Skipped, WorldError
from semmap.limits import ELEMENTS, EXTENT, NESTING, NO_CHARACTER, TEXT_BYTES, VERTICES

ENDINGS = (".geojson", ".json", ".gpkg")

DEPTHS = {
    "Point": 0,
    "MultiPoint": 1,
    "LineString": 1,
    "MultiLineString": 2,
    "Polygon": 2,
    "MultiPolygon": 3,
}
"""How deep the positions of a GeoJSON geometry are nested."""

STYLE_LAYERS = frozenset({"layer_styles", "qgis_projects"})
"""Tables of a GeoPackage that store how QGIS shows the others."""

CRS_IGNORED = "the CRS is ignored: coordinates are metres of the map's own frame"
"""Of coordinates so near 0 that they are none of a grid of the earth."""

EARTH = 1e8
"""Largest coordinate of a projection of the earth, and largest EPSG code."""

DEGREES = 0.1
"""Outlines within a tenth of a unit are in degrees, not metres: a building is so large."""

SMALL = 0.005
"""Units across of most areas of a file, at most, that is in degrees: of a building of 500 m."""

GEOREFERENCE = ("crs", "easting", "northing", "height", "rotation")
"""The georeference of a file: a foreign member of GeoJSON, metadata of a GeoPackage."""

COORDINATES = "coordinates_crs"
"""The foreign member that names the CRS of coordinates where RFC 7946 allows no member `crs`."""


@dataclass(frozen=True)
class Feature:
    """One feature: `where` names it in messages, `layer` is the layer that contains it.

    Coordinates are in the layer's `crs`, if one is stated, until they are brought into the map's
    frame.
    """

    where: str
    layer: str | None
    geometry: shapely.Geometry | None
    properties: dict[str, Any]
    crs: str | None = None


@dataclass
class FeatureFile:
    """The content of a file; `lost` has the names of the features left out.

    `raised` are the features with a height in coordinates alone; `surveyed` as of `World`.
    """

    features: list[Feature] = field(default_factory=list)
    skipped: list[Skipped] = field(default_factory=list)
    lost: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    georeference: dict[str, float] | None = None
    surveyed: bool = False
    raised: list[str] = field(default_factory=list)

    @contextlib.contextmanager
    def leaving_out(self, where: str, name: object) -> Iterator[None]:
        """Leave out and name a feature that is refused in this block."""
        try:
            yield
        except Refused as refused:
            self.skipped.append(Skipped(where, refused.problem, refused.fix))
            if isinstance(name, str):
                self.lost.add(name)

    def note_raised(
        self, where: str, properties: Mapping[str, Any], heights: Iterable[float]
    ) -> None:
        """Keep in mind a feature whose only height is that of its coordinates."""
        if not properties.keys() & {"floor", "elevation", "pose"} and any(heights):
            self.raised.append(where)


def read_features(path: Path, georeference: Mapping[str, float] | None = None) -> FeatureFile:
    """Return all features of a file, in metres of the map's frame.

    Degrees, and coordinates of a projection of the earth, are brought into the frame of a map with
    a georeference; without one, the file's `georeference` is set to the lowest of them.
    """
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        problem = f"{path.suffix!r} is not the ending of an annotation"
        raise WorldError(path, "ending", problem, f"Known: {', '.join(ENDINGS)}.")
    found = _read_geopackage(path) if ending == ".gpkg" else read_collection(path, parse_json(path))
    return into_metres(path, found, georeference)


def into_metres(
    path: Path, found: FeatureFile, georeference: Mapping[str, float] | None = None
) -> FeatureFile:
    """Bring the coordinates of a file into the map's frame; leave out what is far from it."""
    features, found.features = found.features, []
    for stated in dict.fromkeys(feature.crs for feature in features):
        of_crs = [feature for feature in features if feature.crs == stated]
        drawn = [feature.geometry for feature in of_crs if feature.geometry is not None]
        crs = _crs_of_earth(stated, of_crs, trusted=found.georeference is not None)
        if crs is None and georeference is not None and _are_near(drawn, georeference):
            crs = WGS84
        if crs is not None:
            points = shapely.get_coordinates(drawn)
            try:
                if georeference is None and found.georeference is None:
                    found.georeference = frame_of(_together(points, crs), crs)
                    found.surveyed = True
                    found.notes += scale_note(points, crs)
                frame = found.georeference or georeference
                assert frame is not None
                moved = into_frame(points, crs, frame)
            except (ValueError, RuntimeError) as error:  # beyond UTM; pyproj
                raise WorldError(path, "coordinates", str(error), "Give metres.") from error
            moved[~np.isfinite(moved)] = np.inf  # which equals itself: rings stay closed
            drawn = list(shapely.set_coordinates(np.array(drawn), moved))
            found.notes.append(
                f"coordinates of {crs_name(crs)} are brought into the map's frame, with its origin "
                f"at {frame['easting']:.0f}, {frame['northing']:.0f} of EPSG:{frame['crs']}"
            )
            of_crs = [_turned(feature, frame["rotation"]) for feature in of_crs]
        else:
            _check_metres(path, of_crs)
            if stated is not None and CRS_IGNORED not in found.notes:
                found.notes.append(CRS_IGNORED)
        placed = iter(drawn)
        for feature in of_crs:
            with found.leaving_out(feature.where, feature.properties.get("name")):
                geometry = None if feature.geometry is None else next(placed)
                found.features.append(replace(feature, geometry=_checked(geometry)))
    if found.raised:
        who = found.raised[0] + (f" and {more} more" if (more := len(found.raised) - 1) else "")
        found.notes.append(
            f"{who}: heights in coordinates are ignored: give floor, above the storey, or elevation"
        )
    return found


def _are_things(features: Sequence[Feature]) -> bool:
    """Whether all outlines are of objects that would be larger than a building, as degrees."""
    outlines = [
        (feature.properties.get("kind") or feature.layer, feature.geometry)
        for feature in features
        if feature.geometry is not None and shapely.get_dimensions(feature.geometry) > 0
    ]
    corners = shapely.bounds([geometry for _, geometry in outlines]).reshape(-1, 2, 2)
    return (
        len(outlines) > 0
        and all(kind == "object" for kind, _ in outlines)
        and float(np.median(np.ptp(corners, axis=1).max(axis=1))) > SMALL
    )


def _are_near(drawn: Sequence[shapely.Geometry], georeference: Mapping[str, float]) -> bool:
    """Whether coordinates are the degrees of a place near to the origin of a map on the earth."""
    there = to_degrees(georeference)
    origin = there["longitude_deg"], there["latitude_deg"]
    points = shapely.get_coordinates(drawn)
    return len(points) > 0 and bool((np.abs(points - origin) < DEGREES / 2).all())


def _crs_of_earth(
    stated: str | None, features: Sequence[Feature], trusted: bool = False
) -> str | None:
    """Return the CRS of coordinates on the earth; None if they are of a local frame.

    Outlines of less than a tenth of a degree are degrees, whatever is stated. Of a geographic CRS,
    so are points, and most of them are enough: some may be far by mistake. Of a projection are
    coordinates that are far from its origin. A file with a georeference is `trusted` with its CRS.
    """
    drawn = [f.geometry for f in features if f.geometry is not None and not f.geometry.is_empty]
    if not drawn:
        return None
    outlines = [geometry for geometry in drawn if shapely.get_dimensions(geometry) > 0]
    crs = _crs(stated)
    geographic = crs is not None and crs.is_geographic
    corners = shapely.bounds(outlines or drawn).reshape(-1, 2)
    near = _together(corners, stated)
    corners = near if 2 * len(near) > len(corners) else corners
    (west, south), (east, north) = (each.tolist() for each in extent(corners))
    if trusted and (geographic or (crs is not None and crs.is_projected)):
        return stated
    small = east - west < DEGREES and north - south < DEGREES
    possible = max(abs(west), abs(east)) <= 180 and max(abs(south), abs(north)) <= 90
    if small and possible and (geographic or (outlines and not _are_things(features))):
        return stated if geographic else WGS84
    far = EXTENT.exceeded_by(max(abs(west), abs(east), abs(south), abs(north)))
    return stated if far and crs is not None and crs.is_projected else None


def _check_metres(path: Path, features: Sequence[Feature]) -> None:
    """Refuse degrees that are not recognised as such: as metres, no area would be left."""
    drawn = [each for each in features if isinstance(each.geometry, Polygon | MultiPolygon)]
    bounds = shapely.bounds([each.geometry for each in drawn]).reshape(-1, 4)
    finite = np.flatnonzero(np.isfinite(bounds).all(axis=1))
    corners = bounds[finite].reshape(-1, 2, 2)
    across = np.ptp(corners, axis=1).max(axis=1)
    middle = float(np.median(across)) if len(across) else 0.0
    if not 0 < middle < SMALL or np.abs(corners).max() > 360:
        return
    problem = f"areas of {middle:.2g} units across are in degrees, but"
    north = float(np.abs(corners[..., 1]).max())
    if north > 90:
        fix = "Give longitude before latitude, as RFC 7946 has it, or metres."
        raise WorldError(path, "coordinates", f"{problem} a latitude is {north:.6g}", fix)
    reach = np.ptp(corners, axis=(0, 1))
    problem += f" the file is {reach.max():.3g} degrees across; a map has {DEGREES:g} at most"
    largest = drawn[finite[across.argmax()]].where
    fix = f"Remove what is far away, such as {largest}, or split the file."
    if reach[0] > 180:
        fix = "Buildings on both sides of 180 degrees: give metres, or the coordinates of a grid."
    raise WorldError(path, "coordinates", problem, fix)


def _together(points: NDArray[np.float64], stated: str | None) -> NDArray[np.float64]:
    """Return the points (N, 2) of a geographic CRS that are near their median; of others all."""
    crs = _crs(stated)
    near = (np.abs(points - np.median(points, axis=0)) < DEGREES / 2).all(axis=1)
    return points[near] if crs is not None and crs.is_geographic and near.any() else points


def _crs(stated: str | None) -> Any:
    """The CRS of a text; None where there is none, or where pyproj does not know it."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return None if stated is None else CRS.from_user_input(stated)
    except CRSError:
        return None


def _turned(feature: Feature, rotation: float) -> Feature:
    """A feature whose heading, of the grid, is one of the map's frame."""
    turns = {"heading": rotation, "heading_deg": math.degrees(rotation)}
    turned = {
        key: feature.properties[key] - turn
        for key, turn in turns.items()
        if isinstance(feature.properties.get(key), int | float) and turn
    }
    return replace(feature, properties=feature.properties | turned)


def read_collection(path: Path, root: Any) -> FeatureFile:
    """Return the features of a GeoJSON object as they are drawn."""
    if not isinstance(root, dict) or root.get("type") not in ("FeatureCollection", "Feature"):
        found = root.get("type") if isinstance(root, dict) else type(root).__name__
        fix = "Give a GeoJSON FeatureCollection, as QGIS and ogr2ogr write it."
        raise WorldError(path, "type", f"is {found!r}, not FeatureCollection", fix)
    members = root.get("features") if root["type"] == "FeatureCollection" else [root]
    if not isinstance(members, list):
        raise WorldError(path, "features", "is not an array", "Make it the array of features.")
    out = FeatureFile()
    layer = root.get("name") if isinstance(root.get("name"), str) else None
    named = root.get("crs") or root.get(COORDINATES)
    stated = named.get("properties") if isinstance(named, dict) else named
    crs = str(stated.get("name")) if isinstance(stated, dict) else stated and str(stated)
    _read_georeference(root.get("georeference"), out)
    for number, member in enumerate(members):
        properties = member.get("properties") if isinstance(member, dict) else None
        name = properties.get("name") if isinstance(properties, dict) else None
        where = _place(f"features[{number}]", name)
        with out.leaving_out(where, name):
            if not isinstance(member, dict) or member.get("type") != "Feature":
                raise Refused("is not a Feature", "Make it one, or remove it.")
            if not isinstance(properties, dict | None):
                raise Refused("its properties are not an object", "Make them one.")
            given = checked_properties(
                {k: v for k, v in (properties or {}).items() if v is not None}
            )
            geometry = _geojson_geometry(member.get("geometry"))
            if geometry is not None:
                out.note_raised(where, given, _heights(member["geometry"]["coordinates"]))
            out.features.append(Feature(where, layer, geometry, given, crs))
    return out


def parse_json(path: Path) -> Any:
    """Return the content of a JSON file; a `WorldError` names the place of an error."""
    try:
        return read_json(path, read_text(path))
    except json.JSONDecodeError as error:
        where, problem = f"line {error.lineno}, column {error.colno}", f"is not JSON ({error.msg})"
        fix = "The file may be truncated: restore it, or fix the JSON at this place."
        raise WorldError(path, where, problem, fix) from error
    except RecursionError as error:
        raise WorldError(path, "file", "is nested too deeply", "Give a GeoJSON file.") from error
    except ValueError as error:
        raise WorldError(path, "file", f"is not JSON ({error})", "Correct the number.") from error


def read_json(path: Path, text: str) -> Any:
    """Return the content of the text of a file; a list of three bytes takes 64 in memory."""
    values = text.count("[") + text.count("{")
    ELEMENTS.check(values, partial(WorldError, path, "file"), "Split it into several files.")
    return json.loads(text)


def _geojson_geometry(geometry: object) -> shapely.Geometry | None:
    if geometry is None:
        return None
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(geometry, dict) or not isinstance(kind, str) or kind not in DEPTHS:
        raise Refused(f"has a geometry of type {kind!r}", f"Use one of {', '.join(DEPTHS)}.")
    coordinates = _positions(geometry.get("coordinates"), DEPTHS[kind])
    try:
        made: shapely.Geometry = shapely.geometry.shape({"type": kind, "coordinates": coordinates})
    except (
        ValueError,
        TypeError,
        IndexError,
        OverflowError,
        shapely.errors.ShapelyError,
    ) as error:
        raise Refused(f"is not a valid {kind} ({error})", "Draw it again.") from error
    return made


def _positions(coordinates: object, depth: int) -> list[Any]:
    """Return positions as pairs of numbers, nested: heights are properties."""
    if not isinstance(coordinates, list):
        raise Refused("its coordinates are not nested as its type requires", "Draw it again.")
    if depth:
        return [_positions(inner, depth - 1) for inner in coordinates]
    numbers = [c for c in coordinates if isinstance(c, int | float) and not isinstance(c, bool)]
    if len(numbers) != len(coordinates) or len(numbers) < 2:
        raise Refused(f"has the position {str(coordinates)[:60]}", "Give two or three numbers.")
    if max(map(abs, numbers)) > EARTH:  # none of the earth either
        _check_range(numbers)
    return numbers[:2]


def _heights(coordinates: list[Any]) -> Iterator[float]:
    """Yield the third numbers of positions."""
    if coordinates and not isinstance(coordinates[0], list):
        yield from coordinates[2:3]
    else:
        for inner in coordinates:
            yield from _heights(inner)


def _checked(geometry: shapely.Geometry | None) -> shapely.Geometry | None:
    if geometry is None:
        return None
    _check_range(shapely.get_coordinates(geometry).ravel())
    VERTICES.check(shapely.get_num_coordinates(geometry), Refused, "Simplify it.")
    return None if geometry.is_empty else geometry


def _check_range(numbers: list[Any] | NDArray[np.float64]) -> None:
    for number in numbers:
        if EXTENT.exceeded_by(abs(number)):
            raise Refused(
                f"has {str(number)[:20]}, which is too large for a local frame",
                f"Draw it within {EXTENT.value:,.0f} m of the map's origin, in metres. "
                f"{EXTENT.variable} raises the limit.",
            )


def _read_georeference(given: object, out: FeatureFile) -> None:
    """Read the foreign member that places the map on the earth (see the table `map`)."""
    if given is None:
        return
    with out.leaving_out("georeference", None):
        if not isinstance(given, dict) or set(given) != set(GEOREFERENCE):
            raise Refused("is not complete", f"Give the numbers {', '.join(GEOREFERENCE)}.")
        for key, value in given.items():
            if not is_finite_number(value) or abs(value) > EARTH:
                raise Refused(f"{key} is {value!r}", "Give a number.")
        try:
            out.georeference = on_true_scale(given)
        except (ValueError, RuntimeError) as error:  # beyond UTM; pyproj
            raise Refused(f"is on no grid ({error})", "Give it on that of UTM.") from error
        if out.georeference != given:
            origin = np.array([[given["easting"], given["northing"]]])
            out.notes += scale_note(origin, f"EPSG:{given['crs']}")


def _read_geopackage(path: Path) -> FeatureFile:
    _check_sqlite(path)
    out = FeatureFile()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GDAL's remarks on the CRS, which is not used
        try:
            _read_metadata(path, out)
            for layer in _layers(path):
                _read_layer(path, layer, out)
        except (RuntimeError, ValueError) as error:
            raise _not_a_geopackage(path, error) from error
    return out


def _layers(path: Path) -> list[str]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of columns that no layer has
        names = [str(name) for name, _ in pyogrio.list_layers(path)]
    return [name for name in names if name not in STYLE_LAYERS]


def _read_metadata(path: Path, out: FeatureFile) -> None:
    layers = pyogrio.list_layers(path)
    about = pyogrio.read_info(path, layer=layers[0][0])["dataset_metadata"] if len(layers) else None
    if about and "georeference" in about:
        _read_georeference(json.loads(about["georeference"]), out)


_COMPUTED = """
SELECT m.name FROM sqlite_master m WHERE m.type = 'view'
UNION SELECT m.name FROM sqlite_master m, pragma_table_xinfo(m.name) c
WHERE m.type = 'table' AND m.sql NOT LIKE 'CREATE VIRTUAL%' AND c.hidden = 2
"""
"""The views, and the tables with columns that are calculated: a small file would unfold to much."""


def _check_sqlite(path: Path) -> None:
    """Refuse a damaged file: GDAL would read a part of it."""
    if not path.is_file():
        raise WorldError(path, "file", "is not there", "Check the path.")
    refused = partial(WorldError, path, "file")
    TEXT_BYTES.check(path.stat().st_size, refused, "Export the layers of the building alone.")
    address = f"{path.resolve().as_uri()}?mode=ro"
    try:
        with contextlib.closing(sqlite3.connect(address, uri=True)) as database:
            found = database.execute("PRAGMA quick_check(1)").fetchone()[0]
            _refuse_computed(database, path, ["gpkg_contents"])
            layers = _layers(path)  # also those that are not in gpkg_contents
            _refuse_computed(database, path, layers)
            quoted = (layer.replace('"', '""') for layer in layers)
            rows = (database.execute(f'SELECT count(*) FROM "{q}"').fetchone()[0] for q in quoted)
            ELEMENTS.check(sum(rows), refused, "Split it into several files.")
    except (sqlite3.Error, RuntimeError, ValueError) as error:
        if isinstance(error, WorldError):
            raise
        raise _not_a_geopackage(path, error) from error
    if found != "ok":
        raise _not_a_geopackage(path, found)


def _refuse_computed(database: sqlite3.Connection, path: Path, layers: Iterable[str]) -> None:
    computed = {str(name).lower() for (name,) in database.execute(_COMPUTED)}
    for layer in layers:
        if layer.lower() in computed:
            problem = f"the table {layer} is computed by a query"
            raise WorldError(path, "database", problem, "Export it as a table of values.")


def _not_a_geopackage(path: Path, problem: object) -> WorldError:
    return WorldError(
        path,
        "database",
        f"is not a readable GeoPackage ({' '.join(str(problem).split())})",
        "It may be truncated: restore it, or export it from QGIS again.",
    )


def _read_layer(path: Path, layer: str, out: FeatureFile) -> None:
    meta, fids, wkb, columns = pyogrio.raw.read(path, layer=layer, return_fids=True)
    kinds = list(zip(meta["fields"], meta["ogr_types"], meta["ogr_subtypes"], strict=True))
    for row, fid in enumerate(fids):
        given = {
            str(key): value
            for (key, type_, subtype), column in zip(kinds, columns, strict=True)
            if (value := _plain(column[row], type_, subtype)) is not None
        }
        name = given.get("name")
        where = _place(f"{layer}/{fid}", name)
        with out.leaving_out(where, name):
            checked = checked_properties(given)
            geometry = _wkb_geometry(None if wkb is None else wkb[row])
            if shapely.has_z(geometry):
                heights = shapely.get_coordinates(geometry, include_z=True)[:, 2]
                out.note_raised(where, checked, np.nan_to_num(heights))
                geometry = shapely.force_2d(geometry)
            out.features.append(Feature(where, layer, geometry, checked, meta.get("crs") or None))


def _wkb_geometry(wkb: bytes | None) -> shapely.Geometry | None:
    if wkb is None:
        return None
    try:
        geometry: shapely.Geometry = shapely.from_wkb(wkb)
    except shapely.errors.ShapelyError as error:
        raise Refused(f"has a geometry that cannot be read ({error})", "Draw it again.") from error
    return geometry


def _plain(value: Any, ogr_type: str, subtype: str) -> Any:
    """Return a column's value as JSON has it; None for an empty cell."""
    if isinstance(value, np.datetime64):
        return None if np.isnat(value) else str(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and math.isnan(value):
        return None
    if subtype == "OFSTBoolean" and value is not None:
        return bool(value)
    if isinstance(value, float) and ogr_type in ("OFTInteger", "OFTInteger64"):
        return int(value)  # a column with nulls comes as floats
    if isinstance(value, bytes):
        return value.hex()
    return value


def _place(where: str, name: object) -> str:
    return where if name is None else f"{where} ({name})"


def checked_property(value: Any, key: str) -> Any:
    """Return a property that the map can keep; text that holds a JSON object or array is parsed."""
    if isinstance(value, str) and value[:1] in ("{", "["):
        with contextlib.suppress(ValueError, RecursionError):
            value = json.loads(value)
    for text in (key, *_texts(value, key)):
        if NO_CHARACTER.search(text):
            raise Refused(f"{key!a} holds a character that is not valid in text", "Remove it.")
    return value


def checked_properties(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return properties that the map can keep."""
    return {key: checked_property(value, key) for key, value in given.items()}


def _texts(value: Any, key: str, depth: int = 0) -> Iterator[str]:
    """Yield all texts in a value; refuse a number that is not finite."""
    if NESTING.exceeded_by(depth):
        raise Refused(f"{key!a} is nested too deeply", "Make it flatter.")
    if isinstance(value, str):
        yield value
    elif isinstance(value, float) and not math.isfinite(value):
        raise Refused(f"{key!a} is {value}", "Give a finite number, or leave it out.")
    elif isinstance(value, list):
        for inner in value:
            yield from _texts(inner, key, depth + 1)
    elif isinstance(value, dict):
        for name, inner in value.items():
            yield name
            yield from _texts(inner, key, depth + 1)
