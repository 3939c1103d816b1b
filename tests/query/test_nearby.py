"""What of a type is near: against brute force, and with the plan that makes it fast."""

from __future__ import annotations

import numpy as np
import pytest
from sqlalchemy import Engine, text
from sqlalchemy.orm import Session

from semmap.query.nearby import NEAR, nearest_of_type, of_type_near

COUNT = 20_000


@pytest.fixture(scope="module")
def hall(module_engine: Engine) -> Engine:
    """20,000 things of 41 types, half of them below `ware`, scattered over 100 x 100 x 10 m."""
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


def test_the_plan_stays_on_the_index_after_a_dozen_executions(hall: Engine) -> None:
    """psycopg prepares a statement after five runs; a generic plan must not lose the index."""
    asked = {"type": "hall_ware", "x": 50.0, "y": 50.0, "z": 5.0, "distance": 3.0}
    compiled = NEAR.compile(hall, compile_kwargs={"literal_binds": False})
    with hall.connect() as connection:
        driver = connection.connection.driver_connection
        assert driver is not None
        parameters = {**compiled.params, **asked}
        for _ in range(12):
            driver.execute(str(compiled), parameters)
        for mode in ("force_custom_plan", "force_generic_plan"):
            driver.execute(f"SET plan_cache_mode = {mode}")
            plan = driver.execute(f"EXPLAIN (FORMAT JSON) {compiled}", parameters, prepare=True)
            said = str(plan.fetchone())
            assert "world_flat" in said
            assert "Seq Scan" not in said
