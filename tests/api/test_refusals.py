"""What the API refuses: each row is a call, the kind of its error, and a part of its sentence."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from typing import Any

import psycopg
import pytest
from sqlalchemy import Engine

import semmap
from semmap import InvalidArgumentError, Map, UnknownNameError

nan = math.nan
Call = Callable[[Map], Any]


@pytest.fixture(scope="module")
def house(module_engine: Engine) -> Iterator[Map]:
    """Two rooms, which the tests of this module share: what is refused changes nothing."""
    with semmap.connect(module_engine.url.render_as_string(hide_password=False)) as db:
        made = db.create_map("house")
        made.add_storey("ground", height=3)
        made.add_room("kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], ceiling=2.7, label="kitchen")
        made.add_room("bedroom", [(4.1, 0), (8, 0), (8, 3), (4.1, 3)], ceiling=2.7)
        made.add_door("kitchen-door", "kitchen", "bedroom", ((4.05, 1), (4.05, 2)))
        made.add_object("desk4", type="desk", size=(1.6, 0.8, 0.75), in_="kitchen")
        made.add_object("mug1", type="mug", size=(0.08, 0.08, 0.1), on="desk4")
        yield made


def given(entity: str, name: str, value: Any) -> Call:
    """Assign a value to a property of an entity."""
    return lambda house: setattr(house[entity], name, value)


NAMES: dict[str, tuple[Call, type[Exception], str]] = {
    "entity": (lambda h: h["mug"], UnknownNameError, "no entity mug; did you mean mug1?"),
    "room": (lambda h: h.rooms["kichen"], UnknownNameError, "no room kichen; did you mean kitchen"),
    "map": (lambda h: h.database.map("hous"), UnknownNameError, "there is no map hous"),
    "type": (lambda h: h.find("tabel"), UnknownNameError, "no type tabel; did you mean table"),
    "place": (lambda h: h.route("kitchen", "attic"), LookupError, "attic"),
    "NUL": (lambda h: h["a\0b"], semmap.Error, "NUL"),
    "NUL in a new name": (lambda h: h.add_object("a\0b"), semmap.Error, "NUL"),
    "taken": (lambda h: h.add_object("mug1"), InvalidArgumentError, "an entity mug1 already"),
    "renamed to one": (given("mug1", "name", "desk4"), InvalidArgumentError, "desk4 already"),
}

TYPES: dict[str, tuple[Call, str]] = {
    "entity 5": (lambda h: h[5], "name is 5: give an entity or its name"),
    "entity None": (lambda h: h[None], "name is None: give an entity or its name"),
    "room 0": (lambda h: h.rooms[0], "name is 0: give an entity or its name"),
    "type 5": (lambda h: h.find(5), "type is 5: give a text or None"),
    "name 5": (lambda h: h.add_object(5, size=(1, 1, 1)), "name is 5: give a text"),
    "robot 5": (lambda h: h.route("kitchen", "bedroom", robot=5), "robot is 5: give a text, a Rob"),
    "frame of 5": (lambda h: h.to_geodataframe(5), "type is 5: give a text"),
    "assigned type 5": (given("mug1", "type", 5), "type is 5: give a text or None"),
    "assigned label 5": (given("mug1", "label", 5), "label is 5: give a text or None"),
    "assigned properties 5": (
        given("mug1", "properties", 5),
        "properties is 5: give a mapping of names",
    ),
    "grid 0": (lambda h: h.grid(0), "storey is 0: give an entity, its name or None"),
    "limit '3'": (lambda h: h.find(limit="3"), "limit is '3': give a whole number or None"),
    "within '3'": (lambda h: h.find(near="mug1", within="3"), "within is '3': give a number"),
    "where text": (lambda h: h.find(where="colour=red"), "give a mapping or None"),
    "on 5": (lambda h: h.find(on=5), "on is 5: give an entity, its name or None"),
    "goal None": (lambda h: h.plan(None), "goal is None: give a text"),
    "url 5": (lambda h: semmap.connect(5), "url is 5: give a text, a Cluster or None"),
    "cursor 5": (lambda h: h.changes(5), "since is 5: give a text or None"),
    "mesh 5": (lambda h: h.add_object("a", mesh=5), "mesh is 5: give a text, a path, a Trimesh"),
    "sight 5": (lambda h: h.search("mug1", start="kitchen", sight=5), "sight is 5: give a Sight"),
    "moment of text": (
        lambda h: h.route("kitchen", "bedroom", at="2026"),
        "at is '2026': give a datetime or None",
    ),
    "day of text": (
        lambda h: h.where("mug1", at="yesterday"),
        "at is 'yesterday': give a datetime",
    ),
    "seen at a text": (lambda h: h.observe("mug1", "desk4", at="now"), "at is 'now': give a datet"),
    "holder 5": (lambda h: h["mug1"].put_on(5), "holder is 5: give a text or a MapEntity"),
    "moved to text": (lambda h: h["mug1"].move_to("1", 2, 3), "x is '1': give a number"),
    "reach 5": (
        lambda h: h.database.add_robot("r", "examples/office/delivery_robot.urdf", reach=5),
        "reach is 5: give",
    ),
}

VALUES: dict[str, tuple[Call, str]] = {
    "elevation NaN": (
        lambda h: h.add_storey("s", elevation=nan),
        "elevation is nan: give a finite",
    ),
    "height -1": (
        lambda h: h.add_storey("s", height=-1),
        "height is -1: give a finite number abov",
    ),
    "width -1": (
        lambda h: h.add_door("d", "kitchen", "bedroom", ((4.05, 0), (4.05, 0.9)), width=-1),
        "width is -1: give a finite number above 0",
    ),
    "state ajar": (
        lambda h: h.add_door("d", "kitchen", "bedroom", ((4.05, 0), (4.05, 0.9)), state="ajar"),
        "state is 'ajar': give one of open, closed, locked",
    ),
    "form gate": (
        lambda h: h.add_door("d", "kitchen", "bedroom", ((4.05, 0), (4.05, 0.9)), form="gate"),
        "form is 'gate': give one of door, elevator_door, stairs, ramp",
    ),
    "properties NaN": (
        given("mug1", "properties", {"a": nan}),
        "a mapping of names to values that JSON has",
    ),
    "no table": (lambda h: h.execute("SELECT * FROM entitty"), '"entitty" does not exist'),
    "on itself": (lambda h: h["mug1"].put_on("mug1"), "an entity is not on or in itself"),
    "far away": (lambda h: h["mug1"].move_to(1e9, 0, 0), "a pose is within ten thousand kilo"),
    "outcome": (
        lambda h: h.record_attempt("mug1", None, "foo"),
        "the outcome of an attempt is completed or error",
    ),
    "kind": (
        lambda h: h.record_attempt("mug1", None, "error", kind="lick"),
        "the kind of an attempt is grasp, place, push, turn, open or put",
    ),
    "room of a letter": (
        lambda h: h.costmap("examples/office/delivery_robot.urdf", rooms="ktchen"),
        "no room.* ktchen|ktchen",
    ),
    "avoided letter": (lambda h: h.route("kitchen", "bedroom", avoid="kitchen-dor"), "kitchen-dor"),
    "bounds of three": (
        lambda h: h.costmap("examples/office/delivery_robot.urdf", bounds=(1, 2, 3)),
        r"bounds is \(1, 2, 3\): give \(x0, y0, x1, y1\)",
    ),
    "size of two": (lambda h: h.add_object("a", size=(1, 1)), "the size of a is three lengths"),
    "size 5": (lambda h: h.add_object("a", size=5), "size is 5: give a sequence"),
    "two corners": (lambda h: h.add_room("r", [(0, 0), (1, 1)]), "three corners"),
    "goal of one number": (lambda h: h.route((1,), "kitchen"), r"start is \(1,\): give"),
    "subscribed text": (lambda h: h.subscribe("foo"), "callback is 'foo': give a function"),
    "subscribed since": (lambda h: h.subscribe(print, since="foo"), "foo is not a cursor"),
    "changes since": (lambda h: h.changes("foo"), "foo is not a cursor"),
    "inflation": (
        lambda h: h.costmap("examples/office/delivery_robot.urdf", inflation_radius=-1),
        "inflation_radius is -1",
    ),
    "patience -1": (
        lambda h: h.plan("in(mug1, bedroom)", patience=-1),
        "patience is -1: give a fi",
    ),
    "patience NaN": (lambda h: h.plan("in(mug1, bedroom)", patience=nan), "patience is nan"),
    "no start of a plan": (lambda h: h.plan("in(mug1, bedroom)"), "give its start by start=$"),
    "no start of a search": (lambda h: h.search("mug1"), "give its start by start=$"),
    "a statement that writes": (lambda h: h.sql("DELETE FROM entity"), "Add write=True"),
    "an ending": (lambda h: h.write_topology("x.foo"), "give format=, one of nav2"),
    "posture": (
        lambda h: h.costmap("examples/office/delivery_robot.urdf", posture="home"),
        "posture= home: is neither JSON nor a file .* nor a state .*there is no SRDF",
    ),
    "a type without an object": (
        lambda h: h.search("cup", start="kitchen"),
        "no cup: add or teach",
    ),
    "a cost at NaN": (
        lambda h: h.costmap("examples/office/delivery_robot.urdf").explain(nan, 0),
        r"\(nan, 0\) is not a point",
    ),
    "in a solid desk": (lambda h: h["mug1"].put_in("desk4"), "desk4 is solid"),
    "added in a desk": (lambda h: h.add_object("a", in_="desk4"), "desk4 is solid"),
    "a door on a desk": (
        lambda h: h["kitchen-door"].put_on("desk4"),
        "kitchen-door is a connector",
    ),
    "a door far away": (
        lambda h: h.add_door("d", "kitchen", None, ((50, 0), (51, 0))),
        "d ends 47.00 m beside kitchen",
    ),
}


def test_an_entity_stands_for_its_name(house: Map) -> None:
    kitchen, desk, mug, ground = (house[n] for n in ("kitchen", "desk4", "mug1", "ground"))
    assert house[mug] == house.objects[mug] == mug
    assert (mug in house, mug in house.rooms, 5 in house, "a\0b" in house) == (True,) + (False,) * 3
    assert house.find(in_=kitchen, on=desk) == house.find("mug", near=mug) == [mug]
    assert house.describe(mug) == house.describe("mug1")
    assert list(house.where(mug)) == list(house.where("mug1"))
    found = house.route("bedroom", mug, avoid=house["kitchen"].contents[:0])
    assert found == house.route(house["bedroom"], "mug1", avoid=[])
    assert house.grid(ground).cells.tolist() == house.grid("ground").cells.tolist()
    urdf = "examples/office/delivery_robot.urdf"
    one = house.costmap(urdf, rooms=kitchen).master
    assert (one == house.costmap(urdf, rooms=["kitchen"]).master).all()
    assert (one == house.costmap(urdf, rooms="kitchen").master).all()
    assert house.search(mug, start=kitchen).tour == house.search("mug1", start="kitchen").tour
    assert house.search("mug", start=kitchen).name == "mug1"
    assert house.plan("in(mug1, bedroom)", start=kitchen).actions
    with house.transaction() as transaction:
        cup = house.add_object("cup", type="mug", size=(0.1, 0.1, 0.1), on=desk)
        assert cup.holder == desk
        assert house.observe(cup, desk)["place"] == "desk4"
        door = house.add_door("d", kitchen, house["bedroom"], ((4.05, 0), (4.05, 0.9)))
        assert door.places == (kitchen, house["bedroom"])
        raise psycopg.Rollback(transaction)


def test_a_map_or_a_database_that_is_gone_says_so(database: str) -> None:
    with semmap.connect(database) as db:
        gone = db.create_map("gone")
        gone.add_room("kitchen", [(0, 0), (4, 0), (4, 3)])
        db.drop_map("gone")
        for call in (lambda: gone["kitchen"], gone.check, lambda: gone.route("a", "b"), gone.draw):
            with pytest.raises(UnknownNameError, match=r"no map.* gone"):
                call()
        left = db.create_map("left")
    for call in (lambda: left["kitchen"], left.check, lambda: db.maps, lambda: db.map("left")):
        with pytest.raises(semmap.DatabaseError, match="the database is closed: open it again"):
            call()


def test_one_change_is_one_event_and_one_version(house: Map) -> None:
    cup = house.add_object("cup", type="mug", size=(0.1, 0.1, 0.1), on="desk4")
    house.observe(cup, "desk4")
    assert [version.holder for version in cup.history()] == ["desk4"]
    cursor = [event.cursor for event in house.changes()][-1]
    cup.move_to(6, 2, 0)
    assert [(e.what, e.name) for e in house.changes(cursor)] == [("moved", "cup")]
    assert [version.holder for version in cup.history()] == ["desk4", "bedroom"]
    cup.delete()


def test_what_is_found_is_shown_in_a_line(house: Map) -> None:
    costmap = house.costmap("examples/office/delivery_robot.urdf")
    shown = {
        repr(house.grid()): r"<grid of ground: \d+ x \d+ cells of 0.05 m>",
        repr(costmap): r"<costmap of ground: \d+ x \d+ cells of 0.05 m>",
        repr(house.draw()): r"<picture of \d{3,4} x \d{3,4} pixels>",
        repr(
            house.route("kitchen", "bedroom")
        ): r"<route from kitchen to bedroom: \d+ steps, .* s>",
        repr(house.plan("in(mug1, bedroom)", start="kitchen")): r"<plan of in.*: 3 actions, \d+ s>",
        repr(
            house.search("mug1", start="kitchen")
        ): r"<search for mug1: \d+ looks, \d+ s expected>",
        repr(house.storeys): "<1 storey: ground>",
        repr(house.rooms): "<2 rooms: bedroom, kitchen>",
    }
    assert {text: form for text, form in shown.items() if not re.fullmatch(form, text)} == {}


@pytest.mark.parametrize("case", NAMES)
def test_unknown_and_taken_names(house: Map, case: str) -> None:
    call, kind, says = NAMES[case]
    with pytest.raises(kind, match=says.replace("?", r"\?")):
        call(house)


@pytest.mark.parametrize("case", [*TYPES, *VALUES])
def test_a_refused_argument_is_named_in_a_sentence(house: Map, case: str) -> None:
    call, says = (TYPES | VALUES)[case]
    before = house.table()
    with pytest.raises(semmap.Error, match=says) as refused:
        call(house)
    assert isinstance(refused.value, ValueError | LookupError)
    assert house.table() == before
