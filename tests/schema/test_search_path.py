"""Functions find each other whatever the search_path of who asks: GDAL's has no semmap in it."""

from __future__ import annotations

import pytest
from sqlalchemy import Engine, text

UNQUALIFIED = r"""
WITH known (name, is_function) AS (
    SELECT relname, false FROM pg_class
    WHERE relnamespace = 'semmap'::regnamespace AND relkind IN ('r', 'v')
    UNION SELECT proname, true FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace)
SELECT p.proname, k.name FROM pg_proc p JOIN pg_language l ON l.oid = p.prolang
CROSS JOIN LATERAL regexp_replace(p.prosrc, '--[^\n]*', '', 'g') AS code
JOIN known k ON k.is_function AND code ~ ('(^|[^.\w])' || k.name || '\(')
             OR NOT k.is_function AND code ~ ('(FROM|JOIN|INTO|UPDATE|USING)\s+' || k.name || '\M')
WHERE p.pronamespace = 'semmap'::regnamespace AND l.lanname IN ('sql', 'plpgsql')
  AND p.prosqlbody IS NULL  -- else its names are bound
"""


@pytest.fixture(scope="module")
def office(office_world: Engine) -> Engine:
    return office_world


def test_bodies_name_the_schema(office: Engine) -> None:
    with office.connect() as connection:
        assert connection.exec_driver_sql(UNQUALIFIED).all() == []


@pytest.mark.parametrize(
    "asked",
    [
        "SELECT * FROM semmap.{view} ORDER BY 1",
        "SELECT semmap.entity_id('desk4'), semmap.subtypes('table'), semmap.current_map()",
        "SELECT a.name, b.name FROM semmap.entity a, semmap.entity b WHERE a.type = 'muffin' "
        "AND (semmap.is_on(a.id, b.id) OR semmap.is_in(a.id, b.id) OR semmap.is_above(a.id, b.id) "
        "OR semmap.is_touching(a.id, b.id)) ORDER BY 2",
        "SELECT b.name, semmap.is_left_of(a.id, b.id), semmap.is_behind(a.id, b.id), "
        "semmap.is_near(a.id, b.id, 2.0) FROM semmap.entity a, semmap.entity b "
        "WHERE a.name = 'desk4' AND b.type = 'chair' ORDER BY 1",
        "SELECT semmap.things_on(semmap.entity_id('desk4'))",
        "SELECT semmap.things_in(semmap.entity_id('office4'))",
        "SELECT semmap.reachable_from(semmap.entity_id('lab1'))",
        "SELECT semmap.move_to(semmap.entity_id('desk4'), 9, 2, 7), "
        "semmap.put(semmap.entity_id('muffin1'), semmap.entity_id('office4'))",
    ],
)
def test_answers_do_not_depend_on_the_search_path(office: Engine, asked: str) -> None:
    views = text(
        "SELECT table_name FROM information_schema.views WHERE table_schema = 'semmap' ORDER BY 1"
    )
    with office.connect() as connection:
        for view in connection.execute(views).scalars().all() if "{view}" in asked else [""]:
            found = []
            for path in ("semmap, public", "public"):
                connection.execute(text(f"SET LOCAL search_path = {path}"))
                with connection.begin_nested() as step:
                    found.append(connection.exec_driver_sql(asked.format(view=view)).all())
                    step.rollback()
            assert found[0] == found[1]
