"""Worlds on the earth: from SDF's degrees to the UTM grid, against GDAL."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from pyproj import CRS, Transformer
from sqlalchemy import Engine, text

from semmap.ingest.georeference import frame_crs, utm_crs
from semmap.ingest.importer import import_file
from semmap.ingest.sdf.world_file import read_sdf
from semmap.ingest.world import WorldError

OSNABRUECK = (52.2799, 8.0472, 63.5)
SYDNEY = (-33.8688, 151.2093, 5.0)
PLACES = (OSNABRUECK, SYDNEY, (61.5, 23.99, 100.0), (0.5, -179.99, -3.0), (-0.001, 3.0, 0.0))
ROTATION = "SELECT crs, easting, northing, height, rotation FROM map WHERE name = :map"
ROUND = 6_378_137.0
"""The earth's equatorial radius (WGS 84), metres."""


def sdf(folder: Path, said: dict[str, Any] | None, name: str = "site.sdf") -> Path:
    """A world of one box of 4 x 2 m, with the spherical coordinates that are said."""
    elements = "".join(f"<{tag}>{value}</{tag}>" for tag, value in (said or {}).items())
    earth = "" if said is None else f"<spherical_coordinates>{elements}</spherical_coordinates>"
    path = folder / name
    path.write_text(
        f"<sdf version='1.9'><world name='site'>{earth}<model name='crate'><link name='l'>"
        "<visual name='v'><geometry><box><size>4 2 1</size></box></geometry></visual></link>"
        "</model></world></sdf>"
    )
    return path


def degrees(latitude: float, longitude: float, elevation: float, heading: float) -> dict[str, Any]:
    return {
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "elevation": elevation,
        "heading_deg": heading,
    }


def kept(engine: Engine, name: str = "site") -> Any:
    with engine.connect() as connection:
        return connection.execute(text(ROTATION), {"map": name}).one()


@pytest.fixture(scope="session")
def gdaltransform() -> str:
    program = shutil.which("gdaltransform")
    if program is None:
        pytest.skip("gdaltransform is not installed: apt install gdal-bin")
    return program


def gdal(
    program: str, source: str, target: str, points: list[tuple[float, float]]
) -> list[list[float]]:
    """Points (x, y) from one coordinate system to another; CRS84 is longitude, latitude."""
    done = subprocess.run(
        [program, "-s_srs", source, "-t_srs", target],
        input="".join(f"{x!r} {y!r}\n" for x, y in points),
        capture_output=True,
        text=True,
        check=True,
    )
    return [[float(word) for word in line.split()[:2]] for line in done.stdout.splitlines()]


def east_north(origin: tuple[float, float], point: list[float]) -> tuple[float, float]:
    """Metres to the east and north of a place, on the WGS 84 ellipsoid, over short ways."""
    squared = 0.00669437999014  # first eccentricity
    lat = math.radians(origin[0])
    w = 1 - squared * math.sin(lat) ** 2
    normal, meridian = ROUND / math.sqrt(w), ROUND * (1 - squared) / w**1.5
    east = math.remainder(point[0] - origin[1], 360)
    return math.radians(east) * normal * math.cos(lat), math.radians(
        point[1] - origin[0]
    ) * meridian


@pytest.mark.parametrize(
    ("latitude", "longitude", "crs"),
    [
        (52.3, 8.0, 32632),
        (-33.9, 151.2, 32756),
        (0, 0, 32631),
        (-1e-9, 0, 32731),
        (10, 5.999, 32631),
        (10, 6, 32632),
        (10, -180, 32601),
        (10, 180, 32601),
        (10, 179.999, 32660),
        (10, 190, 32602),
        (84, 1, 32631),
        (-80, 1, 32731),
    ],
)
def test_the_zone_of_a_place(latitude: float, longitude: float, crs: int) -> None:
    assert utm_crs(latitude, longitude) == crs


@pytest.mark.parametrize("latitude", [84.01, -80.01, 123.0])
def test_there_is_no_zone_at_the_poles(latitude: float) -> None:
    with pytest.raises(ValueError, match="beyond UTM; give one from -80 to 84"):
        utm_crs(latitude, 8.0)


@pytest.mark.parametrize("place", PLACES)
def test_the_origin_lies_where_gdal_puts_it(
    module_engine: Engine, tmp_path: Path, gdaltransform: str, place: tuple[float, float, float]
) -> None:
    latitude, longitude, elevation = place
    import_file(module_engine, sdf(tmp_path, degrees(*place, 0)), map_name=tmp_path.name)
    crs, easting, northing, height, _ = kept(module_engine, tmp_path.name)
    ((x, y),) = gdal(gdaltransform, "OGC:CRS84", f"EPSG:{crs}", [(longitude, latitude)])
    assert (easting, northing) == pytest.approx((x, y), abs=1e-4)
    assert height == elevation


@pytest.mark.parametrize("heading", [0, 90, -30, 200])
@pytest.mark.parametrize("place", PLACES)
def test_a_heading_turns_the_map_clockwise_from_true_east(
    module_engine: Engine,
    tmp_path: Path,
    gdaltransform: str,
    place: tuple[float, float, float],
    heading: float,
) -> None:
    """100 m along x and along y of the map, through the grid, back onto the earth."""
    import_file(module_engine, sdf(tmp_path, degrees(*place, heading)), map_name=tmp_path.name)
    crs, easting, northing, _, rotation = kept(module_engine, tmp_path.name)
    c, s = 100 * math.cos(rotation), 100 * math.sin(rotation)
    ends = [(easting + c, northing + s), (easting - s, northing + c)]
    x_end, y_end = gdal(gdaltransform, f"EPSG:{crs}", "OGC:CRS84", ends)
    down = math.radians(heading)  # about the downward axis: from north to east is positive
    near = 0.12  # of 100 m the grid's scale takes up to 0.1 %
    assert east_north(place[:2], x_end) == pytest.approx(
        (100 * math.cos(down), -100 * math.sin(down)), abs=near
    )
    assert east_north(place[:2], y_end) == pytest.approx(
        (100 * math.sin(down), 100 * math.cos(down)), abs=near
    )


def test_the_map_lies_on_the_earth_as_gis_programs_see_it(engine: Engine, tmp_path: Path) -> None:
    import_file(engine, sdf(tmp_path, degrees(*OSNABRUECK, 90)))
    with engine.connect() as connection:
        box = connection.execute(
            text("SELECT ST_XMin(geom), ST_YMin(geom), ST_XMax(geom), ST_YMax(geom) FROM gis_earth")
        ).one()
    low, high = (east_north(OSNABRUECK[:2], list(p)) for p in (box[:2], box[2:]))
    assert (*low, *high) == pytest.approx((-1, -2, 1, 2), abs=0.01)  # 4 m of x run to the south


def test_gazebos_default_origin_is_ignored(engine: Engine, tmp_path: Path) -> None:
    import_file(engine, sdf(tmp_path, degrees(0, 0, 0, 0)))
    assert kept(engine) == (None,) * 5


def test_a_georeference_outlasts_a_file_without_one(engine: Engine, tmp_path: Path) -> None:
    import_file(engine, sdf(tmp_path, degrees(*OSNABRUECK, 12)))
    said = kept(engine)
    import_file(engine, sdf(tmp_path, None, "other.sdf"), map_name="site")
    import_file(engine, sdf(tmp_path, degrees(0, 0, 0, 0)), map_name="site")
    assert kept(engine) == said
    import_file(engine, sdf(tmp_path, degrees(*SYDNEY, 12)), map_name="site")
    assert kept(engine).crs == 32756, "the file that gave it states another one now"


def on_grid(folder: Path, name: str, frame: dict[str, float] | None, *corners: Any) -> Path:
    """A storey with a room, drawn in metres of a frame."""
    path = folder / f"{name}.geojson"
    ring = [*corners, corners[0]]
    storey = {"kind": "storey", "name": f"level {name}", "elevation": 2}
    about = {"kind": "room", "name": name, "storey": f"level {name}", "floor": 0.5, "ceiling": 3}
    features = [
        {"type": "Feature", "properties": storey, "geometry": None},
        {
            "type": "Feature",
            "properties": about,
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        },
    ]
    known = {} if frame is None else {"georeference": frame}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features} | known))
    return path


SQUARE = [(0, 0), (5, 0), (5, 4), (0, 4)]
HERE = {"crs": 32632, "easting": 691600.0, "northing": 5334700.0, "height": 520.0, "rotation": 0.3}


def box_of(engine: Engine, name: str, map_name: str) -> Any:
    """The footprint and the heights of an entity in the frame of its map."""
    with engine.connect() as connection:
        return connection.execute(
            text(
                "SELECT ST_AsBinary(w.footprint) AS area, ST_ZMin(w.box) AS low, "
                "ST_ZMax(w.box) AS high FROM world w JOIN entity e ON e.id = w.entity_id "
                "JOIN map m ON m.id = e.map_id WHERE e.name = :name AND m.name = :map"
            ),
            {"name": name, "map": map_name},
        ).one()


@pytest.mark.parametrize("crs", [32632, 25832, 32633])
def test_a_file_with_another_georeference_comes_into_the_maps_frame(
    engine: Engine, tmp_path: Path, crs: int
) -> None:
    """The oracle is pyproj on each corner, and Shapely."""
    east, north = Transformer.from_crs(32632, crs).transform(691640.0, 5334690.0)
    other = {"crs": crs, "easting": east, "northing": north, "height": 523.5, "rotation": -0.5}
    import_file(engine, on_grid(tmp_path, "first", HERE, *SQUARE), map_name="site")
    path = on_grid(tmp_path, "second", other, *SQUARE)
    summary = import_file(engine, path, map_name="site")
    assert any("another georeference" in note for note in summary.notes)
    assert kept(engine) == tuple(HERE.values())
    c, s = math.cos(-0.5), math.sin(-0.5)
    grid = [(east + c * x - s * y, north + s * x + c * y) for x, y in SQUARE]
    grid = [Transformer.from_crs(crs, 32632).transform(*corner) for corner in grid]
    c, s = math.cos(-0.3), math.sin(-0.3)
    away = [(x - HERE["easting"], y - HERE["northing"]) for x, y in grid]
    expected = shapely.Polygon([(c * x - s * y, s * x + c * y) for x, y in away])
    found = box_of(engine, "second", "site")
    # over 5 m, lengths on the next zone differ by 1 cm
    assert shapely.from_wkb(bytes(found.area)).hausdorff_distance(expected) < 0.02
    assert (found.low, found.high) == pytest.approx((6, 8.5))
    with engine.connect() as connection:
        storey = "SELECT elevation FROM gis_storey WHERE name = 'level second'"
        assert connection.execute(text(storey)).scalar_one() == pytest.approx(5.5)
    again = import_file(engine, path, map_name="site")
    assert (again.changed, again.unchanged) == (0, 2)
    assert kept(engine) == tuple(HERE.values())
    assert box_of(engine, "second", "site") == found


def test_a_world_on_the_earth_comes_into_the_frame_of_a_map(engine: Engine, tmp_path: Path) -> None:
    """2 m higher and 200 m north, turned by a right angle; the oracle is a sphere."""
    latitude, longitude, height = OSNABRUECK
    import_file(engine, sdf(tmp_path, degrees(*OSNABRUECK, 0)), map_name="site")
    before = kept(engine)
    north = latitude + math.degrees(200 / 6_376_000)  # the meridian's radius there, by 0.1 %
    other = sdf(tmp_path, degrees(north, longitude, height + 2, 90), "other.sdf")
    import_file(engine, other, map_name="site")
    assert kept(engine) == before
    found = box_of(engine, "crate_2", "site")
    area = shapely.from_wkb(bytes(found.area))
    assert (area.centroid.x, area.centroid.y) == pytest.approx((0, 200), abs=0.5)
    assert np.subtract(area.bounds[2:], area.bounds[:2]) == pytest.approx((2, 4), abs=1e-3)
    assert (found.low, found.high) == pytest.approx((1.5, 2.5))


def test_a_file_far_from_the_map_is_refused(engine: Engine, tmp_path: Path) -> None:
    import_file(engine, on_grid(tmp_path, "first", HERE, *SQUARE), map_name="site")
    far = HERE | {"easting": HERE["easting"] + 50_000}
    with pytest.raises(WorldError, match="is 50 km from that of the map site"):
        import_file(engine, on_grid(tmp_path, "second", far, *SQUARE), map_name="site")
    assert kept(engine) == tuple(HERE.values())


def test_degrees_do_not_give_local_rooms_a_place(engine: Engine, tmp_path: Path) -> None:
    side = 1e-4
    degrees_ = [(11.57 + x * side, 48.14 + y * side) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    path = on_grid(tmp_path, "east", None, *degrees_)
    import_file(engine, on_grid(tmp_path, "local", None, *SQUARE), map_name="site")
    with pytest.raises(WorldError, match="of the earth, but the map site has entities and no geo"):
        import_file(engine, path, map_name="site")
    assert kept(engine) == (None,) * 5
    with engine.connect() as connection:
        names = "SELECT name FROM entity WHERE kind = 'room'"
        assert connection.execute(text(names)).scalars().all() == ["local"]
    import_file(engine, path, map_name="new")
    assert kept(engine, "new").crs == 32632
    import_file(engine, path, map_name="new")
    import_file(engine, on_grid(tmp_path, "local", HERE, *SQUARE), map_name="site")
    east, north = Transformer.from_crs(4326, 32632, always_xy=True).transform(*degrees_[0])
    import_file(engine, path, map_name="site")
    c, s = math.cos(-0.3), math.sin(-0.3)
    x, y = east - HERE["easting"], north - HERE["northing"]
    corner = shapely.Point(c * x - s * y, s * x + c * y)
    area = shapely.from_wkb(bytes(box_of(engine, "east", "site").area))
    assert min(corner.distance(shapely.Point(p)) for p in area.convex_hull.exterior.coords) < 1e-6


@pytest.mark.parametrize(
    ("said", "problem"),
    [
        (degrees(91, 8, 0, 0), "latitude 91° is beyond UTM"),
        (
            {"surface_model": "MOON_SCS", **degrees(10, 8, 0, 0)},
            "MOON_SCS is not the surface of the earth",
        ),
    ],
)
def test_positions_off_the_grid_are_left_out(
    tmp_path: Path, said: dict[str, Any], problem: str
) -> None:
    world = read_sdf(sdf(tmp_path, said))
    assert world.georeference is None
    assert [s.element for s in world.skipped] == ["spherical_coordinates"]
    assert problem in world.skipped[0].problem
    assert len(world.entries) == 1


@pytest.mark.parametrize("crs", [32632, 31467, 2180, 28355])
@pytest.mark.parametrize("rotation", [0.0, 0.7, -2.5])
def test_the_frame_of_a_map_is_a_crs(gdaltransform: str, crs: int, rotation: float) -> None:
    """The oracle is GDAL, which transforms the point on the grid; some grids are north first."""
    grid = CRS(crs)
    area, degrees_of = grid.area_of_use, grid.geodetic_crs
    middle = ((area.west + area.east) / 2, (area.south + area.north) / 2)
    ((easting, northing),) = gdal(
        gdaltransform, f"EPSG:{degrees_of.to_epsg()}", f"EPSG:{crs}", [middle]
    )
    frame = CRS.from_wkt(frame_crs(crs, easting, northing, rotation))
    x, y = 30.0, -12.0
    c, s = math.cos(rotation), math.sin(rotation)
    on_grid = (easting + c * x - s * y, northing + s * x + c * y)
    (expected,) = gdal(gdaltransform, f"EPSG:{crs}", f"EPSG:{degrees_of.to_epsg()}", [on_grid])
    to_degrees = Transformer.from_crs(frame, degrees_of, always_xy=True)
    assert to_degrees.transform(x, y) == pytest.approx(expected, abs=1e-8)
    assert to_degrees.transform(*expected, direction="INVERSE") == pytest.approx((x, y), abs=1e-3)


def test_a_grid_in_degrees_or_feet_gives_no_frame() -> None:
    assert frame_crs(4326, 8.0, 52.0, 0.0) is None
    assert frame_crs(2263, 1e6, 2e5, 0.0) is None
