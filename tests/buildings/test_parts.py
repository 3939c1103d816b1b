"""Parts of the building by shape: what a name says yields to what covers a room, and comes back."""

from __future__ import annotations

from pathlib import Path

from sqlalchemy import Engine, text

import semmap
from tests.buildings.building import Building, Room
from tests.conftest import Import, MakeDatabase

HOUSE = "small_house/worlds/small_house.world"
ROOMS = Path(__file__).parents[1] / "worlds" / "small_house_rooms.geojson"


def types_of(engine: Engine, pattern: str) -> set[str]:
    with engine.connect() as connection:
        names = connection.execute(
            text("SELECT type FROM entity WHERE name LIKE :pattern"), {"pattern": pattern}
        )
        return set(names.scalars())


def test_carpets_of_the_house_stay_carpets(imported: Import, worlds: Path) -> None:
    with imported((worlds / HOUSE, "house")) as engine:
        assert types_of(engine, "Carpet%") == {"carpet"}
    with imported((worlds / HOUSE, "house"), (ROOMS, "house")) as engine:
        assert types_of(engine, "Carpet%") == {"carpet"}


def test_a_floor_named_as_furniture_is_a_floor_while_a_room_lies_on_it(
    make_database: MakeDatabase, tmp_path: Path
) -> None:
    building = Building(0, 0.3, (5.0, -2.0))
    building.storeys.append(("s", 0.0, 2.5))
    slab = building.add("work_table", "floor", (0, 0, 3, 3), -0.2, 0.0)
    mug = building.add("mug", "thing", (1, 1, 1.1, 1.1), 0.0, 0.1)
    building.rooms.append(Room("r", "s", slab.ground.buffer(-0.1), 0.0, 2.5))
    world, rooms = building.write(tmp_path)
    with semmap.connect(make_database().render_as_string(hide_password=False)) as database:
        database.import_file(world, map="b")
        place = database.map("b")
        before = place[slab.name].type
        assert before not in ("floor", "object")
        database.import_file(rooms, map="b")
        assert place[slab.name].type == "floor"
        holder = place[mug.name].holder
        assert holder is not None
        assert holder.name == "r"
        place["r"].delete()
        database.import_file(world, map="b")
        assert place[slab.name].type == before
