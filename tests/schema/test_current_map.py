"""The map that views show: the chosen one, or the only one, and never one by chance."""

from __future__ import annotations

import pytest
from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import DBAPIError


def create_map(connection: Connection, name: str) -> int:
    made = connection.execute(
        text("INSERT INTO map (name) VALUES (:name) RETURNING id"), {"name": name}
    )
    return int(made.scalar_one())


def test_without_maps_views_are_empty_and_the_only_map_needs_no_choice(engine: Engine) -> None:
    with engine.begin() as connection:
        assert connection.exec_driver_sql("SELECT current_map()").scalar() is None
        assert connection.exec_driver_sql("SELECT count(*) FROM object").scalar() == 0
        first = create_map(connection, "first")
        assert connection.exec_driver_sql("SELECT current_map()").scalar() == first


@pytest.mark.parametrize(
    ("chosen", "message"),
    [("", "there are several maps, and none is chosen"), ("thrid", "there is no map thrid")],
)
def test_several_maps_need_a_choice(engine: Engine, chosen: str, message: str) -> None:
    with engine.begin() as connection:
        maps = {name: create_map(connection, name) for name in ("first", "second")}
        connection.execute(
            text("INSERT INTO entity (map_id, kind, name) VALUES (:map, 'object', 'mug')"),
            {"map": maps["first"]},
        )
    with engine.connect() as connection:
        choose = text("SELECT set_config('semmap.map', :name, false)")
        connection.execute(choose, {"name": "first"})
        assert connection.exec_driver_sql("SELECT current_map()").scalar() == maps["first"]
        connection.execute(choose, {"name": chosen})
        for question in ("SELECT current_map()", "SELECT * FROM object", "SELECT entity_id('mug')"):
            with pytest.raises(DBAPIError, match=message), connection.begin_nested():
                connection.exec_driver_sql(question)
