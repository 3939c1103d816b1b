"""Layers opened and edited by a stock client: GDAL's PostgreSQL driver."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Point, Polygon, affinity
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.geometry.pose import Pose
from semmap.ingest.importer import import_file
from semmap.model import Placement, StoredMap, Storey
from tests.model.test_placement import new_map

pytestmark = pytest.mark.skipif(
    shutil.which("ogr2ogr") is None, reason="GDAL's tools are missing (Debian: gdal-bin)"
)


def dsn(engine: Engine) -> str:
    url = engine.url
    host = url.query.get("host", url.host)
    parts = {"dbname": url.database, "host": host, "port": url.port, "user": url.username}
    if url.password:
        parts["password"] = str(url.password)
    return "PG:" + " ".join(f"{k}={v}" for k, v in parts.items() if v) + " schemas=semmap"


def ogr(*arguments: str | Path) -> str:
    done = subprocess.run([*map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def building(engine: Engine) -> str:
    with Session(engine) as session:
        of = new_map(session)
        session.add(Storey(map=of, name="first", placement=Placement(pose=Pose(z=3))))
        session.commit()
        return of.name


def feature(geometry: dict[str, Any], **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def rectangle(x0: float, y0: float, x1: float, y1: float) -> dict[str, Any]:
    ring = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]
    return {"type": "MultiPolygon", "coordinates": [[ring]]}


def append(engine: Engine, layer: str, features: list[dict[str, Any]], folder: Path) -> None:
    path = folder / "features.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": None, "features": features}))
    ogr(
        "ogr2ogr",
        "-append",
        "-f",
        "PostgreSQL",
        dsn(engine),
        path,
        "-nln",
        f"semmap.{layer}",
        "--config",
        "PG_USE_COPY",
        "NO",
    )


def read(engine: Engine, layer: str, building: str, folder: Path) -> list[dict[str, Any]]:
    path = folder / f"{layer}.geojson"
    path.unlink(missing_ok=True)
    ogr(
        "ogr2ogr",
        "-f",
        "GeoJSON",
        "-lco",
        "WRITE_BBOX=NO",
        path,
        dsn(engine),
        f"semmap.{layer}",
        "-where",
        f"map = '{building}'",
    )
    features: list[dict[str, Any]] = json.loads(path.read_text())["features"]
    return features


def test_gdal_sees_key_srid_and_type_of_each_layer(engine: Engine) -> None:
    for layer in ("gis_room", "gis_object", "gis_region"):
        said = ogr("ogrinfo", "-so", dsn(engine), f"semmap.{layer}")
        assert "Geometry: Multi Polygon" in said
        assert "name: String" in said
    with engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT f_table_name, srid, type FROM geometry_columns "
                "WHERE f_table_name LIKE 'gis_%' ORDER BY 1"
            )
        ).all()
    assert [tuple(r) for r in rows] == [
        ("gis_approach_pose", 0, "POINT"),
        ("gis_connector", 0, "LINESTRING"),
        ("gis_earth", 4326, "MULTIPOLYGON"),
        ("gis_object", 0, "MULTIPOLYGON"),
        ("gis_region", 0, "MULTIPOLYGON"),
        ("gis_room", 0, "MULTIPOLYGON"),
        ("gis_storey", 0, "MULTIPOLYGON"),
    ]


def test_a_room_drawn_by_gdal_is_a_room(engine: Engine, building: str, tmp_path: Path) -> None:
    append(
        engine,
        "gis_room",
        [
            feature(
                rectangle(0, 0, 4, 3),
                map=building,
                storey="first",
                name="kitchen1",
                type="room",
                label="kitchen",
                floor=0,
                ceiling=2.5,
            ),
        ],
        tmp_path,
    )
    (room,) = read(engine, "gis_room", building, tmp_path)
    assert room["properties"]["storey"] == "first"
    assert room["geometry"]["type"] == "MultiPolygon"
    with engine.connect() as connection:
        low, high, patches = connection.execute(
            text(
                "SELECT ST_ZMin(w.box), ST_ZMax(w.box), count(f.id) FROM world w "
                "JOIN entity e ON e.id = w.entity_id JOIN map m ON m.id = e.map_id "
                "JOIN fa_to_ob o ON o.ob_id = e.id JOIN face f ON f.id = o.face_id "
                "WHERE m.name = :map AND e.name = 'kitchen1' GROUP BY w.box"
            ),
            {"map": building},
        ).one()
    assert (low, high, patches) == (3.0, 5.5, 1)


def test_a_layer_edited_by_gdal_changes_the_map(
    engine: Engine, building: str, tmp_path: Path
) -> None:
    append(
        engine,
        "gis_object",
        [
            feature(
                rectangle(1, 1, 2, 2), map=building, name="box1", type="object", low=0.2, high=0.8
            ),
            feature(rectangle(5, 1, 6, 2), map=building, name="box2", type="object", low=0, high=1),
        ],
        tmp_path,
    )
    edit = (
        "UPDATE semmap.gis_object SET label = 'crate', geom = ST_Translate(geom, 1, 0.5) "
        f"WHERE name = 'box1' AND map = '{building}'"
    )
    ogr("ogrinfo", "-q", dsn(engine), "-sql", edit)
    ogr(
        "ogrinfo",
        "-q",
        dsn(engine),
        "-sql",
        f"DELETE FROM semmap.gis_object WHERE name = 'box2' AND map = '{building}'",
    )
    (box,) = read(engine, "gis_object", building, tmp_path)
    assert box["properties"]["label"] == "crate"
    assert box["geometry"]["coordinates"][0][0][0] == [2.0, 1.5]
    assert (box["properties"]["low"], box["properties"]["high"]) == (0.2, 0.8)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("geom = 'MULTIPOLYGON(((0 0,4 4,4 0,0 4,0 0)))'", "not valid"),
        ("geom = 'MULTIPOLYGON(((0 0,1e-3 0,1e-3 1e-3,0 0)))'", "has no area"),
        ("name = ''", "needs a name"),
        ("type = 'no_such_type'", "has no type"),
        ("properties = '{broken'", "not JSON"),
        ("ceiling = -1", "not above its floor"),
    ],
)
def test_bad_edits_are_refused_with_a_hint(
    engine: Engine, building: str, tmp_path: Path, change: str, says: str
) -> None:
    append(
        engine,
        "gis_room",
        [
            feature(
                rectangle(0, 0, 4, 3), map=building, name="room1", type="room", floor=0, ceiling=2
            )
        ],
        tmp_path,
    )
    before = read(engine, "gis_room", building, tmp_path)
    with engine.connect() as connection, pytest.raises(DBAPIError, match=says) as refused:
        connection.execute(
            text(f"UPDATE gis_room SET {change} WHERE map = :map"), {"map": building}
        )
    assert "HINT" in str(refused.value)
    assert read(engine, "gis_room", building, tmp_path) == before


def test_a_georeferenced_map_lies_on_the_earth(
    engine: Engine, building: str, tmp_path: Path
) -> None:
    """Osnabrueck's UTM zone; the oracle is GDAL's own transformation."""
    append(
        engine,
        "gis_room",
        [
            feature(
                rectangle(0, 0, 4, 3), map=building, name="room1", type="room", floor=0, ceiling=2
            )
        ],
        tmp_path,
    )
    with Session(engine) as session:
        of = session.query(StoredMap).filter_by(name=building).one()
        of.crs, of.easting, of.northing, of.height, of.rotation = 32632, 434000, 5792000, 70, 0
        session.commit()
    (room,) = read(engine, "gis_earth", building, tmp_path)
    done = subprocess.run(
        ["gdaltransform", "-s_srs", "EPSG:32632", "-t_srs", "OGC:CRS84"],
        input="434000 5792000\n434004 5792003\n",
        capture_output=True,
        text=True,
        check=True,
    )
    corners = [[float(v) for v in line.split()[:2]] for line in done.stdout.splitlines()]
    ring = room["geometry"]["coordinates"][0][0]
    for corner in corners:
        assert min(abs(p[0] - corner[0]) + abs(p[1] - corner[1]) for p in ring) < 1e-6


def test_limits_of_a_door_are_edited_in_its_layer(engine: Engine, building: str) -> None:
    with engine.begin() as connection:
        connection.execute(text("SELECT set_config('semmap.map', :name, true)"), {"name": building})
        rooms = [
            connection.execute(
                text(
                    "INSERT INTO gis_room (map, name, geom) VALUES (:map, :name, "
                    "ST_Multi(ST_MakeEnvelope(:x, 0, :x + 3, 3, 0))) RETURNING fid"
                ),
                {"map": building, "name": f"side{x}", "x": x},
            ).scalar_one()
            for x in (0, 4)
        ]
        door = connection.execute(
            text(
                "INSERT INTO entity (map_id, kind, name) "
                "VALUES (current_map(), 'connector', 'gate') RETURNING id"
            )
        ).scalar_one()
        connection.execute(
            text(
                "INSERT INTO connector (entity_id, place_a, place_b, pose_a, pose_b) "
                "VALUES (:id, :a, :b, '{2,1,0,0,0,0,1}', '{5,1,0,0,0,0,1}')"
            ),
            {"id": door, "a": rooms[0], "b": rooms[1]},
        )
        connection.execute(text("INSERT INTO placement (entity_id) VALUES (:id)"), {"id": door})
        connection.execute(
            text(
                "UPDATE gis_connector SET height = 1.9, step = 0.03, permissions = 'staff, night' "
                "WHERE fid = :id"
            ),
            {"id": door},
        )
        row = connection.execute(
            text("SELECT height, step, permissions FROM connector WHERE entity_id = :id"),
            {"id": door},
        ).one()
        assert tuple(row) == (1.9, 0.03, ["staff", "night"])
        connection.execute(
            text("UPDATE gis_connector SET permissions = NULL WHERE fid = :id"), {"id": door}
        )
        row = connection.execute(
            text("SELECT height, step, permissions FROM connector WHERE entity_id = :id"),
            {"id": door},
        ).one()
        assert tuple(row) == (1.9, 0.03, [])


def placed(engine: Engine, building: str, name: str) -> tuple[list[float], Polygon]:
    """The pose and the footprint of an entity."""
    with engine.connect() as connection:
        pose, footprint = connection.execute(
            text(
                "SELECT w.pose, ST_AsBinary(w.footprint) FROM world w JOIN entity e "
                "ON e.id = w.entity_id JOIN map m ON m.id = e.map_id "
                "WHERE m.name = :map AND e.name = :name"
            ),
            {"map": building, "name": name},
        ).one()
    return pose, shapely.from_wkb(bytes(footprint))


def edit(engine: Engine, statement: str, **values: Any) -> None:
    with engine.begin() as connection:
        connection.execute(text(statement), values)


@settings(max_examples=12)
@given(
    by=st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
    degrees=st.sampled_from([0, 0, 30, 90, -150]),
    layer=st.sampled_from(["gis_object", "gis_region"]),
)
def test_a_drawn_outline_that_moves_takes_its_pose_along(
    module_engine: Engine, by: tuple[float, float], degrees: float, layer: str
) -> None:
    """The oracle is Shapely: pose and outline do one motion, and `move_to` centres it after."""
    engine = module_engine
    with Session(engine) as session:
        building = new_map(session).name
        session.commit()
    shape = Polygon([(1, 1), (3, 1), (3, 2), (2, 2), (2, 4), (1, 4)])
    edit(
        engine,
        f"INSERT INTO {layer} (map, name, type, low, high, geom) VALUES "
        "(:map, 'drawn', NULL, 0, 1, ST_GeomFromText(:wkt))",
        map=building,
        wkt=shapely.MultiPolygon([shape]).wkt,
    )
    before, _ = placed(engine, building, "drawn")
    turned = affinity.rotate(shape, degrees, "centroid")
    moved = affinity.translate(turned, *by)
    edit(
        engine,
        f"UPDATE {layer} SET geom = ST_GeomFromText(:wkt) WHERE map = :map AND name = 'drawn'",
        map=building,
        wkt=shapely.MultiPolygon([moved]).wkt,
    )
    after, outline = placed(engine, building, "drawn")
    origin = affinity.rotate(Point(before[:2]), degrees, shape.centroid)
    origin = affinity.translate(origin, *by)
    assert after[:2] == pytest.approx([origin.x, origin.y], abs=1e-6)
    assert outline.symmetric_difference(moved).area < 1e-3
    edit(
        engine,
        "SELECT move_to(e.id, 4, 3, 0) FROM entity e JOIN map m ON m.id = e.map_id "
        "WHERE m.name = :map AND e.name = 'drawn'",
        map=building,
    )
    _, outline = placed(engine, building, "drawn")
    assert outline.covers(Point(4, 3))


def test_an_object_read_by_gdal_is_imported_with_its_heading(
    engine: Engine, tmp_path: Path
) -> None:
    edit(engine, "INSERT INTO map (name) VALUES ('plain')")
    edit(
        engine,
        "INSERT INTO gis_object (map, name, type, low, high, heading_deg, geom) VALUES "
        "(:map, 'crate', 'object', 0, 1, 45, ST_Multi(ST_MakeEnvelope(30, 0, 32, 1)))",
        map="plain",
    )
    read(engine, "gis_object", "plain", tmp_path)
    import_file(engine, tmp_path / "gis_object.geojson", map_name="read")
    pose, outline = placed(engine, "read", "crate")
    assert Pose(*pose).yaw == pytest.approx(math.radians(45))
    assert outline.symmetric_difference(shapely.box(30, 0, 32, 1)).area < 1e-6


def test_a_reshaped_outline_has_its_pose_inside_and_what_stands_on_it_stays(
    engine: Engine, building: str
) -> None:
    draw = (
        "INSERT INTO gis_object (map, name, low, high, geom) VALUES "
        "(:map, :name, :low, :high, ST_Multi(ST_MakeEnvelope(:x0, 0, :x1, 1)))"
    )
    edit(engine, draw, map=building, name="bench", low=0, high=1, x0=0, x1=1)
    edit(
        engine,
        "UPDATE gis_object SET geom = ST_Multi(ST_MakeEnvelope(5, 0, 9, 1)) "
        "WHERE map = :map AND name = 'bench'",
        map=building,
    )
    pose, outline = placed(engine, building, "bench")
    assert outline.equals(shapely.box(5, 0, 9, 1))
    assert outline.contains(Point(pose[:2]))


def test_doors_are_drawn_moved_and_turned(engine: Engine, building: str) -> None:
    """A door joins the rooms in which its ends lie; in none or one, it is refused."""
    for name, x in (("west", 0), ("middle", 4.2), ("east", 8.4)):
        edit(
            engine,
            "INSERT INTO gis_room (map, storey, name, ceiling, geom) VALUES "
            "(:map, 'first', :name, 2.5, ST_Multi(ST_MakeEnvelope(:x, 0, :x + 4, 4)))",
            map=building,
            name=name,
            x=x,
        )
    draw = (
        "INSERT INTO gis_connector (map, storey, name, width, geom) VALUES "
        "(:map, 'first', 'door1', 1.0, ST_GeomFromText(:line))"
    )
    for line in ("LINESTRING(1 1, 2 1)", "LINESTRING(20 1, 21 1)", "LINESTRING(1 1, 9 1)"):
        with pytest.raises(DBAPIError, match="HINT"):
            edit(engine, draw, map=building, line=line)
    edit(engine, draw, map=building, line="LINESTRING(3.6 1, 4.6 1)")

    def door() -> Any:
        with engine.connect() as connection:
            return connection.execute(
                text(
                    "SELECT place_a, place_b, ST_AsText(geom, 3) AS line, w.pose, d.width, "
                    "ST_AsBinary(w.footprint) AS leaf FROM gis_connector d "
                    "JOIN world w ON w.entity_id = d.fid WHERE map = :map"
                ),
                {"map": building},
            ).one()

    found = door()
    assert (found.place_a, found.place_b) == ("west", "middle")
    assert found.line == "LINESTRING(3.6 1,4.6 1)"
    assert found.pose[2] == 3
    leaf = shapely.from_wkb(bytes(found.leaf))
    assert leaf.symmetric_difference(shapely.box(4.075, 0.5, 4.125, 1.5)).area < 1e-6
    move = "UPDATE gis_connector SET geom = ST_GeomFromText(:line) WHERE map = :map"
    edit(engine, move, map=building, line="LINESTRING(8.0 2, 8.6 2)")
    assert (door().place_a, door().place_b) == ("middle", "east")
    edit(engine, move, map=building, line="LINESTRING(12.8 3.4, 12.2 3.4)")  # begins outside
    found = door()
    assert (found.place_a, found.place_b) == ("east", "outside")
    assert found.line == "LINESTRING(12.2 3.4,12.8 3.4)"
    edit(engine, move, map=building, line="LINESTRING(2 3.6, 2 4.4)")  # turned
    found = door()
    assert (found.place_a, found.place_b) == ("west", "outside")
    assert shapely.from_wkb(bytes(found.leaf)).bounds == pytest.approx((1.5, 3.975, 2.5, 4.025))
