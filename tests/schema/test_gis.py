"""Layers opened and edited by a stock client: GDAL's PostgreSQL driver."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session

from semmap.geometry.pose import Pose
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
