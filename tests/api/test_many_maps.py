"""Maps of one database share few connections."""

from __future__ import annotations

import semmap
from semmap.api.database import CONNECTED
from tests.conftest import MakeDatabase

SESSIONS = "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database()"


def test_150_maps_of_a_database_answer(make_database: MakeDatabase) -> None:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        for number in range(150):
            db.create_map(f"m{number}")
        maps = [db.map(f"m{number}") for number in range(150)]
        for number, each in enumerate(maps):
            each.add_room("hall", [(0, 0), (number + 1, 0), (number + 1, 1), (0, 1)], floor=0)
        for number, each in enumerate(maps):
            ((area,),) = each.sql(
                "SELECT ST_Area(w.footprint) FROM world w WHERE map_id = current_map() "
                "AND entity_id = entity_id('hall')"
            )
            assert area == number + 1
        row = db.session.execute(SESSIONS).fetchone()
        assert row is not None
        assert row[0] <= 2 * CONNECTED + 5


def test_a_transaction_stays_open_when_many_maps_connect(make_database: MakeDatabase) -> None:
    with semmap.connect(make_database().render_as_string(hide_password=False)) as db:
        first = db.create_map("first")
        with first.transaction():
            first.add_room("hall", [(0, 0), (1, 0), (1, 1), (0, 1)], floor=0)
            for number in range(2 * CONNECTED):
                assert not db.create_map(f"m{number}").rooms
            assert [room.name for room in first.rooms] == ["hall"]
        assert [room.name for room in first.rooms] == ["hall"]
