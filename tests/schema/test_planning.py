"""What joins cost before they run: Figure 3 is planned from the catalogue alone."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import shapely
from sqlalchemy import Connection, Engine, text

import semmap

FIGURE_3 = (Path(__file__).parents[2] / "benchmarks" / "figure3.sql").read_text()
KEYS = ("object_type_id", "placement_holder", "entity_chunk_entity")

KITCHENS = """
SET LOCAL semmap.deriving = 'off';
INSERT INTO map (name) VALUES ('kitchens');
INSERT INTO model (digest, kind, triangles, closed, hull)
    SELECT 'unit box', 'box', 12, true, ST_Collect(ST_MakePoint(i %% 2, i / 2 %% 2, i / 4))
    FROM generate_series(0, 7) i;
INSERT INTO chunk (model_id, number, geom)
    SELECT id, 0, prism_tin(ST_MakeEnvelope(0, 0, 1, 1), 0, 1) FROM model WHERE digest = 'unit box';
INSERT INTO semantic_type (name) VALUES ('muffin'), ('table') ON CONFLICT DO NOTHING;
INSERT INTO entity (map_id, kind, name, type)
    SELECT current_map(), CASE kind WHEN 'room' THEN 'room' ELSE 'object' END, kind || i, kind
    FROM (VALUES ('room', 20), ('table', 400), ('muffin', 4000)) v (kind, n),
         generate_series(1, n) i;
INSERT INTO entity_model (entity_id, model_id)
    SELECT e.id, m.id FROM entity e, model m WHERE e.map_id = current_map() AND e.kind = 'object';
INSERT INTO placement (entity_id, pose)
    SELECT id, ARRAY[10 * substr(name, 5)::int, 0, 0, 0, 0, 0, 1] FROM entity WHERE type = 'room';
INSERT INTO placement (entity_id, holder_id, pose)
    SELECT id, entity_id('room' || 1 + i %% 20), planar_pose(0, 20.0 * (i / 20))
    FROM (SELECT id, substr(name, 6)::int AS i FROM entity WHERE type = 'table') t;
INSERT INTO placement (entity_id, holder_id)
    SELECT id, entity_id('table' || 1 + substr(name, 7)::int %% 400)
    FROM entity WHERE type = 'muffin';
ANALYZE
"""


@pytest.fixture(scope="module")
def kitchens(module_engine: Engine) -> Engine:
    """20 rooms, 400 tables in them, and 4,000 muffins on these."""
    with module_engine.begin() as connection:
        connection.exec_driver_sql(KITCHENS)
    return module_engine


def pages_to_plan(connection: Connection) -> int:
    """The pages that planning Figure 3 reads once its catalogue is at hand."""
    for _ in range(3):
        (said,) = connection.exec_driver_sql(f"EXPLAIN (BUFFERS, FORMAT JSON) {FIGURE_3}").scalars()
    planning: dict[str, int] = said[0]["Planning"]
    return planning["Shared Hit Blocks"] + planning["Shared Read Blocks"]


def test_figure_3_is_planned_without_a_look_at_the_tables(kitchens: Engine) -> None:
    with kitchens.connect() as connection:
        assert len(connection.exec_driver_sql(FIGURE_3).all()) == 400
        assert pages_to_plan(connection) == 0


def test_with_histograms_tables_would_be_read_to_plan(kitchens: Engine) -> None:
    with kitchens.connect() as connection:
        for column in ("placement ALTER entity_id", "entity_chunk ALTER id"):
            connection.execute(text(f"ALTER TABLE {column} SET STATISTICS -1"))
        connection.execute(text("ANALYZE placement, entity_chunk"))
        assert pages_to_plan(connection) > 0


def test_no_worker_is_weighed(kitchens: Engine) -> None:
    """A plan of workers for each of them would be made at each question, and thrown away."""
    with kitchens.connect() as connection:
        for setting in (
            "parallel_setup_cost",
            "parallel_tuple_cost",
            "min_parallel_table_scan_size",
        ):
            connection.execute(text(f"SET LOCAL {setting} = 0"))
        plan = "\n".join(connection.exec_driver_sql(f"EXPLAIN {FIGURE_3}").scalars())
        assert "Gather" not in plan


@pytest.mark.parametrize("index", KEYS)
def test_an_index_on_all_rows_would_be_read_to_plan(kitchens: Engine, index: str) -> None:
    """Why the indexes have a condition that always holds: without it there are pages to read."""
    with kitchens.connect() as connection:
        definition = connection.execute(
            text("SELECT pg_get_indexdef(CAST(:index AS regclass))"), {"index": index}
        ).scalar_one()
        whole, _, condition = definition.partition(" WHERE ")
        assert condition
        connection.execute(text(f"DROP INDEX {index}"))
        connection.execute(text(whole))
        assert pages_to_plan(connection) > 0


@pytest.mark.parametrize(
    "lookup",
    [
        "object_type WHERE id = 7 AND type = 'table'",
        "object_type WHERE id = ANY (ARRAY[1, 2, 3]::bigint[])",
        "placement WHERE holder_id = 7",
        "placement WHERE holder_id IN (SELECT generate_series(1, 3))",
        "entity_chunk WHERE entity_id = 7",
    ],
)
def test_a_lookup_by_a_key_uses_its_index(kitchens: Engine, lookup: str) -> None:
    with kitchens.connect() as connection:
        connection.execute(text("SET LOCAL enable_seqscan = off"))
        plan = "\n".join(connection.exec_driver_sql(f"EXPLAIN SELECT * FROM {lookup}").scalars())
        assert any(index in plan for index in KEYS), plan
        assert "Seq Scan" not in plan


ROOMS, THINGS = 40, 400

AUTO_EXPLAIN = {
    "auto_explain.log_min_duration": "0",
    "auto_explain.log_nested_statements": "on",
    "auto_explain.log_analyze": "on",
    "client_min_messages": "log",
}

MANY = """
WITH model AS (SELECT model_id FROM entity_model WHERE entity_id = entity_id('first')),
     thing AS (INSERT INTO entity (map_id, kind, name)
               SELECT current_map(), 'object', 'thing' || i FROM generate_series(0, {things} - 1) i
               RETURNING id, substr(name, 6)::integer AS i),
     shape AS (INSERT INTO entity_model (entity_id, model_id) SELECT id, model_id FROM thing, model)
INSERT INTO placement (entity_id, pose)
SELECT id, ARRAY[i % {rooms} * 5 + 1 + i / {rooms} * 0.3, 1, 0.05, 0, 0, 0, 1] FROM thing
"""


def test_holders_of_many_things_compare_no_thing_with_each_room(database: str) -> None:
    plans: list[str] = []
    with semmap.connect(database) as db:
        place = db.create_map("hotel")
        with place.transaction():
            for i in range(ROOMS):
                outline = shapely.box(5 * i, 0, 5 * i + 5, 4)
                place.add_room(f"room{i}", outline, floor=0, ceiling=3)
            place.add_object("first", size=(0.1, 0.1, 0.1), pose=(1, 3, 0.05))
        session = place.connection
        session.execute("LOAD 'auto_explain'")
        for name, value in AUTO_EXPLAIN.items():
            session.execute(f"SET {name} = {value}")
        session.add_notice_handler(lambda notice: plans.append(str(notice.message_primary)))
        with place.transaction():
            session.execute(MANY.format(things=THINGS, rooms=ROOMS))
        assert place["thing0"].holder == place["room0"]
        assert len(place["room7"].contents) == THINGS // ROOMS
    removed = [int(n) for plan in plans for n in re.findall(r"Removed by .*Filter: (\d+)", plan)]
    assert any("around" in plan for plan in plans)
    assert max(removed) < 3 * (THINGS + ROOMS)  # with each room, 15,600
