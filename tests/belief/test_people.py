"""Agents that are seen: they move as objects do, and a person who is detected is the known one."""

from __future__ import annotations

import math
from collections.abc import Iterator

import psycopg
import pytest
import shapely

import semmap
from semmap import Map
from semmap.belief.error import BeliefError
from semmap.belief.identify import Detection
from tests.conftest import MakeDatabase

CABIN, DECK = shapely.box(0, 0, 4, 3), shapely.box(4.4, 0, 9, 3)
ROOMS = {"cabin": CABIN, "deck": DECK}


@pytest.fixture(scope="module")
def ship_map(make_database: MakeDatabase) -> Iterator[Map]:
    """Two rooms, a door in a wall of 40 cm between them, two people and a robot."""
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        yield make_ship(db, "ship")


def make_ship(db: semmap.Database, called: str) -> Map:
    ship = db.create_map(called)
    for name, outline in ROOMS.items():
        ship.add_room(name, outline, floor=0, ceiling=2.7)
    ship.add_door("hatch", "cabin", "deck", [(4.2, 1), (4.2, 2)])
    ship.add_agent("ola", type="person", size=(0.5, 0.5, 1.7), pose=(1, 1, 0))
    ship.add_agent("per", type="person", pose=(2, 2, 0))
    ship.add_agent("rob", type="robot", size=(0.4, 0.4, 0.4), pose=(0.5, 2.5, 0))
    return ship


@pytest.fixture
def ship(ship_map: Map) -> Iterator[Map]:
    """The ship, for one test: what the test changes is undone."""
    with ship_map.transaction() as transaction:
        yield ship_map
        raise psycopg.Rollback(transaction)


def foot(place: Map, name: str) -> tuple[float, float, float]:
    pose = place[name].pose
    assert pose is not None
    return pose.x, pose.y, pose.z


@pytest.mark.parametrize("name", ["ola", "per"])
@pytest.mark.parametrize("height", [0.0, 0.9, 1.5])
def test_a_person_who_is_seen_moves(ship: Map, name: str, height: float) -> None:
    """With a body or without, by the foot, the middle or the head."""
    ship.observe_point(name, (8, 2, height))
    assert foot(ship, name) == pytest.approx((8, 2, 0), abs=1e-6)
    assert ship[name].holder.name == "deck"
    assert ship[name].room.name == "deck"
    assert ship.where(name).best == "deck"
    assert ship.where(name)["deck"] > 0.99
    assert name in {found.name for found in ship.find(in_="deck")}
    assert name not in {found.name for found in ship.find(in_="cabin")}


def test_a_person_in_the_air_is_refused(ship: Map) -> None:
    with pytest.raises(BeliefError, match="nothing carries it"):
        ship.observe_point("per", (8, 2, 2.4))
    assert foot(ship, "per") == (2, 2, 0)


def test_a_detected_person_near_a_known_one_is_that_one(ship: Map) -> None:
    (row,) = ship.observe_objects([Detection("person", (1.1, 1.05, 0.85))])
    assert (row["object"], row["new"]) == ("ola", False)
    assert foot(ship, "ola") == pytest.approx((1.1, 1.05, 0), abs=1e-6)
    assert foot(ship, "per") == (2, 2, 0)
    assert {agent.name for agent in ship.find(type="person")} == {"ola", "per"}


def test_a_person_who_walked_is_the_same_later(ship: Map) -> None:
    ship.observe_point("ola", (8, 2, 0.9))
    (row,) = ship.observe_objects([Detection("person", (6, 1, 0.9))])
    assert row["may_be"]["ola"] > 10 * row["may_be"]["per"]
    assert not row["new"]


def test_an_unknown_person_becomes_an_agent(ship: Map) -> None:
    for name in ("ola", "per"):
        ship.observe_point(name, foot(ship, name))
    rows = ship.observe_objects([Detection("person", (x, 0.5, 0.9)) for x in (5.5, 8.0)])
    assert [row["new"] for row in rows] == [True, True]
    for row, x in zip(rows, (5.5, 8.0), strict=True):
        assert ship[row["object"]].kind == "agent"
        assert foot(ship, row["object"]) == pytest.approx((x, 0.5, 0), abs=1e-6)
        assert ship[row["object"]].room.name == "deck"
    again = ship.observe_objects([Detection("person", (x, 0.5, 0.9)) for x in (5.5, 8.0)])
    assert [row["object"] for row in again] == [row["object"] for row in rows]


def test_a_robot_does_not_detect_itself(ship: Map) -> None:
    (row,) = ship.observe_objects([Detection("robot", (0, 0, 0))], frame="rob")
    assert row["new"]
    assert row["object"] != "rob"


def test_a_robot_with_a_role_is_moved_by_itself_alone(ship: Map) -> None:
    """Sightings by others neither move it nor take its place from it."""
    ship.execute("CREATE ROLE rob")
    ship.observe_point("rob", (8, 2, 0.2))
    for place in ROOMS:
        ship.observe("rob", place, seen=False, hit=0.999)
    assert foot(ship, "rob") == (0.5, 2.5, 0)


def test_a_route_to_a_person_ends_beside(ship_map: Map) -> None:
    ship = make_ship(ship_map.database, "boat")  # routes see what is committed
    ship.observe_point("ola", (8, 2, 0.9))
    last = ship.route("rob", "ola").steps[-1]
    assert last.to_place == "deck"
    assert last.leave is not None
    away = math.dist((last.leave.x, last.leave.y), (8, 2))
    assert 0.25 < away < 1.5
    body = shapely.box(7.75, 1.75, 8.25, 2.25)
    assert body.distance(shapely.Point(last.leave.x, last.leave.y)) > 0.1
    ahead = math.atan2(2 - last.leave.y, 8 - last.leave.x)
    assert math.cos(ahead - last.leave.yaw) > 0.9


@pytest.mark.parametrize("x", [4.05, 4.15, 4.19, 4.21, 4.3, 4.38])
def test_what_is_in_an_opening_is_in_the_nearer_room(ship: Map, x: float) -> None:
    """A known thing by its name, a new one by its type, and a person."""
    nearer = min(ROOMS, key=lambda room: ROOMS[room].distance(shapely.Point(x, 1.5)))
    ship.add_object("mug", type="mug", size=(0.08, 0.08, 0.1), pose=(1, 1, 0))
    assert ship.observe_point("mug", (x, 1.5, 0.05))["place"] == nearer
    assert foot(ship, "mug") == pytest.approx((x, 1.5, 0), abs=1e-6)
    (row,) = ship.observe_objects([Detection("plate", (x, 1.2, 0.01), (0.1, 0.1, 0.02))])
    assert ship.observe_point("per", (x, 1.8, 0.9))["place"] == nearer
    for name in ("mug", row["object"], "per"):
        assert ship[name].room.name == nearer
        assert ship.where(name).best == nearer


def test_what_is_beyond_all_rooms_is_refused(ship: Map) -> None:
    ship.add_object("mug", type="mug", size=(0.08, 0.08, 0.1), pose=(1, 1, 0))
    for point in ((-0.4, 1.5, 0.05), (4.2, 1.5, 1.4), (12, 1, 0)):
        with pytest.raises(BeliefError, match="detected at"):
            ship.observe_point("mug", point)
    assert foot(ship, "mug") == (1, 1, 0)


def test_a_far_point_is_refused_in_a_short_sentence(ship: Map) -> None:
    for far in (1e300, -1e300, 1e8):
        for see in (
            lambda far=far: ship.observe_point("ola", (far, 0, 0)),
            lambda far=far: ship.observe("ola", "cabin", position=(0, far, 0)),
            lambda far=far: ship.observe_objects([Detection("person", (0, 0, far))]),
        ):
            with pytest.raises(BeliefError, match="out of range") as refused:
                see()
            assert len(str(refused.value)) < 120
    assert foot(ship, "ola") == (1, 1, 0)


def test_what_is_no_detection_is_refused(database: str) -> None:
    with semmap.connect(database) as db:
        here = db.create_map("hut")
        with pytest.raises(ValueError, match="is no detection: give"):
            here.observe_objects([{"type": "mug", "point": (0, 0, 0)}])  # type: ignore[list-item]
