"""Where things are believed to be in worlds that others made; counts and distances by hand."""

from __future__ import annotations

import re
from collections.abc import Iterator

import psycopg
import pytest
from sqlalchemy import Engine

import semmap
from semmap import Map

KITCHEN, COFFEE, NIGHT = "KitchenTable_01_001", "CoffeeTable_01_001", "NightStand_01_001"


@pytest.fixture(scope="module")
def world_map(house: Engine) -> Iterator[Map]:
    with semmap.connect(house.url.render_as_string(hide_password=False)) as db:
        yield db.map("house")


@pytest.fixture
def here(world_map: Map) -> Iterator[Map]:
    """The small house with two mugs, the second on a table; what a test changes is undone."""
    with world_map.transaction() as transaction:
        world_map.add_object("mug1", type="mug", size=(0.08, 0.08, 0.1))
        world_map.add_object("mug2", type="mug", size=(0.08, 0.08, 0.1), on=KITCHEN)
        yield world_map
        raise psycopg.Rollback(transaction)


@pytest.mark.parametrize(
    ("place", "options", "message"),
    [
        (KITCHEN, {"position": (5000.0, 0.0, 0.8)}, "499[0-9].* m outside of KitchenTable"),
        ("kitchen", {"position": (5000.0, 0.0, 0.8)}, "m outside of kitchen"),
        (KITCHEN, {"hit": 0.1, "false_alarm": 0.2}, "hit, 0.1, is not above false_alarm"),
        (KITCHEN, {"hit": 0.2, "false_alarm": 0.2}, "hit, 0.2, is not above false_alarm, 0.2"),
    ],
)
def test_impossible_sightings_are_refused(
    here: Map, place: str, options: dict[str, float], message: str
) -> None:
    with pytest.raises(ValueError, match=message), here.transaction():
        here.observe("mug1", place, **options)  # type: ignore[arg-type]
    assert here.execute("SELECT count(*) FROM observation") == [(0,)]


def test_one_thing_is_not_on_two_tables(here: Map) -> None:
    seen = [{"object": "mug1", "place": place} for place in (KITCHEN, COFFEE)]
    on = [{"subject": "mug1", "relation": "on", "object": row["place"]} for row in seen]
    for taught in ({"observations": seen}, {"relations": on}):
        with pytest.raises(ValueError, match="at the same time"), here.transaction():
            here.teach(taught)
    assert here.execute("SELECT count(*) FROM observation") == [(0,)]


def test_what_was_just_put_on_a_table_is_there(here: Map) -> None:
    assert here.where("mug2")[KITCHEN] > 0.95
    here["mug2"].put_on(NIGHT)
    assert here.where("mug2")[NIGHT] > 0.95
    ball = here["Ball_01_001"]
    assert here.where(ball.name)[str(ball.room.name)] > 0.9


def test_each_object_is_where_the_map_has_it_and_parts_of_the_building_have_no_belief(
    here: Map,
) -> None:
    """Also what is larger than its room is thought to have space for, such as a carpet."""
    parts = []
    for thing in here.objects:
        chain = [thing.holder, thing.room]
        places = {str(place.name) for place in chain if place is not None}
        if re.match("Floor|.*Door_|.*Wall|RoomWindow", thing.name):
            parts.append(thing.name)
            with pytest.raises(ValueError, match=f"{thing.name} is a part of the building"):
                here.where(thing.name)
            with pytest.raises(ValueError, match="does not move"), here.transaction():
                here.observe(thing.name, KITCHEN)
        elif places:
            assert here.where(thing.name).best in places, thing.name
            assert here.where(thing.name)[here.where(thing.name).best] > 0.8, thing.name
    assert len(parts) > 10


def test_one_sighting_outweighs_all_other_places(here: Map) -> None:
    """Of a mug that the map has nowhere, and of one that it has on another table."""
    for name in ("mug1", "mug2"):
        assert len(here.where(name)) > 25
        here.observe(name, COFFEE)
        assert here.where(name)[COFFEE] > 0.95
        here.observe(name, NIGHT)  # seconds later
        assert here.where(name)[NIGHT] > 0.9
        here.observe(name, COFFEE)
        here.observe(name, COFFEE)
        assert here.where(name)[COFFEE] > 0.99
        for _ in range(8):
            here.observe(name, COFFEE, seen=False)
        assert here.where(name)[COFFEE] < 0.5


def test_things_are_not_expected_where_nobody_keeps_them(here: Map) -> None:
    """Cereals: not on air conditioners, hoods and curtains, and more on large tables than small."""
    here.add_object("cereal", type="food", size=(0.2, 0.08, 0.3))
    found = here.where("cereal")
    rare = [name for name in found if name.startswith(("Aircond", "Rangehood", "Curtain", "Trash"))]
    assert len(rare) >= 5
    assert max(found[name] for name in rare) < 0.001
    kitchen = {str(each.name) for each in here.find(in_="kitchen")} | {"kitchen"}
    assert sum(found[name] for name in kitchen & set(found)) > 0.6
    assert found["kitchen"] < found[KITCHEN], "a floor keeps less than a table"
    assert found["Bed_01_001"] < found[KITCHEN] / 2
    assert found[NIGHT] < found[KITCHEN]


def test_cabins_of_lifts_keep_nothing(hotel: Engine) -> None:
    with semmap.connect(hotel.url.render_as_string(hide_password=False)) as db:
        building = db.map("hotel")
        building.execute(
            "INSERT INTO entity (map_id, kind, name, type) "
            "SELECT current_map(), 'object', 'oats', 'food'"
        )
        found = building.where("oats")
        cabins = {str(each.name) for each in building.find(type="elevator_cabin")}
        rooms = {str(each.name): each.footprint for each in building.find("room", limit=200)}
        assert len(cabins) == 6
        assert sum(found[name] for name in cabins) < 0.001
        areas = {name: shape.area for name, shape in rooms.items() if name not in cabins and shape}
        of_type = {name: building[name].type for name in areas}
        plain = [name for name in areas if of_type[name] in (None, "room", "hotel_room")]
        share = [found[name] / areas[name] for name in plain]
        assert len(share) > 5
        assert max(share) == pytest.approx(min(share), rel=1e-6), "by area"
        building["oats"].delete()


def test_any_thing_of_a_type_is_where_those_of_the_type_are(here: Map) -> None:
    here.teach(
        {
            "relations": [{"subject": "sodacan", "relation": "isA", "object": "can"}],
            "objects": [{"name": name, "clas": "sodacan"} for name in ("coke", "pepsi")],
        }
    )
    here.observe("coke", KITCHEN)
    here.observe("pepsi", NIGHT)
    found = here.where("sodacan")
    one, other = here.where("coke"), here.where("pepsi")
    assert sum(found.values()) == pytest.approx(1)
    for place in one:
        assert found[place] == pytest.approx((one[place] + other[place]) / 2, abs=1e-4)
    assert set(list(found)[:2]) == {KITCHEN, NIGHT}
    assert here.where("can")[NIGHT] == pytest.approx(found[NIGHT], abs=1e-4), "a supertype"
    with pytest.raises(LookupError, match="the map has no apple: add or teach an object"):
        here.where("apple")
    with pytest.raises(LookupError, match="the map has no entity coek; did you mean coke"):
        here.where("coek")
