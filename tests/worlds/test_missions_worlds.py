"""Missions in the small house, the hotel and the clinic: what could happen there, and what not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Engine, text

import semmap
from semmap import Map
from semmap.database.maps import see_map

CAN = Path("ycb/meshes/005_tomato_soup_can_textured.gltf")
ON_TABLE = (5.86, 0.87, 0.80135)
"""Where the can stands on the kitchen table of the small house."""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of simulated worlds go into the test's folder."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def db(house_and_hotel: Engine, worlds: Path) -> Iterator[semmap.Database]:
    """The small house with a can on its kitchen table, and the hotel."""
    with semmap.connect(house_and_hotel.url.render_as_string(hide_password=False)) as db:
        db.map("house").add_object("can", type="can", mesh=worlds / CAN, pose=ON_TABLE)
        yield db


@pytest.fixture
def house(db: semmap.Database) -> Map:
    return db.map("house")


@pytest.fixture
def hotel(db: semmap.Database) -> Map:
    return db.map("hotel")


def run(map_: Map, goal: str, **options: Any) -> Any:
    """A simulated mission without trials of grasps."""
    return map_.run(goal, **{"speed": 1e5, "try_grasps": False, **options})


def subjects(ended: Any, action: str) -> list[str]:
    """The first argument of each step of a kind."""
    return [step["arguments"][0] for step in ended.steps if step["action"] == action]


def change(map_: Map, statement: str, **values: Any) -> None:
    """Change a map as another program does."""
    with map_.database.engine.begin() as connection:
        see_map(connection, map_.name)
        connection.execute(text(statement), values)


def agents(map_: Map) -> set[str]:
    """The names of the agents of a map."""
    with map_.database.engine.connect() as connection:
        see_map(connection, map_.name)
        found = "SELECT name FROM entity WHERE map_id = current_map() AND kind = 'agent'"
        return set(connection.execute(text(found)).scalars())


# -- failures on demand ---------------------------------------------------------------------------


def test_a_mission_takes_another_lift_than_the_broken_one(hotel: Map) -> None:
    goal, start = "in(robot, L3-room1)", {"start": "lobby"}
    (planned,) = set(subjects(run(hotel, goal, **start), "use_elevator"))
    (other,) = {"Lift1", "Lift2"} - {planned}
    ended = run(hotel, goal, **start, fail=[f"{planned} broken"])
    assert ended.done
    assert subjects(ended, "use_elevator") == [other]
    assert set(subjects(ended, "call_elevator")) == {planned, other}
    ended = run(hotel, goal, **start, fail=["Lift1 broken", "Lift2 broken"])
    assert not ended.done
    assert "call_elevator of Lift1 failed" in ended.reason
    assert "call_elevator of Lift2 failed" in ended.reason
    assert subjects(ended, "use_elevator") == []


def test_a_door_whose_name_has_blanks_is_locked(house: Map) -> None:
    rename = "UPDATE entity SET name = :new WHERE id = entity_id(:old)"
    change(house, rename, old="bedroom-door", new="the bedroom's door")
    try:
        ended = run(
            house, "in(robot, bedroom)", start="kitchen", fail=["the bedroom's door locked"]
        )
    finally:
        change(house, rename, new="bedroom-door", old="the bedroom's door")
    assert (ended.state, ended.steps[-1]["cause"]) == ("failed", "locked")
    assert "the bedroom's door is locked" in ended.reason


# -- refused options ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fail": ["kitchen-dor locked"]}, "no door kitchen-dor; did you mean kitchen-door"),
        ({"fail": ["Lift1 broken"]}, "no elevator Lift1"),
        ({"put": ["can on the moon"]}, "no room holds the moon"),
        ({"put": ["can"]}, "is not 'OBJECT on PLACE'"),
        ({"speed": -1.0}, "speed is -1"),
        ({"gripper": "claw"}, "no gripper claw"),
        ({"robot": "crawler"}, "no robot class named crawler"),
        ({"start": "cellar"}, "no place named cellar"),
        ({"agent": "nobody", "start": None}, "no robot named nobody"),
        ({"agent": "can"}, "can is of kind object"),
        ({"goal": "found(moon)"}, "no entity moon"),
    ],
)
def test_a_refused_option_leaves_no_mission_and_no_robot(
    house: Map, options: dict[str, Any], message: str
) -> None:
    before = house.missions(), agents(house)
    goal = options.pop("goal", "in(can, bedroom)")
    with pytest.raises((ValueError, LookupError, semmap.Error), match=message):
        run(house, goal, **{"start": "kitchen", "apply": True, **options})
    assert (house.missions(), agents(house)) == before
    assert not [*Path().rglob("*.sqlite")]
