"""Revisions up, down and up again, on databases that hold an imported world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Engine, create_engine, text
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import configure_mappers

from semmap.database import DatabaseError, open_engine
from semmap.database.migrate import downgrade, upgrade
from semmap.database.revisions import installed_on, newest, parents
from semmap.ingest.importer import import_file
from semmap.model import Base
from tests.conftest import PASSWORD, MakeDatabase
from tests.next_revision import next_revision

OFFICE = Path(__file__).parents[2] / "examples" / "office"

UP = (
    "ALTER TABLE room ALTER COLUMN ceiling TYPE numeric",  # functions and views depend on it
    "ALTER TABLE entity ADD COLUMN weight double precision NOT NULL DEFAULT 1",
    "CREATE TABLE weighing (entity_id bigint PRIMARY KEY REFERENCES entity ON DELETE CASCADE)",
    "INSERT INTO weighing SELECT id FROM entity",
)
DOWN = (
    "DROP TABLE weighing",
    "ALTER TABLE entity DROP COLUMN weight",
    "ALTER TABLE room ALTER COLUMN ceiling TYPE double precision",
)

Columns = dict[str, str]
"""Each table of the map, with its columns as SQL lists them."""


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
                # the schema's other tables have no class, and its indexes are the schema's alone
                "include_object": lambda _, name, kind, in_database, ours: (
                    not (kind in ("table", "index") and in_database and ours is None)
                ),
                "include_name": lambda name, kind, _: (
                    name == "semmap" if kind == "schema" else True
                ),
            },
        )
        found: list[object] = compare_metadata(context, Base.metadata)
    plain.dispose()
    return found


def columns(engine: Engine) -> Columns:
    """The columns of each table of the map; the keys of its transactions are others each time."""
    with engine.connect() as connection:
        found = connection.execute(
            text(
                "SELECT attrelid::regclass::text AS table, "
                "string_agg(quote_ident(attname), ', ' ORDER BY attnum) AS names "
                "FROM pg_attribute JOIN pg_class c ON c.oid = attrelid WHERE attnum > 0 "
                "AND NOT attisdropped AND relkind = 'r' AND relnamespace = 'semmap'::regnamespace "
                "AND relname <> 'written' GROUP BY 1"
            )
        )
        return {row.table: row.names for row in found}


def rows(engine: Engine, read: Columns) -> dict[str, list[str]]:
    """All rows of tables, in these columns."""
    with engine.connect() as connection:
        return {
            table: sorted(
                connection.execute(text(f"SELECT ROW({names})::text FROM {table}")).scalars()
            )
            for table, names in read.items()
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


def test_revisions_are_one_line_that_begins_at_0001() -> None:
    known = parents()
    line = [newest()]
    while (parent := known[line[-1]]) is not None:
        line.append(parent)
    assert line == sorted(known, reverse=True)
    assert line[-1] == "0001"


def test_meshes_of_earlier_versions_get_outlines(make_database: MakeDatabase) -> None:
    """Their footprints were convex hulls until revision 0004; what reads them is told."""
    engine = open_engine(make_database())
    for name in ("office_rooms.geojson", "office.sdf"):
        import_office(engine, name)

    def footprints() -> dict[str, bytes]:
        with engine.connect() as connection:
            found = text(
                "SELECT name, ST_AsBinary(footprint) FROM world JOIN entity ON id = entity_id"
            )
            return dict(connection.execute(found).all())

    right = footprints()
    with engine.begin() as connection:
        connection.execute(text("UPDATE model SET outline = NULL WHERE kind IN ('mesh', 'box')"))
        connection.execute(text("SELECT refresh_world(ARRAY(SELECT entity_id FROM placement))"))
        last = connection.execute(text("SELECT max(id) FROM change")).scalar_one()
    stale = footprints()
    wrong = {name for name in right if right[name] != stale[name]}
    assert "walls-1st" in wrong
    downgrade(engine, "0003")
    engine.dispose()
    upgrade(engine)
    assert footprints() == right
    with engine.connect() as connection:
        told = text(
            "SELECT e.name FROM change c JOIN entity e ON e.id = ANY (c.entities) "
            "WHERE c.id > :last AND c.what = 'reshaped'"
        )
        assert {*connection.execute(told, {"last": last}).scalars()} == wrong
    engine.dispose()


def test_slides_and_suction_cups_go_with_their_revisions(make_database: MakeDatabase) -> None:
    """Revisions 0013 and 0014: before them there are neither; all that is beside them stays."""
    engine = open_engine(make_database())
    hinge = "'{0,0,0,0,0,1,1.2}'"
    with engine.begin() as connection:
        for statement in (
            "INSERT INTO map (name) VALUES ('kitchen')",
            "INSERT INTO device (id, name, kind) VALUES "
            "(1, 'arm', 'robot'), (2, 'fingers', 'gripper'), (3, 'cup', 'gripper')",
            "INSERT INTO gripper (device_id, form, opening, depth, force) VALUES "
            "(2, 'parallel', 0.08, 0.05, NULL), (3, 'suction', 0.03, 0.02, 60)",
            "INSERT INTO automaton (name, robot_id, gripper_id) VALUES "
            "('picker', 1, 3), ('holder', 1, 2)",
            "INSERT INTO object_model (id, key) VALUES (1, 'mesh:drawer')",
            "INSERT INTO action (id, kind, object_id, gripper_id, pose, motion) VALUES "
            "(1, 'open', 1, 2, '{0,0,0,0,0,0,1}', '{-0.3,0,0}'), "
            f"(2, 'open', 1, 2, '{{0,0,0,0,0,0,1}}', {hinge}), "
            f"(3, 'turn', 1, 2, '{{0,0,0,0,0,0,1}}', {hinge}), "
            "(4, 'grasp', 1, 3, '{0,0,0,0,0,0,1}', NULL), "
            "(5, 'grasp', 1, 2, '{0,0,0,0,0,0,1}', NULL)",
        ):
            connection.execute(text(statement))

    def kept() -> tuple[list[Any], ...]:
        with engine.connect() as connection:
            return tuple(
                [*map(tuple, connection.execute(text(question)))]
                for question in (
                    "SELECT id, kind FROM semmap.action ORDER BY id",
                    "SELECT device_id, form FROM semmap.gripper ORDER BY 1",
                    "SELECT name FROM semmap.device ORDER BY id",
                    "SELECT name, gripper_id FROM semmap.automaton ORDER BY 1",
                )
            )

    without_cups = (
        [(1, "open"), (2, "open"), (3, "turn"), (5, "grasp")],
        [(2, "parallel")],
        [("arm",), ("fingers",)],
        [("holder", 2), ("picker", None)],
    )
    without_slides = ([each for each in without_cups[0] if each[0] != 1], *without_cups[1:])
    for revision, expected in (("0013", without_cups), ("0012", without_slides)):
        downgrade(engine, revision)
        assert kept() == expected
    slide = "INSERT INTO semmap.action (id, kind, object_id, gripper_id, pose, motion) VALUES "
    slide += "(6, 'open', 1, 2, '{0,0,0,0,0,0,1}', '{-0.3,0,0}')"
    cup = "UPDATE semmap.gripper SET form = 'suction'"
    for refused in (slide, cup):
        with pytest.raises(IntegrityError, match="check constraint"), engine.begin() as connection:
            connection.execute(text(refused))
    engine.dispose()
    upgrade(engine)
    assert kept() == without_slides
    with engine.begin() as connection:
        for taken in (slide, f"{cup}, force = 60"):
            connection.execute(text(taken))
    engine.dispose()


@pytest.fixture
def dump(docker_container: Any, docker_postgis: Engine) -> Any:
    """Tells what `pg_dump` says of the database, apart from its rows."""

    def run() -> str:
        arguments = ["-h", "127.0.0.1", "-U", "admin", "--schema-only", docker_postgis.url.database]
        done = docker_container.exec(["env", f"PGPASSWORD={PASSWORD}", "pg_dump", *arguments])
        assert done.exit_code == 0, done.output
        lines = done.output.decode().splitlines()
        return "\n".join(line for line in lines if "restrict " not in line)  # a random word

    return run


def import_office(engine: Engine, name: str) -> None:
    import_file(engine, OFFICE / name, map_name="office")


def answers_and_moves(engine: Engine) -> None:
    """Triggers move the contents of what moves; functions and views answer."""
    with engine.begin() as connection:
        connection.execute(text("SELECT set_config('semmap.map', 'office', false)"))
        muffin = text("SELECT pose FROM world WHERE entity_id = entity_id('muffin1')")
        was = connection.execute(muffin).scalar_one()
        connection.execute(
            text(
                "UPDATE placement SET pose[1] = pose[1] + 0.25 WHERE entity_id = entity_id('desk4')"
            )
        )
        now = connection.execute(muffin).scalar_one()
        assert now[:2] != was[:2]
        assert connection.execute(text("SELECT count(*) FROM face")).scalar_one() > 0


@pytest.mark.docker
def test_down_to_nothing_and_up_again_loses_no_row(docker_postgis: Engine, dump: Any) -> None:
    engine = docker_postgis
    upgrade(engine)
    for name in ("office_rooms.geojson", "office.sdf"):
        import_office(engine, name)
    read, schema = columns(engine), dump()
    before = rows(engine, read)
    assert len(before["entity"]) > 50
    assert len(before["chunk"]) > 10

    downgrade(engine, "base")
    assert installed_on(engine) is None
    engine.dispose()
    upgrade(engine)
    assert installed_on(engine) == newest()
    assert rows(engine, read) == before
    assert dump() == schema
    assert differences(engine) == []
    answers_and_moves(engine)


@pytest.mark.docker
def test_the_next_revision_goes_up_and_down_with_data(docker_postgis: Engine, dump: Any) -> None:
    """What a newer semmap will do to a map of this one, until this one uses it again."""
    engine = docker_postgis
    upgrade(engine)
    import_office(engine, "office_rooms.geojson")
    released, read, schema = newest(), columns(engine), dump()
    before = rows(engine, read)
    assert len(before["storey"]) == 2

    with next_revision(UP, DOWN) as following:
        open_engine(engine.url).dispose()
        assert installed_on(engine) == following
        assert rows(engine, read) == before
        assert len(rows(engine, columns(engine))["weighing"]) == len(before["entity"])
        import_office(engine, "office.sdf")
        answers_and_moves(engine)
        before = rows(engine, read)
        assert len(before["chunk"]) > 10
        downgrade(engine, released)
        assert installed_on(engine) == f"{released} without functions"
        assert rows(engine, read) == before

    with pytest.raises(DatabaseError, match=f"{released} without functions.*semmap db upgrade"):
        open_engine(engine.url, check=True)
    open_engine(engine.url).dispose()
    assert installed_on(engine) == released
    assert rows(engine, read) == before
    assert dump() == schema
    assert differences(engine) == []
    answers_and_moves(engine)
