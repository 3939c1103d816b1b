"""Features of GeoJSON and GeoPackage files: geometries in metres, and properties."""

from __future__ import annotations

import contextlib
import json
import math
import sqlite3
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray

from semmap.ingest.world import Refused, Skipped, WorldError
from semmap.limits import EXTENT, NESTING, TEXT_BYTES, VERTICES

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

EARTH = 1e8
"""Largest coordinate of a projection of the earth, and largest EPSG code."""

DEGREES = 0.1
"""Coordinates whose extent is smaller are not metres."""

GEOREFERENCE = ("crs", "easting", "northing", "height", "rotation")


@dataclass(frozen=True)
class Feature:
    """One feature: `where` names it in messages, `layer` is the layer that contains it."""

    where: str
    layer: str | None
    geometry: shapely.Geometry | None
    properties: dict[str, Any]


@dataclass
class FeatureFile:
    """The content of a file; `lost` has the names of the features left out."""

    features: list[Feature] = field(default_factory=list)
    skipped: list[Skipped] = field(default_factory=list)
    lost: set[str] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    georeference: dict[str, object] | None = None

    def skip(self, feature_name: object, where: str, refused: Refused) -> None:
        """Record a feature that is left out."""
        self.skipped.append(Skipped(where, refused.problem, refused.fix))
        if isinstance(feature_name, str):
            self.lost.add(feature_name)


def read_features(path: Path) -> FeatureFile:
    """Return all features of a file; coordinates are metres of the map, whatever CRS is stated.

    A WorldError refuses one that is not there, is malformed, or is neither GeoJSON nor GeoPackage.
    """
    if path.suffix.lower() not in ENDINGS:
        known = ", ".join(ENDINGS)
        raise WorldError(
            path,
            "ending",
            f"{path.suffix!r} is not the ending of an annotation",
            f"Known: {known}.",
        )
    read = _read_geopackage if path.suffix.lower() == ".gpkg" else _read_geojson
    try:
        found = read(path)
    except OSError as error:
        raise WorldError(
            path, "file", f"cannot be read ({error.strerror})", "Check path and permissions."
        ) from error
    _check_metres(path, found)
    return found


def _check_metres(path: Path, found: FeatureFile) -> None:
    """Refuse coordinates in degrees: a whole building lies within a tenth of one."""
    drawn = [f.geometry for f in found.features if f.geometry is not None]
    outlines = [g for g in drawn if shapely.get_dimensions(g) > 0 and not g.is_empty]
    if not outlines:
        return
    west, south, east, north = map(float, shapely.total_bounds(outlines))
    small = east - west < DEGREES and north - south < DEGREES
    if not small or max(abs(west) / 180, abs(north) / 90) > 1:
        return
    raise WorldError(
        path,
        "coordinates",
        f"all outlines lie within {east - west:.2g} x {north - south:.2g}: they are degrees, not "
        "metres",
        "Give metres of the map's own frame, for example by ogr2ogr -t_srs '+proj=aeqd "
        f"+lat_0={south:.6f} +lon_0={west:.6f}' metres.geojson {path.name}",
    )


# -- GeoJSON (RFC 7946) -----------------------------------------------------------------------


def _read_geojson(path: Path) -> FeatureFile:
    root = parse_json(path)
    if not isinstance(root, dict) or root.get("type") not in ("FeatureCollection", "Feature"):
        found = root.get("type") if isinstance(root, dict) else type(root).__name__
        raise WorldError(
            path,
            "type",
            f"is {found!r}, not FeatureCollection",
            "Give a GeoJSON FeatureCollection, as QGIS and ogr2ogr write it.",
        )
    members = root.get("features") if root["type"] == "FeatureCollection" else [root]
    if not isinstance(members, list):
        raise WorldError(path, "features", "is not an array", "Make it the array of features.")
    out = FeatureFile()
    layer = root.get("name") if isinstance(root.get("name"), str) else None
    if root.get("crs") is not None:
        out.notes.append("the CRS is ignored: coordinates are metres of the map's own frame")
    _read_georeference(root.get("georeference"), out)
    for number, member in enumerate(members):
        properties = member.get("properties") if isinstance(member, dict) else None
        name = properties.get("name") if isinstance(properties, dict) else None
        where = f"features[{number}]" + (f" ({name})" if name is not None else "")
        try:
            if not isinstance(member, dict) or member.get("type") != "Feature":
                raise Refused("is not a Feature", "Make it one, or remove it.")
            if not isinstance(properties, dict | None):
                raise Refused("its properties are not an object", "Make them one.")
            given = {
                k: checked_property(v, k) for k, v in (properties or {}).items() if v is not None
            }
            geometry = _geojson_geometry(member.get("geometry"))
            out.features.append(Feature(where, layer, geometry, given))
        except Refused as refused:
            out.skip(name, where, refused)
    return out


def parse_json(path: Path) -> Any:
    """Return the content of a JSON file; a `WorldError` names the place of an error."""
    try:
        TEXT_BYTES.check(
            path.stat().st_size, partial(WorldError, path, "file"), "Split it into several files."
        )
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as error:
        raise WorldError(
            path, f"byte {error.start}", "is not UTF-8", "Save it as UTF-8."
        ) from error
    except json.JSONDecodeError as error:
        raise WorldError(
            path,
            f"line {error.lineno}, column {error.colno}",
            f"is not JSON ({error.msg})",
            "The file may be truncated: restore it, or fix the JSON at this place.",
        ) from error
    except RecursionError as error:
        raise WorldError(path, "file", "is nested too deeply", "Give a GeoJSON file.") from error
    except ValueError as error:
        raise WorldError(path, "file", f"is not JSON ({error})", "Correct the number.") from error


def _geojson_geometry(geometry: object) -> shapely.Geometry | None:
    if geometry is None:
        return None
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if not isinstance(geometry, dict) or not isinstance(kind, str) or kind not in DEPTHS:
        raise Refused(f"has a geometry of type {kind!r}", f"Use one of {', '.join(DEPTHS)}.")
    coordinates = geometry.get("coordinates")
    _check_positions(coordinates, DEPTHS[kind])
    try:
        made: shapely.Geometry = shapely.geometry.shape(
            {"type": kind, "coordinates": _flattened(coordinates, DEPTHS[kind])}
        )
    except (ValueError, TypeError, IndexError, shapely.errors.ShapelyError) as error:
        raise Refused(f"is not a valid {kind} ({error})", "Draw it again.") from error
    VERTICES.check(shapely.get_num_coordinates(made), Refused, "Simplify it.")
    return None if made.is_empty else made


def _check_positions(coordinates: object, depth: int) -> None:
    if not isinstance(coordinates, list):
        raise Refused("its coordinates are not nested as its type requires", "Draw it again.")
    if depth:
        for inner in coordinates:
            _check_positions(inner, depth - 1)
        return
    numbers = [c for c in coordinates if isinstance(c, int | float) and not isinstance(c, bool)]
    if len(numbers) != len(coordinates) or len(numbers) < 2:
        raise Refused(f"has the position {str(coordinates)[:60]}", "Give two or three numbers.")
    _check_range(numbers)


def _check_range(numbers: list[Any] | NDArray[np.float64]) -> None:
    for number in numbers:
        if EXTENT.exceeded_by(abs(number)):
            raise Refused(
                f"has {str(number)[:20]}, which is too large for a local frame",
                f"Draw it within {EXTENT.value:,.0f} m of the map's origin, in metres. "
                f"{EXTENT.variable} raises the limit.",
            )


def _flattened(coordinates: Any, depth: int) -> Any:
    """Return positions as pairs: heights are properties."""
    return [_flattened(c, depth - 1) for c in coordinates] if depth else coordinates[:2]


def _read_georeference(given: object, out: FeatureFile) -> None:
    """Read the foreign member that places the map on the earth (see the table `map`)."""
    if given is None:
        return
    try:
        if not isinstance(given, dict) or set(given) != set(GEOREFERENCE):
            raise Refused("is not complete", f"Give the numbers {', '.join(GEOREFERENCE)}.")
        for key, value in given.items():
            if not isinstance(value, int | float) or not abs(value) <= EARTH:
                raise Refused(f"{key} is {value!r}", "Give a number.")
        out.georeference = dict(given)
    except Refused as refused:
        out.skip(None, "georeference", refused)


# -- GeoPackage (OGC 12-128) ------------------------------------------------------------------


def _read_geopackage(path: Path) -> FeatureFile:
    _check_sqlite(path)
    out = FeatureFile()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GDAL's remarks on the CRS, which is not used
        try:
            layers = [str(name) for name, _ in pyogrio.list_layers(path)]
            for layer in layers:
                if layer not in STYLE_LAYERS:
                    _read_layer(path, layer, out)
        except (RuntimeError, ValueError) as error:
            _not_a_geopackage(path, str(error), error)
    return out


def _check_sqlite(path: Path) -> None:
    """Refuse a damaged file: GDAL would read a part of it."""
    if not path.is_file():
        raise WorldError(path, "file", "is not there", "Check the path.")
    try:
        with contextlib.closing(
            sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
        ) as database:
            found = database.execute("PRAGMA quick_check(1)").fetchone()[0]
            database.execute("SELECT count(*) FROM gpkg_contents").fetchone()
    except sqlite3.Error as error:
        _not_a_geopackage(path, str(error), error)
    if found != "ok":
        _not_a_geopackage(path, str(found), None)


def _not_a_geopackage(path: Path, problem: str, cause: Exception | None) -> NoReturn:
    raise WorldError(
        path,
        "database",
        f"is not a readable GeoPackage ({' '.join(problem.split())})",
        "It may be truncated: restore it, or export it from QGIS again.",
    ) from cause


def _read_layer(path: Path, layer: str, out: FeatureFile) -> None:
    meta, fids, wkb, columns = pyogrio.raw.read(path, layer=layer, return_fids=True)
    if meta.get("crs"):
        note = "the CRS is ignored: coordinates are metres of the map's own frame"
        if note not in out.notes:
            out.notes.append(note)
    kinds = list(zip(meta["fields"], meta["ogr_types"], meta["ogr_subtypes"], strict=True))
    for row, fid in enumerate(fids):
        given = {
            str(key): value
            for (key, type_, subtype), column in zip(kinds, columns, strict=True)
            if (value := _plain(column[row], type_, subtype)) is not None
        }
        name = given.get("name")
        where = f"{layer}/{fid}" + (f" ({name})" if name is not None else "")
        try:
            checked = {k: checked_property(v, k) for k, v in given.items()}
            geometry = _wkb_geometry(None if wkb is None else wkb[row])
            out.features.append(Feature(where, layer, geometry, checked))
        except Refused as refused:
            out.skip(name, where, refused)


def _wkb_geometry(wkb: bytes | None) -> shapely.Geometry | None:
    if wkb is None:
        return None
    try:
        geometry = shapely.force_2d(shapely.from_wkb(wkb))
    except shapely.errors.ShapelyError as error:
        raise Refused(f"has a geometry that cannot be read ({error})", "Draw it again.") from error
    _check_range(shapely.get_coordinates(geometry).ravel())
    VERTICES.check(shapely.get_num_coordinates(geometry), Refused, "Simplify it.")
    return None if geometry.is_empty else geometry


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


# -- Both -------------------------------------------------------------------------------------


def checked_property(value: Any, key: str) -> Any:
    """Return a property that the map can keep; text that holds a JSON object or array is parsed."""
    if isinstance(value, str) and value[:1] in ("{", "["):
        with contextlib.suppress(ValueError, RecursionError):
            value = json.loads(value)
    for text in (key, *_texts(value, key)):
        if "\x00" in text or any("\ud800" <= c <= "\udfff" for c in text):
            raise Refused(f"{key!a} holds a character that is not valid in text", "Remove it.")
    return value


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
