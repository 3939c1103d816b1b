"""Revisions: up, down, at once, and refused with a word on what to do."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import URL, Engine, create_engine
from sqlalchemy.exc import ProgrammingError

from semmap.database import DatabaseError, connect, migrate, revisions
from semmap.database.files import migrations_folder
from tests.conftest import administrator
from tests.database.conftest import python, said

CONNECT = """
import json, sys
from semmap.database import connect
engine = connect(sys.argv[1])
with engine.connect() as connection:
    print(json.dumps(connection.exec_driver_sql("SELECT count(*) FROM map").scalar()))
engine.dispose()
"""

REVISION = """
from alembic import op
from semmap.database.migrate import run_sql_files
revision = "{revision}"
down_revision = {down}

def upgrade():
    op.execute("CREATE SCHEMA IF NOT EXISTS semmap")
    op.execute("SET LOCAL search_path = semmap, public")
    run_sql_files(op, {patterns})

def downgrade():
    op.execute("DROP SCHEMA semmap CASCADE")
"""

COLONS_AND_PERCENTS = r"""
-- 100 % of :this, and %(that)s
CREATE FUNCTION odd(a integer) RETURNS text LANGUAGE plpgsql AS $body$
BEGIN
    IF a % 2 = 1 THEN
        RETURN format('%s is %L:odd \: %%', a::text, 'very');
    END IF;
    RAISE NOTICE 'no :name and no %', a;
    RETURN '50%';
END $body$;
CREATE TABLE times (at timestamptz DEFAULT '2020-01-01 10:00:00+00'::timestamptz);
"""


@pytest.fixture
def empty(cluster: URL) -> Iterator[URL]:
    """A database that no revision has been run on."""
    name = f"semmap_test_empty_{uuid4().hex}"
    with administrator(cluster) as run:
        run(f"CREATE DATABASE {name}")
        yield cluster.set(database=name)
        run(f"DROP DATABASE {name} WITH (FORCE)")


@pytest.fixture
def own_schema(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A root of its own with `schema/` and `migrations/`, whose revisions are yet to be written."""
    (tmp_path / "schema/tables").mkdir(parents=True)
    (tmp_path / "migrations/versions").mkdir(parents=True)
    (tmp_path / "migrations/env.py").write_text((migrations_folder() / "env.py").read_text())
    monkeypatch.setattr("semmap.database.files.PLACES", (tmp_path / "none", tmp_path))
    return tmp_path


def write_revision(root: Path, revision: str, down: str | None, *patterns: str) -> None:
    (root / "migrations/versions" / f"{revision}.py").write_text(
        REVISION.format(revision=revision, down=repr(down), patterns=", ".join(map(repr, patterns)))
    )


def test_newest_is_the_head_of_alembic() -> None:
    config = Config()
    config.set_main_option("script_location", str(migrations_folder()))
    script = ScriptDirectory.from_config(config)
    assert revisions.newest() == script.get_current_head()
    assert set(revisions.parents()) == {s.revision for s in script.walk_revisions()}


def test_two_newest_are_refused(own_schema: Path) -> None:
    for name in ("a1", "b1"):
        write_revision(own_schema, name, None)
    with pytest.raises(DatabaseError, match=r"2 newest revisions \(a1, b1\)"):
        revisions.newest()


def test_up_and_down(engine: Engine) -> None:
    assert migrate.current(engine) == revisions.newest()
    migrate.downgrade(engine, "base")
    assert migrate.current(engine) is None
    with pytest.raises(ProgrammingError), engine.connect() as connection:
        connection.exec_driver_sql("SELECT count(*) FROM semmap.map")
    migrate.upgrade(engine)
    assert migrate.current(engine) == revisions.newest()


TABLES = "DROP TABLE {0}.field_block, {0}.field_version, {0}.field"
RIGHTS = """
SELECT table_name, grantee, privilege_type FROM information_schema.role_table_grants
WHERE table_schema = 'semmap' ORDER BY 1, 2, 3
"""


@pytest.mark.parametrize("down_to", ["0002", "0001", "base"])
def test_a_database_from_before_fields(engine: Engine, down_to: str) -> None:
    """It gets the tables and the rights that a new one has, and keeps its rows."""
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('old')")
        rights = connection.exec_driver_sql(RIGHTS).all()
    migrate.downgrade(engine, down_to)
    with engine.begin() as connection:
        schema = "semmap_kept" if down_to == "base" else "semmap"
        connection.exec_driver_sql(TABLES.format(schema))
    migrate.upgrade(engine)
    assert migrate.current(engine) == revisions.newest()
    with engine.begin() as connection:
        assert connection.exec_driver_sql("SELECT name FROM map").scalar() == "old"
        assert connection.exec_driver_sql("SELECT count(*) FROM field").scalar() == 0
        assert connection.exec_driver_sql(RIGHTS).all() == rights


def test_fields_outlive_going_down(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('old')")
        connection.exec_driver_sql(
            "INSERT INTO field (map_id, name, property, value_type, voxel_size, edge) "
            "SELECT id, 'space', 'urn:x', 'bool', 0.05, 32 FROM map"
        )
    for revision in ("0002", "base"):
        migrate.downgrade(engine, revision)
        migrate.upgrade(engine)
        with engine.begin() as connection:
            assert connection.exec_driver_sql("SELECT name FROM field").scalar() == "space"


OLD_NAMES = """
SET search_path = semmap, public;
DROP VIEW IF EXISTS route_edge;
ALTER TABLE travel_time RENAME TO walk;
ALTER TABLE travel_time_place RENAME TO walked_place;
ALTER TABLE travel_time_map RENAME TO walked_map;
ALTER INDEX travel_time_pkey RENAME TO walk_pkey;
ALTER INDEX travel_time_in RENAME TO walk_place;
ALTER INDEX travel_time_from RENAME TO walk_from;
ALTER INDEX travel_time_to RENAME TO walk_to;
ALTER INDEX travel_time_place_of RENAME TO walked_place_place;
ALTER TABLE walk RENAME CONSTRAINT travel_time_check TO walk_check;
ALTER TABLE mission_step RENAME COLUMN command TO stage;
ALTER TABLE mission_step RENAME COLUMN message TO said;
"""
NAMES = """
SELECT table_name || '.' || column_name FROM information_schema.columns
WHERE table_schema = 'semmap'
UNION SELECT relname::text FROM pg_class WHERE relnamespace = 'semmap'::regnamespace
UNION SELECT conname FROM pg_constraint WHERE connamespace = 'semmap'::regnamespace
"""


@pytest.mark.parametrize("revision", ["0002", "0005", "0008"])
def test_a_database_with_old_names_gets_the_new_ones(engine: Engine, revision: str) -> None:
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('old')")
        connection.exec_driver_sql(
            "INSERT INTO robot_class (name, max_step, max_slope, speed, reach, heights, capacity, "
            "call_seconds, ride_seconds, ride_seconds_per_metre, open_seconds, unlock_seconds, "
            "pickup_seconds, place_seconds) VALUES ('r', 0, 0, 1, '{0,1}', '{0,1}', 1, 1, 1, 1, 1, "
            "1, 1, 1); INSERT INTO travel_time_map SELECT r.id, m.id, 'c' FROM robot_class r, map m"
        )
        names = {*connection.exec_driver_sql(NAMES).scalars()}
    migrate.downgrade(engine, revision)
    with engine.begin() as connection:
        connection.exec_driver_sql(OLD_NAMES)
    migrate.upgrade(engine)
    with engine.begin() as connection:
        assert {*connection.exec_driver_sql(NAMES).scalars()} == names
        assert connection.exec_driver_sql("SELECT cursor FROM travel_time_map").scalar() == "c"


@pytest.mark.parametrize(
    ("revision", "first"),
    [("0016", "100_belief"), ("0018", "110_manipulation"), ("0021", "130_interlinking")],
)
def test_a_database_from_before_later_tables(engine: Engine, revision: str, first: str) -> None:
    """The code of today speaks of tables that each of its revisions in between does not have."""
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('old')")
        names = {*connection.exec_driver_sql(NAMES).scalars()}
        migrate.drop_code(connection)
        for file in sorted(migrate.schema_folder().glob("tables/*.sql")):
            made = file.read_text() if file.stem >= first else ""
            for table in re.findall(r"^CREATE TABLE (\w+)", made, re.MULTILINE):
                connection.exec_driver_sql(f"DROP TABLE semmap.{table} CASCADE")
        connection.exec_driver_sql(f"UPDATE public.semmap_version SET version_num = '{revision}'")
    migrate.upgrade(engine)
    with engine.begin() as connection:
        assert {*connection.exec_driver_sql(NAMES).scalars()} == names
        assert connection.exec_driver_sql("SELECT name FROM map").scalar() == "old"


def test_drop_and_install_again(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('gone')")
    migrate.drop(engine)
    assert migrate.current(engine) is None
    again = connect(engine.url)
    with again.connect() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM map").scalar() == 0
    again.dispose()


def test_without_migrate_nothing_is_changed(empty: URL) -> None:
    engine = connect(empty, migrate=False)
    assert migrate.current(engine) is None
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT to_regnamespace('semmap')").scalar() is None
    engine.dispose()


def test_processes_that_migrate_at_once(empty: URL) -> None:
    url = empty.render_as_string(hide_password=False)
    comers = [python(CONNECT, url) for _ in range(3)]
    assert [said(comer) for comer in comers] == [0, 0, 0]


def test_unknown_revision(engine: Engine) -> None:
    with pytest.raises(DatabaseError, match="knows the revisions 0001"):
        migrate.upgrade(engine, "9999")
    with engine.begin() as connection:
        connection.exec_driver_sql("UPDATE public.semmap_version SET version_num = '9999'")
    with pytest.raises(DatabaseError, match="a newer semmap made it"):
        connect(engine.url)


def test_files_run_as_they_stand(empty: URL, own_schema: Path) -> None:
    (own_schema / "schema/tables/2.sql").write_text("INSERT INTO times VALUES (DEFAULT);")
    (own_schema / "schema/tables/1.sql").write_text(COLONS_AND_PERCENTS)
    write_revision(own_schema, "x1", None, "tables/*.sql")
    engine = connect(empty)
    assert migrate.current(engine) == "x1"
    with engine.connect() as connection:
        asked = "SELECT odd(3), odd(4), extract(hour FROM at)::int FROM times"
        assert connection.exec_driver_sql(asked).one() == (r"3 is 'very':odd \: %", "50%", 10)
    engine.dispose()


def test_failing_file_is_named_and_nothing_stays(empty: URL, own_schema: Path) -> None:
    (own_schema / "schema/tables/1.sql").write_text("CREATE TABLE good (id int);\n")
    (own_schema / "schema/tables/2.sql").write_text(
        "CREATE TABLE size (größe int);\nSELECT 1;\n\nSELECT nonsense FROM good;\n"
    )
    write_revision(own_schema, "x1", None, "tables/1.sql")
    write_revision(own_schema, "x2", "x1", "tables/2.sql")
    with pytest.raises(DatabaseError, match=r'tables/2.sql:4: column "nonsense" does not exist'):
        connect(empty)
    engine = connect(empty, migrate=False)
    assert migrate.current(engine) is None
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT to_regnamespace('semmap')").scalar() is None
    engine.dispose()


def test_pattern_that_fits_no_file(empty: URL, own_schema: Path) -> None:
    write_revision(own_schema, "x1", None, "views/*.sql")
    with pytest.raises(DatabaseError, match=r"no file that fits views/\*.sql"):
        connect(empty)


def test_schema_that_is_not_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("semmap.database.files.PLACES", (tmp_path, tmp_path))
    with pytest.raises(DatabaseError, match="not completely installed"):
        migrations_folder()


@pytest.fixture
def visitor(docker_postgis: Engine) -> Iterator[URL]:
    """The fresh database of `docker_postgis` for a login without rights."""
    with docker_postgis.begin() as connection:
        connection.exec_driver_sql("CREATE ROLE visitor LOGIN PASSWORD 'v'")
    yield docker_postgis.url.set(username="visitor", password="v")
    with docker_postgis.begin() as connection:
        connection.exec_driver_sql("DROP OWNED BY visitor CASCADE")
        connection.exec_driver_sql("DROP ROLE visitor")


def asked_of_an_administrator(visitor: URL) -> list[str]:
    with pytest.raises(DatabaseError, match="visitor may not install the schema") as caught:
        connect(visitor)
    return str(caught.value).split("administrator run: ")[1].split("; ")


@pytest.mark.docker
def test_an_installation_without_rights_names_the_missing_rights(visitor: URL) -> None:
    asked = asked_of_an_administrator(visitor)
    assert f'GRANT CREATE ON DATABASE "{visitor.database}" TO "visitor"' in asked
    assert 'GRANT CREATE ON SCHEMA public TO "visitor"' in asked
    assert "CREATE EXTENSION postgis SCHEMA public" in asked


@pytest.mark.docker
def test_the_named_rights_are_enough_to_install(docker_postgis: Engine, visitor: URL) -> None:
    with docker_postgis.begin() as connection:
        for statement in asked_of_an_administrator(visitor):
            connection.exec_driver_sql(statement)
    engine = connect(visitor)
    assert migrate.current(engine) == revisions.newest()
    engine.dispose()


@pytest.mark.docker
def test_reader_connects_and_does_not_upgrade(docker_postgis: Engine, visitor: URL) -> None:
    migrate.upgrade(docker_postgis)
    with docker_postgis.begin() as connection:
        connection.exec_driver_sql("GRANT semmap_reader TO visitor")
    engine = connect(visitor)
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM map").scalar() == 0
    engine.dispose()
    migrate.downgrade(docker_postgis, "-1")
    with pytest.raises(DatabaseError, match=r"visitor may not change the schema .* admin"):
        connect(visitor)


@pytest.mark.docker
@pytest.mark.parametrize(
    ("control", "said"),
    [
        (None, "no PostGIS.*apt-get install postgresql-15-postgis-3"),
        ("default_version = '3.1.4'\n", "PostGIS is 3.1.4; semmap needs 3.2"),
    ],
)
def test_server_without_fitting_postgis(
    docker_server: URL, docker_container: Any, control: str | None, said: str
) -> None:
    run = docker_container.exec
    file = "/usr/share/postgresql/15/extension/postgis.control"
    assert run(f"mv -T {file} /tmp/kept.control").exit_code == 0
    with administrator(docker_server) as execute:
        execute("CREATE DATABASE bare TEMPLATE template0")
        try:
            if control is not None:
                assert run(["sh", "-c", f'echo "{control}" > {file}']).exit_code == 0
            with pytest.raises(DatabaseError, match=said):
                connect(docker_server.set(database="bare"))
        finally:
            assert run(f"mv -T /tmp/kept.control {file}").exit_code == 0
            execute("DROP DATABASE bare WITH (FORCE)")


def test_postgis_in_another_schema(empty: URL) -> None:
    engine = create_engine(empty)
    with engine.begin() as connection:
        connection.exec_driver_sql("CREATE SCHEMA elsewhere")
        connection.exec_driver_sql("CREATE EXTENSION postgis SCHEMA elsewhere")
    engine.dispose()
    with pytest.raises(DatabaseError, match="PostGIS lies in the schema elsewhere"):
        connect(empty)
