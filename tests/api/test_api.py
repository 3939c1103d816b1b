"""The public API on a real database: maps, entities by name, questions, changes, refusals."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapely
from sqlalchemy import func, select
from sqlalchemy.exc import DBAPIError

import semmap
from semmap.database.revisions import newest
from semmap.model import Entity, Object, WorldPlacement
from tests.command_line import semmap as semmap_cli
from tests.ingest.worlds_by_hand import box_world
from tests.next_revision import next_revision


def names(entities: list[semmap.MapEntity]) -> list[str]:
    return [entity.name for entity in entities]


def test_maps_are_made_listed_and_dropped(db: semmap.Database) -> None:
    assert db.maps == []
    with pytest.raises(LookupError, match="there is no map yet"):
        db.map()
    db.create_map("flat")
    assert db.map().name == "flat"
    db.create_map("office")
    assert db.maps == ["flat", "office"]
    with pytest.raises(LookupError, match="there are several maps: flat, office"):
        db.map()
    with pytest.raises(LookupError, match="there is no map offic; there are: flat, office"):
        db.map("offic")
    with pytest.raises(ValueError, match="there is a map flat already"):
        db.create_map("flat")
    assert db.drop_map("flat") == 0
    assert db.maps == ["office"]


def test_chosen_map_is_that_of_later_sessions(db: semmap.Database, database: str) -> None:
    db.create_map("flat")
    db.create_map("office")
    db.use("flat")
    with semmap.connect(database) as later:
        assert later.map().name == "flat"
    shown = semmap_cli(database, "sql", "SELECT name FROM map WHERE id = current_map()")
    assert "flat" in shown.stdout, "its login is another one, which only reads"


def test_added_entities_have_holders_poses_and_types(flat: semmap.Map) -> None:
    desk, mug = flat["desk4"], flat["mug7"]
    assert desk.holder == flat["kitchen"]
    assert mug.holder == desk
    assert desk.contents == [mug]
    assert mug.pose is not None
    assert mug.pose[:3] == pytest.approx((2, 1.5, 0.8))
    assert desk.is_a("furniture")
    assert not mug.is_a("furniture")
    assert mug.properties == {"colour": "red"}
    assert flat["kitchen"].holder == flat["ground"]
    assert flat.check() == []


def test_door_leads_from_place_to_place(flat: semmap.Map) -> None:
    for name, a, b in (
        ("kitchen_to_hall", "kitchen", "hall"),
        ("hall_to_kitchen", "hall", "kitchen"),
    ):
        for line in (((4.05, 1), (4.05, 2)), ((4.05, 2), (4.05, 1))):
            door = flat.add_door(f"{name}{line[0][1]}", a, b, line)
            joins = door.describe()["joins"]
            assert (joins["place_a"], joins["place_b"], joins["width"]) == (a, b, 1)
            assert door.pose is not None
            stand = door.pose @ semmap.Pose(*joins["pose_a"])
            assert flat.find(near=(stand.x, stand.y, 1), within=0, box=(0, 0, 0, 9, 9, 2))
            assert (stand.x < 4) == (a == "kitchen")


def test_moves_change_the_holder(flat: semmap.Map) -> None:
    mug = flat["mug7"]
    mug.move_to(6, 1, 0.05, 0.3)
    assert mug.holder == flat["hall"]
    assert flat["desk4"].contents == []
    mug.put_on("desk4")
    assert mug.holder == flat["desk4"]
    assert mug.pose is not None
    assert mug.pose.yaw == pytest.approx(0.3)
    mug.put_in(flat["hall"])
    assert mug.holder == flat["hall"]
    assert mug.pose.z == pytest.approx(0.05)
    mug.delete()
    assert "mug7" not in flat
    assert flat.check() == []


def test_questions(flat: semmap.Map) -> None:
    assert names(flat.find("table", near=(1, 2, 0), within=3)) == ["desk4"]
    assert flat.find("table", near=(100, 2, 0), within=3) == []
    assert names(flat.find("object", near="mug7")[:2]) == ["mug7", "desk4"]
    assert names(flat.find(where={"colour": "red"})) == ["mug7"]
    assert names(flat.find(in_="kitchen")) == ["desk4", "mug7"]
    assert names(flat.find(label="kitchen")) == ["kitchen"]
    assert names(flat.find("object", box=(0, 0, 0, 1.3, 1.5, 0.5))) == ["desk4"]
    assert len(flat) == len(list(flat)) == 6
    assert "mug7" in flat
    assert {"table", "furniture"} <= {row["name"] for row in flat.types()}


def test_changes_are_followed(flat: semmap.Map, database: str) -> None:
    assert next(flat.changes()).what == "added"

    def move_later() -> None:
        started.wait()
        with semmap.connect(database) as other:
            other.map("flat")["mug7"].move_to(1, 1, 0.05)

    started = threading.Event()
    mover = threading.Thread(target=move_later)
    mover.start()
    changes = flat.changes(follow=True)
    started.set()
    change = next(changes)
    changes.close()  # type: ignore[attr-defined]
    mover.join()
    assert (change.what, change.name) == ("moved", "mug7")
    assert list(flat.changes(change.cursor)) == []


def test_files_are_imported(flat: semmap.Map, tmp_path: Path) -> None:
    summary = flat.import_file(box_world(tmp_path, {"crate": (6, 1, 0.4)}))
    assert (summary.map, summary.added) == ("flat", 1)
    assert flat["crate"].holder == flat["hall"]


REFUSED: list[tuple[Callable[[semmap.Map], Any], str]] = [
    (lambda flat: flat["mug"], "the map has no entity mug; did you mean mug7?"),
    (lambda flat: flat.add_object("mug7"), "the map has an entity mug7 already"),
    (lambda flat: flat.add_object(""), "the object needs a name"),
    (lambda flat: flat.add_room("outside", [(0, 0), (1, 0), (1, 1)]), "give another name"),
    (lambda flat: flat.add_object("a", size=(1, 0, 1)), "the size of a is three lengths above 0"),
    (lambda flat: flat.add_object("a", size=(1, 1, 1), mesh="x.stl"), "a mesh or a size, not both"),
    (lambda flat: flat.add_object("a", pose=(1, float("nan"), 0)), "the pose of a is"),
    (lambda flat: flat.add_object("a", on="desk4", in_="hall"), "on desk4 or in hall, not both"),
    (
        lambda flat: flat.add_object("a", size=(1, 1, 1), pose=(99, 0, 0), in_="hall"),
        "not in or on",
    ),
    (lambda flat: flat.add_object("a", on="door1"), "door1 has no geometry"),
    (lambda flat: flat.add_room("r", [(0, 0), (1, 1), (0, 1), (1, 0)]), "is not valid"),
    (lambda flat: flat.add_room("r", shapely.Point(0, 0)), "is a Point, not a polygon"),
    (lambda flat: flat.add_room("r", shapely.box(0, 0, 1, 1), floor=2, ceiling=1), "not above"),
    (lambda flat: flat.add_door("d", "kitchen", "bath", ((0, 0), (1, 0))), "no entity bath"),
    (lambda flat: flat.add_door("d", "kitchen", None, ((0, 0), (0, 0))), "is two points"),
    (lambda flat: flat["mug7"].move_to(float("inf"), 0, 0), "is moved to finite numbers"),
    (
        lambda flat: setattr(flat["mug7"], "type", "mugg"),
        "the map has no type mugg; did you mean mug",
    ),
    (lambda flat: flat.find("tabel"), "the map has no type tabel; did you mean table"),
    (lambda flat: flat.find(near=(1, 2)), "a point has 3 finite numbers"),
    (lambda flat: flat.find(within=2), "within needs near"),
    (lambda flat: flat.find(box=(1, 1, 1, 0, 0, 0)), "a box has its lowest corner first"),
    (lambda flat: list(flat.changes("now")), "now is not a cursor"),
]


@pytest.mark.parametrize(("call", "says"), REFUSED, ids=[says for _, says in REFUSED])
def test_bad_input_is_refused_and_changes_nothing(
    flat: semmap.Map, call: Callable[[semmap.Map], Any], says: str
) -> None:
    before = flat.table()
    with pytest.raises((ValueError, LookupError), match=says.replace("?", r"\?")):
        call(flat)
    assert flat.table() == before


def test_orm_sees_one_map(db: semmap.Database, flat: semmap.Map) -> None:
    other = db.create_map("other")
    other.add_object("table1", type="table", size=(1, 1, 1), pose=(0, 0, 0))
    with flat.session() as session:
        with pytest.raises(DBAPIError, match="no entity named table1"), session.begin_nested():
            session.scalar(select(func.entity_id("table1")))
        found = session.scalars(
            select(Object).where(Object.map_id == func.current_map(), Object.is_a("furniture"))
        ).all()
        assert [o.name for o in found] == ["desk4"]
        area = select(func.ST_Area(WorldPlacement.footprint)).where(
            WorldPlacement.entity_id == found[0].id
        )
        assert session.scalar(area) == pytest.approx(1.28)
        inside = (
            select(Object.name)
            .join(Object.world)
            .where(WorldPlacement.footprint.ST_Intersects("POLYGON((0 0, 4 0, 4 3, 0 3, 0 0))"))
        )
        assert set(session.scalars(inside)) == {"desk4", "mug7", "table1"}


def test_orm_keeps_changed_properties_and_states_holders(flat: semmap.Map) -> None:
    with flat.session() as session:
        mug = session.scalars(select(Object).where(Object.name == "mug7")).one()
        mug.properties["colour"] = "blue"
        assert mug.placement is not None
        mug.placement.confidence = 0.4
        session.commit()
        assert mug.placement.confidence == pytest.approx(0.4)
        kitchen = session.get_one(Entity, flat["kitchen"].id)
        mug.placement.holder = kitchen
        assert mug.placement.confidence is None
        session.rollback()
    assert flat["mug7"].properties == {"colour": "blue"}


def test_old_schema_is_refused_and_stays(db: semmap.Database, database: str) -> None:
    former = newest()
    expected = rf"at revision {former}.*semmap db upgrade"
    with next_revision(), pytest.raises(semmap.DatabaseError, match=expected):
        semmap.connect(database)
    row = db.session.execute("SELECT version_num FROM public.semmap_version").fetchone()
    assert row == (former,)


def test_database_without_schema_is_refused_and_stays_empty(
    db: semmap.Database, database: str
) -> None:
    db.session.execute("DROP SCHEMA semmap CASCADE; DROP TABLE public.semmap_version")
    with pytest.raises(semmap.DatabaseError, match=r"no semmap schema: semmap db upgrade"):
        semmap.connect(database)
    assert db.session.execute("SELECT to_regnamespace('semmap')").fetchone() == (None,)


def test_a_table_takes_as_many_plates_as_tiles_fit_on_it(flat: semmap.Map) -> None:
    flat.add_object("tray", size=(1.0, 0.6, 0.5), pose=(5, 3, 0))
    for n in range(15):
        flat.add_object(f"tile{n}", size=(0.2, 0.2, 0.02), on="tray")
    grounds = shapely.union_all([flat[f"tile{n}"].footprint for n in range(15)])
    assert grounds.area == pytest.approx(0.6, abs=1e-3)
    with pytest.raises(ValueError, match="is free: give a pose"):
        flat.add_object("tile15", size=(0.2, 0.2, 0.02), on="tray")


def test_a_door_is_at_the_walls_of_both_rooms(db: semmap.Database) -> None:
    """Its line may begin at a corner of both rooms, and lie in a third one."""
    place = db.create_map("corner")
    for name, box in (("a", (0, 0, 4, 4)), ("c", (0, 4.1, 4, 8)), ("e", (4.1, 0, 8, 8))):
        place.add_room(name, shapely.box(*box))
    with pytest.raises(ValueError, match=r"d ends 0\.80 m beside a, which it joins: draw it"):
        place.add_door("d", "a", "c", ((4.1, 4.05), (4.8, 4.05)))
    assert len(place.doors) == 0
    place.add_door("d", "a", "c", ((3.0, 4.05), (3.9, 4.05)))
    assert place.route("a", "c").metres > 0


def test_things_on_one_table_stand_side_by_side_until_it_is_full(flat: semmap.Map) -> None:
    flat.add_object("stool", size=(0.4, 0.4, 0.5), pose=(5, 3, 0))
    for n in range(4):
        flat.add_object(f"cup{n}", size=(0.1, 0.1, 0.1), on="stool")
    grounds = [flat[f"cup{n}"].footprint for n in range(4)]
    stool = flat["stool"].footprint
    assert stool is not None
    for n, ground in enumerate(grounds):
        assert ground is not None
        assert flat[f"cup{n}"].holder == flat["stool"]
        assert stool.buffer(1e-6).covers(ground)
        assert all(ground.intersection(other).area < 1e-6 for other in grounds[:n])
    with pytest.raises(
        ValueError, match=r"on stool no place of 0.25 x 0.25 m is free: give a pose"
    ):
        flat.add_object("pot", size=(0.25, 0.25, 0.2), on="stool")
    assert "pot" not in flat
    mug = flat["mug7"]
    mug.put_on("stool")
    assert all(mug.footprint.intersection(g).area < 1e-6 for g in grounds)  # type: ignore[union-attr]
    mug.put_on("stool")
    assert flat.check() == []


def test_unknown_type_is_refused_unless_it_is_defined(flat: semmap.Map) -> None:
    before = len(flat)
    with pytest.raises(LookupError, match=r"the map has no type balll.*ball"):
        flat.add_object("toy", type="balll", size=(0.1, 0.1, 0.1), in_="kitchen")
    with pytest.raises(LookupError, match=r"the map has no type zyx.*define=True adds it"):
        flat.add_agent("helper", type="zyx", in_="kitchen")
    assert len(flat) == before
    assert flat.add_object("toy", type="balll", in_="kitchen", define=True).is_a("balll")


def test_a_room_is_on_the_storey_that_is_named_or_refused(flat: semmap.Map) -> None:
    corners = [(0, 0), (3, 0), (3, 3), (0, 3)]
    flat.add_storey("upper", elevation=13.1)
    flat.add_storey("top", elevation=16.2)
    for floor in (0.0, 12.5, 16.2, 17.0):
        with pytest.raises(ValueError, match=r"is not on upper, which is from 13.1 to 16.2 m"):
            flat.add_room("attic", corners, floor=floor, storey="upper")
        assert "attic" not in flat
    for name, floor, storey in (
        ("sunk", 12.7, "upper"),
        ("level", 13.1, "upper"),
        ("gallery", 15.0, "upper"),
        ("roof", 19.0, "top"),
    ):
        flat.add_room(name, corners, floor=floor, storey=storey)
        held = flat[name].holder
        assert held is not None
        assert held.name == storey
