"""Entities of a type near a point: compared with brute force, and found by one plan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import psycopg
import pytest
from sqlalchemy import Engine

from semmap.query.entity_query import find
from tests.seen import seen_by


@pytest.fixture(scope="module")
def hall(module_engine: Engine) -> Engine:
    """20,000 things of 40 types, half of them below `ware`, and a relic, in 100 x 100 x 10 m."""
    with module_engine.begin() as connection:
        connection.exec_driver_sql(
            """
            INSERT INTO map (name) VALUES ('hall');
            INSERT INTO semantic_type (name)
                SELECT 'hall_ware' UNION ALL SELECT 'hall' || i FROM generate_series(1, 40) i;
            INSERT INTO type_parent (type, parent)
                SELECT 'hall' || i, CASE WHEN i <= 20 THEN 'hall_ware' ELSE 'object' END
                FROM generate_series(1, 40) i;
            INSERT INTO type_parent VALUES ('hall_ware', 'object');
            SELECT setseed(0.25);
            INSERT INTO entity (map_id, kind, name, type)
                SELECT current_map(), 'object', 'o' || i, 'hall' || 1 + i %% 40
                FROM generate_series(1, 20000) i;
            INSERT INTO semantic_type (name) VALUES ('hall_relic');
            INSERT INTO type_parent VALUES ('hall_relic', 'object');
            INSERT INTO entity (map_id, kind, name, type)
                SELECT current_map(), 'object', 'relic', 'hall_relic';
            INSERT INTO placement (entity_id, pose)
                SELECT id, ARRAY[100 * random(), 100 * random(), 10 * random(), 0, 0, 0, 1]
                FROM entity WHERE map_id = current_map();
            ANALYZE
            """
        )
    return module_engine


@pytest.fixture
def session(hall: Engine) -> Iterator[psycopg.Connection]:
    url = hall.url.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(url, autocommit=True) as session:
        session.execute("SET search_path = semmap, public; SET semmap.map = 'hall'")
        yield session


def names(session: psycopg.Connection, type_: str, point: Any, within: Any = None) -> list[str]:
    return [row["name"] for row in find(seen_by(session), type=type_, near=point, within=within)]


def brute_force(session: psycopg.Connection, point: tuple[float, float, float]) -> list[Any]:
    rows = session.execute(
        "SELECT e.name, w.pose FROM entity e JOIN world w ON w.entity_id = e.id "
        "WHERE e.type = ANY (subtypes('hall_ware'))"
    ).fetchall()
    positions = np.array([row[1][:3] for row in rows])
    distances = np.linalg.norm(positions - point, axis=1)
    return sorted((float(d), row[0]) for d, row in zip(distances, rows, strict=True))


@pytest.mark.parametrize("point", [(50.0, 50.0, 5.0), (0.0, 0.0, 0.0), (99.0, 1.0, 9.0)])
@pytest.mark.parametrize("within", [3.0, 30.0])
def test_near_and_nearest_are_those_of_brute_force(
    session: psycopg.Connection, point: tuple[float, float, float], within: float
) -> None:
    ordered = brute_force(session, point)
    near = names(session, "hall_ware", point, within)
    assert near == [name for d, name in ordered if d <= within]
    assert names(session, "hall_ware", point) == [name for _, name in ordered]


def test_far_from_everything_there_is_still_a_nearest(session: psycopg.Connection) -> None:
    one = names(session, "hall_ware", (5e4, 0, 0))[0]
    assert one == brute_force(session, (5e4, 0, 0))[0][1]
    assert names(session, "region", (0, 0, 0)) == []


@pytest.mark.parametrize("distance", [3.0, 50.0])
def test_numbers_of_every_kind_are_taken_and_nothing_else(
    session: psycopg.Connection, distance: float
) -> None:
    expected = names(session, "hall_ware", (50.0, 50.0, 5.0), distance)
    for kind in (int, np.float32, np.float64, np.int64):
        point = (kind(50), kind(50), kind(5))
        assert names(session, "hall_ware", point, kind(distance)) == expected
    for odd in (5e-324, -0.0, -1e-300):
        near = names(session, "hall_ware", (odd, odd, odd), distance)
        assert near == names(session, "hall_ware", (0.0, 0.0, 0.0), distance)
    assert names(session, "hall_ware", (1e20, 0, 0), distance) == []
    for wrong in (math.nan, math.inf, "(SELECT 1)", "0); DROP TABLE map; --"):
        with pytest.raises(ValueError, match=r"finite|could not convert"):
            names(session, "hall_ware", (wrong, 0.0, 0.0), distance)
    for wrong in (math.nan, math.inf, -1.0):
        with pytest.raises(ValueError, match="within takes metres from 0 on"):
            names(session, "hall_ware", (0.0, 0.0, 0.0), wrong)


def test_one_plan_on_the_index_serves_all_places(session: psycopg.Connection) -> None:
    """PostgreSQL plans a prepared statement five times, then keeps a plan unless it looks dear."""
    for i in range(12):
        names(session, "hall_ware", (5.0 * i, 50.0, 5.0), 3.0)
    name, parameters, generic, custom = session.execute(
        "SELECT name, cardinality(parameter_types), generic_plans, custom_plans "
        "FROM pg_prepared_statements WHERE statement LIKE '%shape_distance%'"
    ).fetchone()
    assert custom <= 5 < generic + custom
    session.execute("SET plan_cache_mode = force_generic_plan")
    nothing = ", ".join(["NULL"] * parameters)
    plan = "\n".join(row[0] for row in session.execute(f'EXPLAIN EXECUTE "{name}" ({nothing})'))
    assert "world_flat" in plan
    assert "Seq Scan" not in plan


def test_a_rare_and_far_type_is_not_searched_place_by_place(session: psycopg.Connection) -> None:
    """Where a place is wide, the few of a type are the beginning, however often it was asked."""
    session.execute("LOAD 'auto_explain'")
    session.execute("SET auto_explain.log_min_duration = 0; SET client_min_messages = log")
    plans: list[str] = []
    session.add_notice_handler(lambda notice: plans.append(notice.message_primary or ""))
    for i in range(12):
        assert names(session, "hall_relic", (40.0 + i, 50.0, 5.0), 90.0) == ["relic"]
    prepared = session.execute(
        "SELECT FROM pg_prepared_statements WHERE statement LIKE '%shape_distance%'"
    )
    assert prepared.fetchall() == []
    asked = [plan for plan in plans if "AS distance" in plan]
    assert len(asked) == 12
    assert all("object_type_pkey" in plan and "world_flat" not in plan for plan in asked)
