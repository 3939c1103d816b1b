"""Detections and views as observations of the map; beliefs as pictures, fields and arrays."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import psycopg
import pytest
from PIL import Image
from sqlalchemy import Connection, text

from semmap import Map
from semmap.belief.belief_field import belief_map
from semmap.belief.error import BeliefError
from semmap.belief.heat_map import heat_map
from semmap.belief.identify import Detection
from semmap.belief.inference import infer
from semmap.belief.looks import observe_point, observe_view
from semmap.belief.problog_program import problog_program
from semmap.belief.reader import read_columns, read_model, read_places
from semmap.belief.store.beliefs import add_observations, initial_belief, read_belief
from semmap.belief.views import camera_at
from semmap.database.maps import driver_of, see_map
from semmap.draw.view import storey_view
from semmap.fields.store.names import read_map_vocabulary
from semmap.query.storey_reader import read_storeys
from tests.belief.conftest import THESIS
from tests.command_line import semmap as run
from tests.forged import forge
from tests.seen import seen_by


@pytest.fixture
def connection(flat_map: Map) -> Iterator[Connection]:
    """Sees the flat; what the test writes is undone."""
    with flat_map.database.engine.connect() as connection:
        see_map(connection, "flat")
        yield connection
        connection.rollback()


def observations(connection: Connection) -> list[tuple[Any, ...]]:
    rows = connection.execute(
        text(
            "SELECT p.name, o.seen, o.visible, o.position FROM observation o "
            "JOIN entity p ON p.id = o.place_id ORDER BY o.id"
        )
    )
    return [tuple(row) for row in rows]


def test_a_detection_is_put_onto_its_place_in_the_frame_of_the_place(
    connection: Connection,
) -> None:
    row = observe_point(seen_by(connection), "mug", (1.7, 1.4, 0.8))
    assert row["place"] == "table"
    assert row["position"] == pytest.approx([0.2, -0.1, 0.8])
    # the robot is at (7, 2), without a turn: the bench is at (6, 1)
    row = observe_point(seen_by(connection), "mug", (-1.1, -0.9, 0.5), frame="robot")
    assert row["place"] == "bench"
    assert row["position"] == pytest.approx([-0.1, 0.1, 0.5])
    assert observe_point(seen_by(connection), "mug", (2.6, 0.3, 0.05))["place"] == "kitchen"
    assert [found[:2] for found in observations(connection)] == [
        ("table", True),
        ("bench", True),
        ("kitchen", True),
    ]


@pytest.mark.parametrize(
    ("point", "message"),
    [
        ((50, 0, 1), r"detected at \(50.00, 0.00, 1.00\) in the map, where no place"),
        ((1.5, 1.5, 1.5), r"0\.7\d m above table, where nothing carries it"),
        ((2.6, 0.3, 1.0), r"1\.00 m above kitchen, where nothing carries it"),
        ((1, 1), "give x, y, z"),
        ((1, 1, math.nan), "give x, y, z"),
    ],
)
def test_a_detection_at_no_place_is_refused(
    connection: Connection, point: tuple[float, ...], message: str
) -> None:
    with pytest.raises(BeliefError, match=message):
        observe_point(seen_by(connection), "mug", point)
    assert observations(connection) == []


def test_what_the_map_has_in_the_air_may_be_seen_there_and_stays(flat_map: Map) -> None:
    with flat_map.transaction() as transaction:
        flat_map.add_object("lamp", type="lamp", size=(0.3, 0.3, 0.2), pose=(2.0, 0.5, 2.2, 0))
        pose = flat_map["lamp"].pose
        row = flat_map.observe_point("lamp", (2.1, 0.5, 2.3))
        assert row["place"] == "kitchen"
        assert flat_map["lamp"].pose == pose
        assert flat_map.where("lamp").best == "kitchen"
        (one,) = flat_map.identify([Detection("lamp", (2.1, 0.5, 2.3))])
        assert one.known["lamp"] > 0.9
        with pytest.raises(BeliefError, match="where nothing carries it"):
            flat_map.observe_point("lamp", (2.9, 0.5, 2.3))
        with pytest.raises(BeliefError, match="where nothing carries it"):
            flat_map.observe_objects([Detection("carrot", (2.9, 0.5, 1.3), (0.1, 0.1, 0.2))])
        raise psycopg.Rollback(transaction)


@pytest.mark.parametrize("kind", ["room", "kitchen", "storey", "door"])
def test_what_is_no_object_is_not_detected(flat_map: Map, kind: str) -> None:
    before = {entity.name for entity in flat_map}
    with pytest.raises(ValueError, match=f"{kind} a type of the kind"):
        flat_map.observe_objects([Detection("mug", (1.7, 1.4, 0.8)), Detection(kind, (1, 1, 0))])
    assert {entity.name for entity in flat_map} == before


def test_a_position_in_the_air_says_where_it_is_but_moves_nothing(flat_map: Map) -> None:
    with flat_map.transaction() as transaction:
        pose = flat_map["mug"].pose
        flat_map.observe("mug", "bench", position=(0, 0, 1.2), hit=0.999, false_alarm=1e-9)
        assert flat_map.where("mug")["bench"] > 0.9
        assert flat_map["mug"].pose == pose
        raise psycopg.Rollback(transaction)


def test_the_middle_of_a_tall_thing_is_high(flat_map: Map) -> None:
    with flat_map.transaction() as transaction:
        flat_map.add_object("pole", type="plant", size=(0.1, 0.1, 1.6), pose=(0.5, 0.5, 0, 0))
        flat_map.observe_point("pole", (2.6, 0.3, 0.8))
        assert flat_map["pole"].pose[:3] == pytest.approx((2.6, 0.3, 0.0))
        raise psycopg.Rollback(transaction)


def test_a_view_stores_what_it_showed_and_what_it_missed(connection: Connection) -> None:
    camera = camera_at((0.2, 0.4, 1.5), math.atan2(1.1, 1.3), 0.4, field_of_view=1.2)
    unseen = read_belief(seen_by(connection), "coke")
    rows = observe_view(seen_by(connection), camera, ["coke"], {"mug": (1.6, 1.5, 0.8)})
    by_name = {(row["object"], row["place"]): row for row in rows}
    assert by_name["mug", "table"]["seen"]
    assert not by_name["coke", "table"]["seen"]
    assert 0.8 < by_name["coke", "table"]["visible"] < 1  # the cereal box hides a part
    assert 0 < by_name["coke", "kitchen"]["visible"] < 0.6  # the floor, partly under the table
    assert "bench" not in {row["place"] for row in rows}  # beyond the range
    assert read_belief(seen_by(connection), "mug")["table"] > 0.2
    assert read_belief(seen_by(connection), "coke")["table"] < unseen["table"] / 2
    before = observations(connection)
    with pytest.raises(BeliefError, match="range of the view"):
        observe_view(seen_by(connection), camera, ["coke"], furthest=0)
    with pytest.raises(LookupError, match="no entity cok"):
        observe_view(seen_by(connection), camera, ["coke", "cok"])
    assert observations(connection) == before


def test_arrays_of_the_map_give_the_same_belief(connection: Connection) -> None:
    connection.exec_driver_sql(THESIS)
    looks = [
        {"object": "coke", "place": "table", "seen": True, "at": "2026-05-01T12:00:00Z"},
        {"object": "coke", "place": "kitchen", "seen": False, "inside": True, "visible": 0.5},
        {"object": "mug", "place": "counter", "seen": True, "hit": 0.9, "false_alarm": 0.1},
    ]
    add_observations(driver_of(connection), looks)
    moment = datetime.now(UTC) + timedelta(seconds=1)
    columns = read_columns(seen_by(connection), ["coke", "mug"], moment)
    assert columns.places[-1] == "elsewhere"
    assert len(columns.observations) == 6  # four places in the kitchen
    found = infer(
        columns.prior, columns.observations, columns.mobility, read_model(seen_by(connection))
    )
    for name, row in zip(columns.objects, found, strict=True):
        assert dict(zip(columns.places, row, strict=True)) == pytest.approx(
            read_belief(seen_by(connection), name, moment), abs=1e-12
        )
    program = problog_program(
        columns.prior, columns.observations, columns.mobility, columns.objects, columns.places
    )
    assert "is_in" in program
    message = initial_belief(seen_by(connection), ["coke", "mug"], moment)
    assert list(message) == ["location", "coke", "mug"]
    assert message["location"] == list(columns.places)
    assert sum(message["mug"]) == pytest.approx(1, abs=1e-12)


def test_a_belief_is_a_field_and_a_picture(connection: Connection, tmp_path: Path) -> None:
    places = read_places(seen_by(connection), "coke")
    belief = read_belief(seen_by(connection), "coke") | {"table": 0.5, "kitchen": 0.25}
    made = belief_map(read_map_vocabulary(), places, belief, about="coke")
    values = made.at([[1.5, 1.5, 0.8], [2.6, 0.3, 0.05], [1.5, 1.5, 1.2], [20, 0, 0]])
    assert list(values) == [0.5, 0.25, 0, 0]
    (scene,) = read_storeys(seen_by(connection))
    path = heat_map(storey_view(scene), places, belief, tmp_path / "a.png", name="coke", dpi=60)
    warm = Image.open(path).convert("RGB")
    cold = Image.open(
        heat_map(storey_view(scene), places, {"elsewhere": 1.0}, tmp_path / "b.png", dpi=60)
    ).convert("RGB")
    dark = (128, 0, 38)  # the warmest colour, of the table alone

    def count(picture: Image.Image) -> int:
        return sum(n for n, colour in picture.getcolors(1 << 24) if colour == dark)

    assert count(warm) > 500
    assert count(cold) == 0


def test_the_commands(flat_map: Map, tmp_path: Path) -> None:
    url = flat_map.database.engine.url.render_as_string(hide_password=False)
    url = url.replace("+psycopg", "")
    try:
        (tmp_path / "a.json").write_text(
            json.dumps({"objects": [{"name": "coke", "occurrences": [{"place": "counter"}]}]})
        )
        taught = run(url, "teach", tmp_path / "a.json", "--json")
        assert json.loads(taught.stdout)[0]["observations"] == 1
        for words in (["coke", "counter"], ["coke", "table", "--missed"]):
            assert run(url, "observe", *words, "--hit", 0.9, "--false-alarm", 0.1).exit_code == 0
        (found,) = json.loads(run(url, "where", "coke", "--json").stdout)
        best = found["belief"][0]
        assert (found["name"], best["place"]) == ("coke", "counter")
        assert best["last_seen"] is not None
        table = run(url, "where", "coke", "--limit", 2).stdout.splitlines()
        assert table[1].startswith("counter")
        assert table[3].startswith("(6 other places)")
        message = json.loads(run(url, "belief", "initial", "coke").stdout)
        assert sum(message["coke"]) == pytest.approx(1, abs=1e-12)
        assert "query(is_in" in run(url, "belief", "export", "coke", "--problog").stdout
        assert run(url, "belief", "grammar").stdout.startswith("root ::= command")
        assert "version 1" in run(url, "belief", "field", "coke", "--voxel-size", 0.2).stdout
        with pytest.raises(ValueError, match="kitchen is a room: it does not move"):
            run(url, "where", "kitchen")
        assert run(url, "observe", "coke").exit_code == 2
    finally:
        for table_name in ("observation", "belief", "field"):
            forge(flat_map.execute, f"DELETE FROM {table_name}")
