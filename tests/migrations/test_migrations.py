"""Revisions up, down and up again on a dockerised PostGIS that holds an imported world."""

from __future__ import annotations

from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Engine, create_engine, text
from sqlalchemy.orm import configure_mappers

from semmap.database.migrate import current, downgrade, upgrade
from semmap.ingest.importer import import_file
from semmap.model import Base

OFFICE = Path(__file__).parents[2] / "examples" / "office"
FILES = ("office_rooms.geojson", "office.sdf")


def differences(engine: Engine) -> list[object]:
    """What Alembic finds different between the ORM's tables and those of the database."""
    configure_mappers()
    plain = create_engine(engine.url, connect_args={"options": "-c search_path=public"})
    with plain.connect() as connection:
        context = MigrationContext.configure(
            connection,
            opts={
                "include_schemas": True,
                "compare_type": True,
                # the schema's other tables have no class
                "include_object": lambda _, name, kind, in_database, ours: (
                    not (kind == "table" and in_database and ours is None)
                ),
                "include_name": lambda name, kind, _: (
                    name == "semmap" if kind == "schema" else True
                ),
            },
        )
        found: list[object] = compare_metadata(context, Base.metadata)
    plain.dispose()
    return found


def rows(engine: Engine) -> dict[str, int]:
    """The number of rows of each table of the map."""
    with engine.connect() as connection:
        tables = connection.execute(
            text("SELECT tablename FROM pg_tables WHERE schemaname = 'semmap' ORDER BY 1")
        ).scalars()
        return {
            t: connection.execute(text(f'SELECT count(*) FROM semmap."{t}"')).scalar_one()
            for t in list(tables)
        }


def test_orm_and_database_do_not_differ(engine: Engine) -> None:
    assert differences(engine) == []


def test_a_missing_column_would_be_seen(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.execute(text("ALTER TABLE link DROP COLUMN properties"))
    try:
        assert differences(engine)
    finally:
        with engine.begin() as connection:
            connection.execute(
                text(
                    "ALTER TABLE link ADD COLUMN properties jsonb NOT NULL DEFAULT '{}' "
                    "CHECK (jsonb_typeof(properties) = 'object')"
                )
            )


@pytest.mark.docker
@pytest.mark.parametrize("down_to", ["0001", "base"])
def test_down_and_up_again_loses_no_row(docker_postgis: Engine, down_to: str) -> None:
    engine = docker_postgis
    upgrade(engine)
    for name in FILES:
        import_file(engine, OFFICE / name, map_name=f"office-{down_to}")
    before = rows(engine)
    assert before["entity"] > 50
    assert before["chunk"] > 10
    head = current(engine)

    downgrade(engine, down_to)
    assert current(engine) == (None if down_to == "base" else down_to)
    engine.dispose()
    upgrade(engine)
    assert current(engine) == head
    assert rows(engine) == before
    assert differences(engine) == []
    # What came back is alive: triggers move the contents, Figure 3 answers.
    with engine.begin() as connection:
        connection.execute(
            text("SELECT set_config('semmap.map', :m, false)"), {"m": f"office-{down_to}"}
        )
        was = connection.execute(
            text("SELECT pose[1] FROM world WHERE entity_id = entity_id('muffin1')")
        ).scalar_one()
        connection.execute(
            text(
                "UPDATE placement SET pose[1] = pose[1] + 0.25 WHERE entity_id = entity_id('desk4')"
            )
        )
        now = connection.execute(
            text("SELECT pose FROM world WHERE entity_id = entity_id('muffin1')")
        ).scalar_one()
        assert now[0] != was or now[1] != was
