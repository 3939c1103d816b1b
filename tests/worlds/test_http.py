"""The small house over HTTP: operations, events, SPARQL, and features as GDAL reads them."""

from __future__ import annotations

import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import numpy as np
import psycopg
import pyogrio
import pytest
import shapely
from psycopg import sql
from pyproj import Geod, Transformer
from starlette.testclient import TestClient

import semmap
from semmap.error import RightsError
from semmap.server.handles import Handles
from semmap.server.http_api import HttpApi
from tests.served import served

ROBOT, ADMIN = "a-token-of-a-robot", "a-token-of-an-admin"
TOKENS = {ROBOT: "semmap_robot", ADMIN: "semmap_admin"}


@pytest.fixture(scope="module")
def url(db: semmap.Database) -> Iterator[str]:
    """Where the maps are served."""
    with served(db, TOKENS) as address:
        yield address


@pytest.fixture
def web(url: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=url, timeout=60) as client:
        yield client


def with_token(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_operations_answer_as_the_methods_do(web: httpx.Client, db: semmap.Database) -> None:
    assert [row["name"] for row in web.get("/maps").json()] == ["house"]
    found = web.get("/maps/house/find", params={"type": "ball", "in": "kitchen"})
    assert found.status_code == 200, found.text
    house = db.map("house")
    assert [row["name"] for row in found.json()] == [
        b.name for b in house.find("ball", in_="kitchen")
    ]
    words = {"start": "bedroom", "goal": [5.0, 1.0], "avoid": []}
    way = web.post("/maps/house/route", json=words).json()
    assert way["seconds"] == pytest.approx(house.route("bedroom", (5.0, 1.0)).seconds)
    assert web.get("/maps/house/draw").content.startswith(b"\x89PNG")
    asked = {"text": "SELECT ?x WHERE { ?x a semmap:Ball }", "rows": "2"}
    assert len(web.get("/maps/house/sparql", params=asked).json()["rows"]) <= 2
    protocol = web.get("/maps/house/rdf/sparql", params={"query": "ASK { ?x a semmap:Ball }"})
    assert protocol.json()["boolean"] is True


@pytest.mark.parametrize(
    ("path", "body", "status", "said"),
    [
        ("/maps/hut/find", {}, 404, "hut"),
        ("/maps/house/fly", {}, 404, "no operation fly"),
        ("/maps/house/find", {"colour": "red"}, 400, "no argument colour"),
        ("/maps/house/find", {"limit": "many"}, 400, "limit is 'many'"),
        ("/maps/house/describe", {"name": "Bal_01_001"}, 404, "Ball_01_001"),
        ("/maps/house/observe", {"name": "a", "place": "b"}, 401, "needs a token"),
        ("/maps/house/import_file", {"path": "/etc/passwd"}, 404, "no operation"),
        ("/maps/house/sql", {"statement": "SELECT 1; SELECT 2"}, 400, "multiple commands"),
        (
            "/maps/house/sql",
            {"statement": "UPDATE entity SET name = 'a'"},
            400,
            "permission denied",
        ),
        ("/maps/house/sql", {"statement": "SELECT 1", "write": True}, 400, "no argument write"),
        ("/maps/house/sql", {"statement": "SELECT generate_series(1, 99999)"}, 400, "than 50000"),
        ("/maps/house/sql", {"statement": "SELECT pg_read_file('/etc/passwd')"}, 403, "denied"),
        ("/maps/house/sql", {"statement": "COPY entity TO STDOUT"}, 400, "permission denied"),
        ("/maps/house/route", [], 400, "no JSON object"),
        ("/maps/house/sparql", {"text": "ASK {}", "seconds": 1e5}, 400, "seconds is 100000.0"),
        ("/maps/house/sparql", {"text": "ASK {}", "rows": 10**9}, 400, "at most 50000"),
        ("/maps/house/draw_3d", {"width": 100_000}, 400, "at most 4000"),
        ("/maps/house/draw_3d", {"width": -1}, 400, "at most 4000"),
        ("/maps/house/find", {"box": [[0, 0, 0], [1, 1]]}, 400, "find: "),
        ("/maps/house/find", {"near": [1, None, 0]}, 400, "finite numbers"),
        ("/maps/house/route", {"start": [1e308, 1e308], "goal": "kitchen"}, 400, ""),
    ],
)
def test_what_is_refused_says_why(
    web: httpx.Client, path: str, body: Any, status: int, said: str
) -> None:
    answer = web.post(path, json=body)
    assert (answer.status_code, said in answer.json()["error"]) == (status, True), answer.text
    assert "write=True" not in answer.text  # which no request can give


def test_a_token_is_a_role(web: httpx.Client, db: semmap.Database) -> None:
    seen = {"name": "Ball_01_001", "place": "kitchen", "seen": False}
    assert (
        web.post("/maps/house/observe", json=seen, headers=with_token("x" * 20)).status_code == 401
    )
    told = web.post("/maps/house/observe", json=seen, headers=with_token(ROBOT))
    assert told.status_code == 200, told.text
    merge = {"name": "kitchen", "others": ["bedroom"]}
    no = web.post("/maps/house/merge_rooms", json=merge, headers=with_token(ROBOT))
    assert (no.status_code, no.json()["error"][:12]) == (403, "semmap_robot")
    described = web.get("/openapi.json", headers=with_token(ADMIN)).json()["paths"]
    assert "/maps/{map}/merge_rooms" in described
    assert "/maps/{map}/merge_rooms" not in web.get("/openapi.json").json()["paths"]
    assert {room.name for room in db.map("house").rooms} >= {"kitchen", "bedroom"}


def test_entities_are_changed_by_their_names(web: httpx.Client, db: semmap.Database) -> None:
    house, robot = db.map("house"), with_token(ROBOT)
    chair = house.find("chair")[0].name
    at = {"entity": chair, "x": 1.5, "y": -2, "z": 0.4}
    assert web.post("/maps/house/move_to", json=at).status_code == 401
    assert web.post("/maps/house/move_to", json=at, headers=robot).status_code == 200
    assert house[chair].pose[:3] == pytest.approx((1.5, -2, 0.4))
    told = web.get("/maps/house/history", params={"entity": chair}).json()
    assert [each["holder"] for each in told] == [e.holder for e in house[chair].history()]
    assert web.get("/maps/house/move_to", params=at, headers=robot).status_code == 400
    named = {"entity": chair, "value": "Sillón"}
    assert web.post("/maps/house/set_name", json=named, headers=robot).status_code == 403
    admin = with_token(ADMIN)
    assert web.post("/maps/house/set_name", json=named, headers=admin).status_code == 200
    assert "Sillón" in house
    door = next(iter(house.doors)).name
    for state, status in (("closed", 200), ("ajar", 400), ("open", 200)):
        told = web.post(
            "/maps/house/set_state", json={"entity": door, "value": state}, headers=robot
        )
        assert told.status_code == status, told.text
        (now,) = (each.state for each in house.doors if each.name == door)
        assert now == ("closed" if state == "ajar" else state)
    for values, status, said in (
        ({"entity": "Sillón", "value": "open"}, 400, "Sillón is no door"),
        ({"entity": "Sillon", "value": "open"}, 404, "Sillón"),
        ({"value": "open"}, 400, "needs entity"),
    ):
        told = web.post("/maps/house/set_state", json=values, headers=robot)
        assert (told.status_code, said in told.json()["error"]) == (status, True), told.text


def test_a_request_bounds_what_it_costs(web: httpx.Client) -> None:
    """A product of all facts with themselves is refused before it is read."""
    wide = "SELECT * { " + " . ".join(f"?a{k} ?b{k} ?c{k}" for k in range(4)) + " }"
    for path, asked in (("sparql", {"text": wide}), ("rdf/sparql", {"query": wide})):
        told = web.get(f"/maps/house/{path}", params=asked)
        assert told.status_code in (400, 503), told.text[:200]


def test_statements_read_with_the_login_of_a_reader(web: httpx.Client, db: semmap.Database) -> None:
    def sql(statement: str, token: str | None = None) -> list[list[Any]]:
        headers = with_token(token) if token else {}
        told = web.post("/maps/house/sql", json={"statement": statement}, headers=headers)
        assert told.status_code == 200, told.text
        return [*told.json()["rows"]]

    balls = "SELECT name FROM entity WHERE type = 'ball' AND map_id = current_map() ORDER BY 1"
    assert sql(balls) == [list(row) for row in db.map("house").sql(balls)]
    for token in (None, ROBOT, ADMIN):
        assert sql("SELECT session_user, current_user", token) == [["semmap_read"] * 2]
        sql("SELECT set_config('statement_timeout', '0', false)", token)
        assert sql("SHOW statement_timeout", token) == [["1min"]]
        for leaving, status in (
            ("set_config('role', 'semmap_admin', false)", 403),
            ("set_config('session_authorization', 'semmap', false)", 403),
            ("set_config('transaction_read_only', 'off', true)", 400),
            ("pg_advisory_lock(7)", 403),
        ):
            told = web.post("/maps/house/sql", json={"statement": f"SELECT {leaving}"})
            assert told.status_code == status, told.text


def test_files_of_the_server_are_not_read(web: httpx.Client, tmp_path: Path) -> None:
    secret = tmp_path / "secret.json"
    secret.write_text('{"relations": [["hidden", "on", "table"]]}')
    for given in (str(secret), [str(secret)]):
        told = web.post("/maps/house/teach", json={"teaching": given}, headers=with_token(ROBOT))
        assert told.status_code == 400
        assert "hidden" not in told.text


def test_what_a_role_may_not_change_is_refused(web: httpx.Client, db: semmap.Database) -> None:
    named = {"entity": "kitchen", "value": "office"}
    told = web.post("/maps/house/set_type", json=named, headers=with_token(ROBOT))
    assert told.status_code == 403, told.text
    assert db.map("house")["kitchen"].type == "kitchen"


def test_properties_of_the_map_are_operations_too(web: httpx.Client) -> None:
    for name in ("robots", "binding_shapes"):
        told = web.post(f"/maps/house/{name}", json={})
        assert told.status_code == 200, told.text


def test_ways_are_the_lines_of_the_route(web: httpx.Client, db: semmap.Database) -> None:
    words = {"start": "bedroom", "goal": "kitchen"}
    (way,) = web.get("/maps/house/ways", params=words).json()
    line = shapely.LineString(way["points"])
    route = db.map("house").route("bedroom", "kitchen")
    for step in route.doors:
        assert line.distance(shapely.Point(step.approach.x, step.approach.y)) < 1e-6
        assert line.distance(shapely.Point(step.leave.x, step.leave.y)) < 1e-6
    file = web.get("/maps/house/ways", params=words | {"robot": "/etc/passwd"})
    assert (file.status_code, "give the name" in file.json()["error"]) == (400, True)


@pytest.mark.parametrize("role", ["semmap_reader", "semmap_robot", "semmap_admin"])
def test_no_statement_leaves_the_role_of_a_token(db: semmap.Database, role: str) -> None:
    with Handles(db).open(role) as handle:
        for session in (handle.session, handle.map("house").connection):
            for statement in ("RESET ROLE", "RESET SESSION AUTHORIZATION", "SET ROLE none"):
                session.execute(statement)
                who = session.execute("SELECT session_user, current_user").fetchone()
                assert who == (role, role)
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                session.execute("SET SESSION AUTHORIZATION semmap")


def test_a_role_that_is_made_later_has_a_login(db: semmap.Database) -> None:
    name = 'turtle"bot'
    with db.engine.begin() as connection:
        connection.exec_driver_sql(f"CREATE ROLE {quoted_name(name)} IN ROLE semmap_robot")
    try:
        with Handles(db).open(name) as handle:
            assert handle.session.execute("SELECT session_user").fetchone() == (name,)
            with Handles(db).open("semmap_admin"):  # the map of users keeps all
                pass
        with pytest.raises(RightsError, match="there is no role nobody"):
            Handles(db).open("nobody")
    finally:
        with db.engine.begin() as connection:
            connection.exec_driver_sql(f"DROP ROLE {quoted_name(name)}")


def quoted_name(name: str) -> str:
    return sql.Identifier(name).as_string()


@pytest.mark.parametrize("role", [None, "semmap_robot"])
def test_a_statement_ends_in_time(db: semmap.Database, role: str | None) -> None:
    with Handles(db).open(role) as handle:
        for session in (handle.session, handle.map("house").connection):
            assert session.execute("SHOW statement_timeout").fetchone() == ("1min",)
        assert handle.session.execute("SELECT current_user").fetchone() == (role or "semmap_read",)


def test_another_name_of_this_machine_is_refused(url: str, db: semmap.Database) -> None:
    with httpx.Client(base_url=url, headers={"Host": "a.page.of.the.web"}) as other:
        assert other.get("/maps").status_code == 400
    with TestClient(HttpApi(db, TOKENS, local=False).app) as elsewhere:
        for path in ("/maps", "/maps/house", "/maps/house/rdf/sparql?query=ASK%7B%7D"):
            assert elsewhere.get(path).status_code == 401
            assert elsewhere.get(path, headers=with_token(ROBOT)).status_code == 200


def test_a_move_is_an_event_at_once(url: str, db: semmap.Database) -> None:
    ball = db.map("house")["Ball_01_001"]
    x, y, z = ball.pose[:3]
    with (
        httpx.Client(base_url=url, timeout=20) as client,
        client.stream("GET", "/maps/house/events") as events,
    ):
        lines = events.iter_lines()
        assert next(lines).startswith(":")
        began = time.perf_counter()
        ball.move_to(x + 0.1, y, z)
        cursor, event = next(_events(lines))
        took = time.perf_counter() - began
    assert (event["name"], took < 2) == ("Ball_01_001", True)
    ball.move_to(x, y, z)
    with client_since(url, cursor) as again:  # what was missed comes first
        _, missed = next(_events(again))
        assert missed["name"] == "Ball_01_001"


def _events(lines: Iterator[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    cursor = ""
    for line in lines:
        if line.startswith("id: "):
            cursor = line[4:]
        if line.startswith("data: "):
            yield cursor, json.loads(line[6:])


class client_since:
    """The lines of the events after a cursor."""

    def __init__(self, url: str, cursor: str) -> None:
        self._client = httpx.Client(base_url=url, timeout=20)
        self._events = self._client.stream(
            "GET", "/maps/house/events", headers={"Last-Event-ID": cursor}
        )

    def __enter__(self) -> Iterator[str]:
        return self._events.__enter__().iter_lines()

    def __exit__(self, *error: Any) -> None:
        self._events.__exit__(*error)
        self._client.close()


@pytest.mark.skipif(shutil.which("ogr2ogr") is None, reason="GDAL's programs are not installed")
def test_gdal_reads_the_collections(url: str, db: semmap.Database, tmp_path: Path) -> None:
    file = tmp_path / "house.gpkg"
    subprocess.run(
        ["ogr2ogr", "-f", "GPKG", file, f"OAPIF:{url}/maps/house"], check=True, capture_output=True
    )
    house = db.map("house")
    layers = {name for name, _ in pyogrio.list_layers(file)}
    assert {"rooms", "doors", "objects"} <= layers
    info = pyogrio.read_info(file, layer="objects")
    assert info["features"] == len(house.objects)
    assert "4326" in info["crs"] or "CRS84" in info["crs"]
    geod = Geod(ellps="WGS84")
    rooms = pyogrio.read_dataframe(file, layer="rooms").set_index("name")["geometry"]
    assert {*rooms.index} == {room.name for room in house.rooms}
    for room in house.rooms:
        area = abs(geod.geometry_area_perimeter(rooms[room.name])[0])
        assert area == pytest.approx(room.footprint.area, rel=0.01)


def test_pages_and_boxes_of_features(web: httpx.Client, db: semmap.Database) -> None:
    count, names = len(db.map("house").objects), []
    path: str | None = "/maps/house/collections/objects/items?limit=40"
    while path:
        page = web.get(path).json()
        assert page["numberMatched"] == count
        names += [each["properties"]["name"] for each in page["features"]]
        path = next((link["href"] for link in page["links"] if link["rel"] == "next"), None)
    assert sorted(names) == sorted(each.name for each in db.map("house").objects)
    feature = page["features"][0]
    alone = web.get(f"/maps/house/collections/objects/items/{feature['id']}").json()
    assert alone["properties"] == feature["properties"]
    far = web.get("/maps/house/collections/objects/items", params={"bbox": "1,1,2,2"}).json()
    assert far["features"] == []
    assert web.get("/maps/house/collections/objects/items?bbox=1,2").status_code == 400
    for when, status in (("2026-01-01T00:00:00Z", 200), ("../2026-01-01", 200), ("today", 400)):
        asked = {"datetime": when}
        answer = web.get("/maps/house/collections/objects/items", params=asked)
        assert answer.status_code == status
    assert web.get("/maps/house/collections/ghosts/items").status_code == 404


@pytest.mark.parametrize("frame", [None, (32632, 690_000.0, 5_335_000.0, 0.4)])
def test_gdal_reads_vector_tiles_where_proj_says(
    web: httpx.Client,
    db: semmap.Database,
    tmp_path: Path,
    frame: tuple[int, float, float, float] | None,
) -> None:
    """The footprints of the tiles that a map covers, together, as drawn on Web Mercator."""
    house = db.map("house")
    change = (
        "UPDATE map SET (crs, easting, northing, rotation, height) = (%s, %s, %s, %s, %s) "
        "WHERE id = current_map() RETURNING 1"
    )
    if frame is not None:
        house.execute(change, *frame, 0)

    def mercator(points: np.ndarray) -> np.ndarray:
        if frame is None:
            return points
        crs, east, north, turn = frame
        turned = points @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        to = Transformer.from_crs(crs, 3857, always_xy=True)
        return np.column_stack(to.transform(*np.add(turned, (east, north)).T))

    zoom, wide = 19, 40_075_016.68557849 / 2**19
    for layer in ("rooms", "objects"):
        there = {e.name: e.footprint for e in getattr(house, layer) if e.footprint is not None}
        there = {name: shapely.transform(shape, mercator) for name, shape in there.items()}
        bounds = shapely.union_all([*there.values()]).bounds
        low, high = (np.floor(np.array(p) / wide).astype(int) for p in (bounds[:2], bounds[2:]))
        found: dict[str, list[shapely.Geometry]] = {}
        for column in range(low[0], high[0] + 1):
            for upwards in range(low[1], high[1] + 1):
                x, y = column + 2 ** (zoom - 1), 2 ** (zoom - 1) - 1 - upwards
                path = f"/maps/house/collections/{layer}/tiles/WebMercatorQuad/{zoom}/{y}/{x}"
                file = tmp_path / "tile.mvt"
                file.write_bytes(web.get(path).raise_for_status().content)
                if not file.stat().st_size:
                    continue
                rows = pyogrio.read_dataframe(f"MVT:{file}", X=str(x), Y=str(y), Z=str(zoom))
                square = shapely.box(*(np.array([column, upwards, column + 1, upwards + 1]) * wide))
                for name, shape in zip(rows["name"], rows.geometry, strict=True):
                    found.setdefault(name, []).append(shape.buffer(0).intersection(square))
        small = {name for name, shape in there.items() if shape.area < 0.01}
        assert there.keys() - small <= found.keys() <= there.keys()
        for name, shape in there.items():
            drawn = shapely.union_all(found.get(name, []))
            # corners are rounded to 2 cm
            assert drawn.symmetric_difference(shape).area < 0.02 * shape.length + 0.01, name
    wrong = web.get("/maps/house/collections/rooms/tiles/WebMercatorQuad/3/9/0")
    assert wrong.status_code == 400
    assert "zoom" in wrong.json()["error"]
    if frame is not None:
        house.execute(change, *[None] * 5)


def test_a_map_has_any_name(web: httpx.Client, db: semmap.Database) -> None:
    name = "Haus 3/2 %2F ü?#"
    db.create_map(name).add_room("Küche", shapely.box(0, 0, 3, 3), floor=0, ceiling=2.5)
    at = f"/maps/{quote(name, safe='')}"
    found = web.get(f"{at}/describe", params={"name": "Küche"}).raise_for_status().json()
    assert found["name"] == "Küche"
    landing = web.get(at).raise_for_status().json()
    assert landing["title"] == name
    (rooms,) = (link["href"] for link in landing["links"] if link["rel"] == "data")
    assert len(web.get(f"{rooms}/rooms/items").raise_for_status().json()["features"]) == 1
    asked = {"query": "SELECT ?x { ?x a <urn:semmap:ontology#Room> }"}
    rows = web.get(f"{at}/rdf/sparql", params=asked).raise_for_status().json()
    assert len(rows["results"]["bindings"]) == 1
    db.drop_map(name)
    assert web.get(f"{at}/find").status_code == 404


def test_the_events_of_a_dropped_map_end(url: str, db: semmap.Database) -> None:
    heard = db.create_map("shed").subscribe(lambda event: None)
    with httpx.stream("GET", f"{url}/maps/shed/events", timeout=30) as events:
        lines = events.iter_lines()
        next(lines)
        db.drop_map("shed")
        assert not [line for line in lines if line.startswith("data")]
    end = time.monotonic() + 10
    while heard.running and time.monotonic() < end:
        time.sleep(0.05)
    with pytest.raises(LookupError, match="shed was dropped"):
        heard.stop()
