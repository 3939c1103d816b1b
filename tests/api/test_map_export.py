"""Maps as features and files: what import reads back, and what GeoPandas is given."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType
from typing import cast

import pyogrio
import pytest
import shapely

import semmap
from tests.command_line import semmap as semmap_cli

KEYS = ("joins", "state", "direction", "width")


@pytest.fixture
def furnished(flat: semmap.Map) -> semmap.Map:
    flat.add_region("wet", [(5, 2), (6, 2), (6, 3), (5, 3)], type="blocked_region", label="a, b")
    flat.add_agent("robot1", type="robot", size=(0.5, 0.5, 1), pose=(1, 0.6, 0))
    flat.add_object("bare", type="mug")
    flat.add_object("point", pose=(5, 1, 0.5), properties={"a": [1, {"b": None}], "n": 2, "f": 1.5})
    flat.add_door("out", "hall", None, ((8, 1), (8, 1.8)), state="locked", direction="forward")
    return flat


@pytest.mark.parametrize("ending", [".gpkg", ".geojson", ".GeoJSON"])
def test_an_export_is_read_back(
    furnished: semmap.Map, db: semmap.Database, tmp_path: Path, ending: str
) -> None:
    path = furnished.export(tmp_path / f"flat{ending}")
    assert furnished.export(str(path)) == path, "it replaces the file"
    again = db.create_map("again")
    assert again.import_file(path).skipped == []
    assert {p.name for p in tmp_path.iterdir()} == {path.name, "flat_meshes"}
    before = {entity.name: entity for entity in furnished}
    assert {entity.name for entity in again} == before.keys()
    for entity in again:
        old = before[entity.name]
        assert (entity.kind, entity.label) == (old.kind, old.label)
        assert entity.type == old.type or old.type is None
        assert (entity.room and entity.room.name) == (old.room and old.room.name)
        assert entity.properties == old.properties
        one, other = entity.geometry, old.geometry
        if isinstance(entity, semmap.Door) and isinstance(old, semmap.Door):
            assert (entity.state, entity.width) == (old.state, pytest.approx(old.width))
            joins = [e.describe()["joins"] for e in (entity, old)]
            assert len({(j["place_a"], j["place_b"], j["direction"]) for j in joins}) == 1
            assert one.equals_exact(other, 1e-9) or one.reverse().equals_exact(other, 1e-9)
        elif old.kind == "storey" or old.geometry is None:
            assert entity.size is None
        else:
            assert one.hausdorff_distance(other) < 1e-6
            assert entity.box == pytest.approx(old.box, abs=1e-4)
    assert {each.kind for each in again.check()} <= {"without geometry"}


def test_geopackages_have_a_layer_for_each_kind(furnished: semmap.Map, tmp_path: Path) -> None:
    path = furnished.export(tmp_path / "flat.gpkg")
    layers = [name for name, _ in pyogrio.list_layers(path)]
    assert set(layers) == {"storeys", "rooms", "doors", "regions", "objects"}
    assert pyogrio.read_info(path, layer="rooms")["features"] == 2
    assert set(KEYS) <= set(pyogrio.read_info(path, layer="doors")["fields"])


def test_a_georeference_comes_along(furnished: semmap.Map, tmp_path: Path) -> None:
    furnished.execute(
        "UPDATE map SET crs = 32632, easting = 434000, northing = 5792000, height = 70, "
        "rotation = 0.1 WHERE id = current_map()"
    )
    made = json.loads(furnished.export(tmp_path / "flat.geojson").read_text())
    assert made["georeference"]["crs"] == 32632
    assert made["name"] == "flat"


def test_another_ending_is_refused(flat: semmap.Map, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"flat.dxf: a map is exported to .gpkg, .geojson"):
        flat.export(tmp_path / "flat.dxf")
    assert list(tmp_path.iterdir()) == []


def test_an_empty_map_is_exported(db: semmap.Database, tmp_path: Path) -> None:
    path = db.create_map("empty").export(tmp_path / "empty.geojson")
    assert json.loads(path.read_text())["features"] == []
    with pytest.raises(ValueError, match="the map empty has no entities"):
        db.map("empty").export(tmp_path / "empty.gpkg")


def test_features_are_shapelys(flat: semmap.Map) -> None:
    whole = flat.__geo_interface__
    assert [f["properties"]["name"] for f in whole["features"]] == [e.name for e in flat]
    outlines = [shapely.geometry.shape(f["geometry"]) for f in whole["features"]]
    assert all(a.equals(e.geometry) for a, e in zip(outlines, flat, strict=True))


def test_without_geopandas_it_says_how_to_get_it(
    flat: semmap.Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "geopandas", cast(ModuleType, None))
    with pytest.raises(ImportError, match="to_geodataframe needs GeoPandas: pip install geopandas"):
        flat.to_geodataframe()


def test_ls_measures_to_shapes(flat: semmap.Map, database: str) -> None:
    """The command and the method print the same distances."""
    shown = semmap_cli(database, "ls", "--near", "6,1,1", "--json")
    rows = json.loads(shown.stdout)
    assert {row["name"]: row["distance"] for row in rows} == {
        row["name"]: None if row["distance"] is None else float(row["distance"])
        for row in flat.table(near=(6, 1, 1))
    }
    assert "id" not in rows[0]
