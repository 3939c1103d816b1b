"""A project opened, drawn and edited by QGIS itself, through its own PostgreSQL provider.

Skipped where the system's Python has no PyQGIS (Debian: python3-qgis, qgis-providers).
"""

from __future__ import annotations

import json
import os
import subprocess
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from PIL import Image
from shapely import affinity

import semmap
from tests.conftest import PASSWORD, Import

PYTHON = "/usr/bin/python3"
PROGRAM = Path(__file__).with_name("qgis_program.py")
OFFICE = Path(__file__).parents[3] / "examples" / "office"

with_qgis = pytest.mark.skipif(
    not Path(PYTHON).exists()
    or subprocess.run(
        [PYTHON, "-c", "import qgis.core"], capture_output=True, check=False
    ).returncode
    != 0,
    reason="PyQGIS is missing (Debian: python3-qgis qgis-providers)",
)


def qgis(folder: Path, host: str = "", **wanted: Any) -> dict[str, Any]:
    """What QGIS did with a project; an address of one has no socket's folder as `host`."""
    runtime = folder / "runtime"
    runtime.mkdir(mode=0o700, exist_ok=True)
    done = subprocess.run(
        [PYTHON, PROGRAM],
        input=json.dumps(wanted),
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "XDG_RUNTIME_DIR": str(runtime), "PYTHONPATH": "", "PGHOST": host},
        timeout=300,
    )
    assert done.stdout.strip(), done.stderr
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def address(engine: Any) -> str:
    return str(engine.url.render_as_string(hide_password=False))


@pytest.fixture(scope="module")
def office_files() -> Sequence[tuple[Path, str]]:
    return [(OFFICE / name, "office") for name in ("office_rooms.geojson", "office.sdf")]


@pytest.fixture
def office(imported: Import, office_files: Sequence[tuple[Path, str]]) -> Iterator[semmap.Map]:
    with imported(*office_files) as engine, semmap.connect(address(engine)) as database:
        yield database.map("office")


def check_pictures(house: semmap.Map, folder: Path) -> dict[str, Any]:
    """All layers are valid, and the pictures show walls where the map has them."""
    answer = qgis(
        folder, project=str(house.write_qgis_project(folder / "p.qgz")), pictures=str(folder)
    )
    assert answer["layers"]
    assert all(layer["valid"] for layer in answer["layers"]), answer["layers"]
    ((grid,),) = house.execute("SELECT crs FROM map WHERE id = current_map()")
    assert answer["crs"] == (grid is not None)
    assert set(answer["pictures"]) == ({s.name for s in house.storeys} or {"on no storey"})
    for path in answer["pictures"].values():
        shades = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3)
        dark = (np.abs(shades.astype(int) - (0x34, 0x3A, 0x46)).sum(axis=1) < 12).mean()
        assert dark < 0.35, "walls, not blocks"
    return answer


@with_qgis
def test_a_project_opens_with_valid_layers_and_draws_each_storey(
    office: semmap.Map, tmp_path: Path
) -> None:
    answer = check_pictures(office, tmp_path)
    counts: dict[str, int] = {}
    for layer in answer["layers"]:
        counts[layer["name"]] = counts.get(layer["name"], 0) + layer["features"]
        assert layer["name"] == "types" or layer["widgets"]["type"] == "ValueRelation"
        for title, offered, other in (("rooms", "kitchen", "chair"), ("objects", "chair", "door")):
            if layer["name"] == title:
                assert offered in layer["choices"]
                assert other not in layer["choices"]
    assert counts["rooms"] == len(office.rooms)
    assert counts["doors"] == len(office.doors)
    assert counts["objects"] + counts["walls"] == len(office.objects)
    assert counts["storeys"] == len(office.storeys) == len(answer["pictures"])
    for path in answer["pictures"].values():
        shades = np.asarray(Image.open(path).convert("RGB")).reshape(-1, 3)
        dark = (np.abs(shades.astype(int) - (0x34, 0x3A, 0x46)).sum(axis=1) < 12).mean()
        assert dark > 0.02, "walls are drawn"


@with_qgis
@pytest.mark.parametrize(
    "world",
    [
        "small_house/worlds/small_house.world",
        "rmf/hotel/hotel.building.yaml",
        "ifc/Duplex_A_20110907.ifc",
    ],
)
def test_worlds_of_others_open_and_draw(
    imported: Import, worlds: Path, world: str, tmp_path: Path
) -> None:
    if world.endswith(".ifc"):
        pytest.importorskip("ifcopenshell")
    with (
        imported((worlds / world, "building")) as engine,
        semmap.connect(address(engine)) as database,
    ):
        check_pictures(database.map("building"), tmp_path)


@with_qgis
def test_a_georeferenced_map_is_edited_where_it_lies_on_the_earth(
    office: semmap.Map, tmp_path: Path
) -> None:
    """The oracle is PostGIS; edits stay in metres of the map's frame."""
    office.execute(
        "UPDATE map SET crs = 32632, easting = 434000, northing = 5792000, height = 0, "
        "rotation = 0.5"
    )
    edits = [{"storey": "floor-1st", "layer": "objects", "name": "sofa1", "move": [0.5, 0.25]}]
    path = office.write_qgis_project(tmp_path / "office.qgz")
    before = office["sofa1"].pose
    answer = qgis(tmp_path, project=str(path), pictures=str(tmp_path), edits=edits)
    assert answer["errors"] == [[]]
    assert all(each["crs"] for each in answer["layers"] if each["name"] != "types")
    ((expected,),) = office.execute(
        "SELECT ARRAY[ST_X(p), ST_Y(p)] FROM (SELECT on_earth(ST_MakePoint(10, 5), "
        "current_map())) e (p)"
    )
    assert answer["on_earth"] == pytest.approx(expected, abs=1e-9)
    after = office["sofa1"].pose
    assert (after.x - before.x, after.y - before.y) == pytest.approx((0.5, 0.25))


@with_qgis
def test_edits_in_qgis_are_edits_of_the_map(office: semmap.Map, tmp_path: Path) -> None:
    """The oracle of moves is Shapely; QGIS turns clockwise."""
    desk, sofa, walls = (office[name] for name in ("desk2", "sofa1", "walls-1st"))
    before = {each.name: each.footprint for each in (desk, sofa)}
    heading = desk.pose.yaw
    on_desk = {name: office[name].pose for name in (e.name for e in desk.contents)}
    first = "floor-1st"
    edits = [
        {"storey": first, "layer": "objects", "name": "sofa1", "move": [0.5, 0.25]},
        {"storey": first, "layer": "objects", "name": "desk2", "turn": -30},
        {"storey": first, "layer": "objects", "name": "chair5", "values": {"heading_deg": 33.0}},
        {"storey": first, "layer": "objects", "name": "sofa1", "values": {"type": "armchair"}},
        {"storey": first, "layer": "walls", "name": "walls-1st", "move": [0.0, 0.001]},
        {
            "storey": first,
            "layer": "doors",
            "draw": "LineString(10.5 1.5, 10.5 1.5)",
            "values": {"name": "nowhere"},
        },
        {
            "storey": first,
            "layer": "doors",
            "draw": "LineString(9.9 2, 11.1 2)",
            "values": {"name": "through", "state": "closed", "width": 1.1},
        },
        {
            "storey": first,
            "layer": "rooms",
            "draw": "MultiPolygon(((20 0, 23 0, 23 3, 20 3, 20 0)))",
            "values": {"name": "annex", "type": "office"},
        },
        {"storey": first, "layer": "doors", "name": "door1", "values": {"state": "locked"}},
        {"storey": first, "layer": "doors", "name": "door1", "values": {"state": "ajar"}},
        {"storey": first, "layer": "objects", "name": "sofa1", "values": {"type": "armchiar"}},
        {"storey": first, "layer": "objects", "name": "sofa1", "values": {"storey": "floor-3rd"}},
        {"storey": first, "layer": "objects", "name": "printer1", "delete": True},
    ]
    path = office.write_qgis_project(tmp_path / "office.qgz")
    errors = [" ".join(each) for each in qgis(tmp_path, project=str(path), edits=edits)["errors"]]
    refused = {5: "nowhere is not one straight line", 9: "is not open, closed or locked",
               10: "Did you mean armchair", 11: "storey of sofa1 is not changed here"}  # fmt: skip
    assert {k: e for k, e in enumerate(errors) if e}.keys() == refused.keys(), errors
    for number, words in refused.items():
        assert words in errors[number]

    moved = affinity.translate(before["sofa1"], 0.5, 0.25)
    assert office["sofa1"].footprint.symmetric_difference(moved).area < 1e-6
    turned = affinity.rotate(before["desk2"], 30, "centroid")
    assert office["desk2"].footprint.symmetric_difference(turned).area < 1e-6
    assert np.degrees(office["desk2"].pose.yaw - heading) % 360 == pytest.approx(30)
    for name, pose in on_desk.items():
        at = affinity.rotate(shapely.Point(pose.x, pose.y), 30, before["desk2"].centroid)
        assert (office[name].pose.x, office[name].pose.y) == pytest.approx((at.x, at.y))
    assert np.degrees(office["chair5"].pose.yaw) == pytest.approx(33)
    assert office["sofa1"].type == "armchair"
    assert office.doors["through"].state == "closed"
    assert {p.name for p in office.doors["through"].places} == {"office2", "lab1"}
    assert (office["annex"].type, office["annex"].storey.name) == ("office", first)
    assert office.doors["door1"].state == "locked"
    assert "printer1" not in office
    assert walls.name in office


@with_qgis
def test_a_stored_project_opens_by_its_address_with_default_styles(
    office: semmap.Map, tmp_path: Path
) -> None:
    host = str(office.engine.url.query.get("host", ""))
    answer = qgis(tmp_path, host, project=office.store_qgis_project())
    assert answer["title"] == "office"
    assert all(layer["valid"] for layer in answer["layers"])
    again = office.store_qgis_project()
    assert office.execute("SELECT name FROM public.qgis_projects") == [("office",)]
    assert "project=office" in again
    views = office.execute("SELECT f_table_name FROM public.layer_styles ORDER BY 1")
    assert [view for (view,) in views] == [
        "gis_connector",
        "gis_object",
        "gis_region",
        "gis_room",
        "gis_storey",
    ]
    rooms, doors = (
        next(layer["source"] for layer in answer["layers"] if layer["name"] == name)
        for name in ("rooms", "doors")
    )
    opened = qgis(tmp_path, host, project=again, sources=[rooms, doors])
    assert opened["styles"] == [["RuleRenderer", True]] * 2


def test_no_password_is_in_a_project(office: semmap.Map, tmp_path: Path) -> None:
    from semmap.draw.qgis.layers import StoreyGroup
    from semmap.draw.qgis.project import project_address, project_file

    server = {"host": "db", "port": "5433", "user": "ann", "dbname": "maps", "password": PASSWORD}
    content = project_file("it's", [StoreyGroup("1")], {}, server, section_height=1)
    (tmp_path / "p.qgz").write_bytes(content)
    with zipfile.ZipFile(tmp_path / "p.qgz") as archive:
        (name,) = archive.namelist()
        written = archive.read(name).decode()
    assert PASSWORD not in written
    assert "dbname='maps' host='db' port='5433' user='ann'" in written
    assert "\"map\" = 'it''s'" in written
    assert PASSWORD not in project_address("it's", server)


def test_a_reader_writes_a_project_and_only_who_may_make_tables_stores_it(
    office: semmap.Map, tmp_path: Path
) -> None:
    office.execute("REVOKE CREATE ON SCHEMA public FROM PUBLIC")
    office.execute("SET ROLE semmap_reader")
    assert zipfile.is_zipfile(office.write_qgis_project(tmp_path / "office.qgz"))
    with pytest.raises(PermissionError, match=r"public\.qgis_projects.*Let the owner"):
        office.store_qgis_project()
    office.execute("RESET ROLE")
    assert office.execute("SELECT to_regclass('public.qgis_projects')") == [(None,)]
    assert "project=office" in office.store_qgis_project()


@pytest.mark.parametrize("layer", ["object", "region"])
def test_what_is_drawn_with_the_projects_defaults_stands_on_its_storey(
    database: str, layer: str
) -> None:
    """The default expressions of the form, as PostgreSQL computes them."""
    from semmap.draw.qgis.layers import StoreyGroup, storey_layers

    with semmap.connect(database) as db:
        here = db.create_map("tower")
        here.add_storey("upper", elevation=3.0, height=2.8)
        group = StoreyGroup("upper", 3.0)
        fields = next(
            each for each in storey_layers("tower", group, {}, 1) if each.key == layer
        ).fields
        defaults = {f.name: f.default for f in fields if f.name in ("map", "storey", "low", "high")}
        here.execute(
            f"INSERT INTO gis_{layer} ({', '.join(defaults)}, name, geom) "
            f"VALUES ({', '.join(defaults.values())}, 'a', ST_Multi(ST_MakeEnvelope(0, 0, 1, 1)))"
        )
        box = here["a"].box
        assert box is not None
        assert box[2] == pytest.approx(3)
        assert 3.5 < box[5] < 5.8


def test_a_project_is_a_qgz(office: semmap.Map, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"is a \.qgz, not '\.qgs'"):
        office.write_qgis_project(tmp_path / "office.qgs")
    assert not list(tmp_path.iterdir())
