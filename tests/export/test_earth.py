"""Exports in coordinates of the earth lie where pyproj says, and come back in the map's frame."""

from __future__ import annotations

import json
from pathlib import Path

import geopandas
import numpy as np
import pytest
import shapely
from pyproj import CRS, Transformer

import semmap
from semmap.ingest.georeference import GRIDS
from tests.export.comparison import differences
from tests.export.test_round_trips import come_back

ENDINGS = [".gpkg", ".geojson", ".gml"]

EASTING, NORTHING, ROTATION = 434000.0, 5792000.0, 0.7


@pytest.fixture
def placed(furnished: semmap.Map) -> semmap.Map:
    furnished.execute(
        f"UPDATE map SET crs = 32632, easting = {EASTING}, northing = {NORTHING}, height = 70, "
        f"rotation = {ROTATION} WHERE id = current_map()"
    )
    return furnished


@pytest.mark.parametrize("crs", [None, 4326, "EPSG:32632", 25832])
@pytest.mark.parametrize("ending", ENDINGS)
def test_it_comes_back_in_the_maps_frame(
    placed: semmap.Map, ending: str, crs: int | str | None, tmp_path: Path
) -> None:
    again = come_back(placed, tmp_path / f"flat{ending}", crs=crs)
    assert differences(placed, again) == []
    stated = [
        place.sql(
            "SELECT crs, easting, northing, height, rotation FROM map WHERE id = current_map()"
        )
        for place in (placed, again)
    ]
    assert [*stated[0]] == [*stated[1]]


@pytest.mark.filterwarnings("ignore:Could not parse column:UserWarning")
def test_rooms_lie_where_pyproj_says(placed: semmap.Map, tmp_path: Path) -> None:
    """The corners of a room, turned and moved by hand, then through pyproj."""
    corners = shapely.get_coordinates(placed["kitchen"].geometry)
    turn = np.array([[np.cos(ROTATION), -np.sin(ROTATION)], [np.sin(ROTATION), np.cos(ROTATION)]])
    grid = corners @ turn.T + (EASTING, NORTHING)
    there = Transformer.from_crs(32632, 4326, always_xy=True).transform(*grid.T)
    for ending, layer in ((".gpkg", {"layer": "rooms"}), (".geojson", {})):
        made = geopandas.read_file(placed.export(tmp_path / f"flat{ending}", crs=4326), **layer)
        assert made.crs.to_epsg() == 4326
        kitchen = made.set_index("name").geometry["kitchen"]
        assert kitchen.hausdorff_distance(shapely.Polygon(np.column_stack(there))) < 1e-10
    grid_file = geopandas.read_file(placed.export(tmp_path / "g.gpkg", crs=32632), layer="rooms")
    kitchen = grid_file.set_index("name").geometry["kitchen"]
    assert kitchen.hausdorff_distance(shapely.Polygon(grid)) < 1e-6


@pytest.mark.parametrize("crs", [31468, 27700, 28992, 25832, 2180])
@pytest.mark.filterwarnings("ignore:Could not parse column:UserWarning")
def test_the_database_and_an_export_have_one_place_on_the_earth(
    furnished: semmap.Map, crs: int, tmp_path: Path
) -> None:
    """PostGIS and pyproj, of old datums by the same grids; 1e-10 degrees are 10 um."""
    if not any(Path(folder, "BETA2007.gsb").exists() for folder in GRIDS):
        pytest.skip("PROJ's grids are missing: apt install proj-data")
    area = CRS(crs).area_of_use
    assert area is not None
    middle = ((area.west + area.east) / 2, (area.south + area.north) / 2)
    easting, northing = Transformer.from_crs(4326, crs, always_xy=True).transform(*middle)
    furnished.execute(
        f"UPDATE map SET crs = {crs}, easting = {easting}, northing = {northing}, height = 0, "
        "rotation = 0.4 WHERE id = current_map()"
    )
    shown = furnished.execute("SELECT ST_AsBinary(geom) FROM gis_earth WHERE name = 'kitchen'")
    made = geopandas.read_file(furnished.export(tmp_path / "flat.geojson", crs=4326))
    kitchen = made.set_index("name").geometry["kitchen"]
    assert kitchen.hausdorff_distance(shapely.from_wkb(bytes(shown[0][0]))) < 1e-10


def test_geojson_of_4326_follows_rfc_7946(placed: semmap.Map, tmp_path: Path) -> None:
    made = json.loads(placed.export(tmp_path / "flat.geojson", crs=4326).read_text())
    assert "crs" not in made
    rings = [
        shapely.LinearRing(f["geometry"]["coordinates"][0])
        for f in made["features"]
        if f["geometry"] and f["geometry"]["type"] == "Polygon"
    ]
    assert len(rings) > 4
    assert all(ring.is_ccw for ring in rings)


def test_without_a_georeference_there_is_no_crs(flat: semmap.Map, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="the map flat has no georeference"):
        flat.export(tmp_path / "flat.gpkg", crs=4326)
    with pytest.raises(ValueError, match="crs is 'moon': give an EPSG code"):
        flat.export(tmp_path / "flat.gpkg", crs="moon")
    assert list(tmp_path.iterdir()) == []
