"""What of a type is near: against brute force, and with the plan that makes it fast."""

from __future__ import annotations

import math

import numpy as np
import pytest
from sqlalchemy import Engine, text
from sqlalchemy.orm import Session

from semmap.query.nearby import FAR, nearest_of_type, of_type_near

COUNT = 20_000
PREPARED_AFTER = 5
"""Times that psycopg asks before it prepares."""


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


def brute_force(session: Session, point: tuple[float, float, float]) -> list[tuple[float, int]]:
    rows = session.execute(
        text(
            "SELECT e.id, w.pose FROM entity e JOIN world w ON w.entity_id = e.id "
            "WHERE e.type = ANY (subtypes('hall_ware'))"
        )
    ).all()
    positions = np.array([row[1][:3] for row in rows])
    distances = np.linalg.norm(positions - point, axis=1)
    return sorted((float(d), row[0]) for d, row in zip(distances, rows, strict=True))


@pytest.mark.parametrize("point", [(50.0, 50.0, 5.0), (0.0, 0.0, 0.0), (99.0, 1.0, 9.0)])
def test_near_and_nearest_are_those_of_brute_force(
    hall: Engine, point: tuple[float, float, float]
) -> None:
    with Session(hall) as session:
        ordered = brute_force(session, point)
        near = [e.id for e in of_type_near(session, "hall_ware", point, 3.0)]
        assert near == [i for d, i in ordered if d <= 3.0]
        five = [e.id for e in nearest_of_type(session, "hall_ware", point, 5)]
        assert five == [i for _, i in ordered[:5]]


def test_far_from_everything_there_is_still_a_nearest(hall: Engine) -> None:
    with Session(hall) as session:
        (one,) = nearest_of_type(session, "hall_ware", (5e4, 0, 0))
        assert one.id == brute_force(session, (5e4, 0, 0))[0][1]
        assert nearest_of_type(session, "region", (0, 0, 0)) == []


@pytest.mark.parametrize("distance", [3.0, 50.0])
def test_numbers_of_every_kind_are_taken_and_nothing_else(hall: Engine, distance: float) -> None:
    with Session(hall) as session:
        expected = [e.id for e in of_type_near(session, "hall_ware", (50.0, 50.0, 5.0), distance)]
        for kind in (int, np.float32, np.float64, np.int64):
            point = (kind(50), kind(50), kind(5))
            assert [e.id for e in of_type_near(session, "hall_ware", point, kind(distance))] == (
                expected
            )
        for odd in (5e-324, -0.0, -1e-300):
            near = of_type_near(session, "hall_ware", (odd, odd, odd), distance)
            assert near == of_type_near(session, "hall_ware", (0.0, 0.0, 0.0), distance)
        assert of_type_near(session, "hall_ware", (1e20, 0, 0), distance) == []
        for wrong in (math.nan, math.inf, "(SELECT 1)", "0); DROP TABLE map; --"):
            with pytest.raises(ValueError, match=r"finite|could not convert"):
                of_type_near(session, "hall_ware", (wrong, 0.0, 0.0), distance)
        with pytest.raises(ValueError, match="finite"):
            of_type_near(session, "hall_ware", (0.0, 0.0, 0.0), math.nan)
        assert len(of_type_near(session, "hall_ware", (0.0, 0.0, 0.0), math.inf)) == COUNT // 2


def test_one_plan_on_the_index_serves_all_places(hall: Engine) -> None:
    """PostgreSQL plans a prepared statement five times, then keeps a plan unless it looks dear."""
    with Session(hall) as session:
        for i in range(12):
            of_type_near(session, "hall_ware", (5.0 * i, 50.0, 5.0), 3.0)
        name, parameters, kept, anew = session.execute(
            text(
                "SELECT name, cardinality(parameter_types), generic_plans, custom_plans "
                "FROM pg_prepared_statements WHERE statement LIKE '%box_distance%'"
            )
        ).one()
        assert anew <= 5 < kept + anew
        session.execute(text("SET LOCAL plan_cache_mode = force_generic_plan"))
        nothing = ", ".join(["NULL"] * parameters)
        plan = "\n".join(session.scalars(text(f'EXPLAIN EXECUTE "{name}" ({nothing})')))
        assert "world_flat" in plan
        assert "Seq Scan" not in plan


def test_a_rare_and_far_type_is_not_searched_place_by_place(hall: Engine) -> None:
    """Where a place is wide, the few of a type are the beginning, however often it was asked."""
    with Session(hall) as session:
        for i in range(12):
            (relic,) = nearest_of_type(session, "hall_relic", (40.0 + i, 50.0, 5.0))
            assert relic.name == "relic"
        kept = session.execute(
            text(
                "SELECT statement, generic_plans + custom_plans FROM pg_prepared_statements "
                "WHERE statement LIKE '%box_distance%'"
            )
        ).all()
        # at 1 and 4 metres, and no farther
        assert [asked for _, asked in kept] == [24 - PREPARED_AFTER]
        assert "&& (SELECT" in kept[0][0]

        asked = {"type": "hall_relic", "x": 50.0, "y": 50.0, "z": 5.0, "distance": 90.0}
        statement = FAR.params(asked).compile(
            hall, compile_kwargs={"literal_binds": True, "render_postcompile": True}
        )
        plan = "\n".join(session.scalars(text(f"EXPLAIN {statement}")))
        assert "object_type_pkey" in plan
        assert "world_flat" not in plan
