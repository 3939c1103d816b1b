"""Revisions: up, down, at once, and refused with a word on what to do."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import URL, Engine, create_engine
from sqlalchemy.exc import NotSupportedError, ProgrammingError

from semmap.database import DatabaseError, migrate, open_engine, revisions
from semmap.database.files import migrations_folder
from semmap.database.revisions import OldSchema
from tests.conftest import administrator
from tests.database.conftest import python, said
from tests.next_revision import next_revision

CONNECT = """
import json, sys
from semmap.database import open_engine
engine = open_engine(sys.argv[1])
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
    run_sql_files(op.get_bind(), {patterns})

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
    run = administrator(cluster)
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


RIGHTS = """
SELECT table_name, grantee, privilege_type FROM information_schema.role_table_grants
WHERE table_schema = 'semmap' ORDER BY 1, 2, 3
"""
NAMES = """
SELECT table_name || '.' || column_name FROM information_schema.columns
WHERE table_schema = 'semmap'
UNION SELECT relname::text FROM pg_class WHERE relnamespace = 'semmap'::regnamespace
UNION SELECT conname FROM pg_constraint WHERE connamespace = 'semmap'::regnamespace
UNION SELECT oid::regprocedure::text FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace
UNION SELECT polname || ' ' || polrelid::regclass FROM pg_policy
UNION SELECT tgname || ' ' || tgrelid::regclass FROM pg_trigger WHERE NOT tgisinternal
"""


def test_up_and_down(engine: Engine) -> None:
    """What was kept gets the names and the rights that a new database has, and keeps its rows."""
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('old')")
        connection.exec_driver_sql(
            "INSERT INTO field (map_id, name, property, value_type, voxel_size, edge) "
            "SELECT id, 'space', 'urn:x', 'bool', 0.05, 32 FROM map"
        )
        rights = connection.exec_driver_sql(RIGHTS).all()
        names = {*connection.exec_driver_sql(NAMES).scalars()}
    assert revisions.installed_on(engine) == revisions.newest()
    migrate.downgrade(engine, "base")
    assert revisions.installed_on(engine) is None
    with pytest.raises(ProgrammingError), engine.connect() as connection:
        connection.exec_driver_sql("SELECT count(*) FROM semmap.map")
    migrate.upgrade(engine)
    assert revisions.installed_on(engine) == revisions.newest()
    with engine.begin() as connection:
        assert connection.exec_driver_sql("SELECT name FROM map").scalar() == "old"
        assert connection.exec_driver_sql("SELECT name FROM field").scalar() == "space"
        assert connection.exec_driver_sql(RIGHTS).all() == rights
        assert {*connection.exec_driver_sql(NAMES).scalars()} == names


def test_down_to_where_it_is_changes_nothing(engine: Engine) -> None:
    with engine.begin() as connection:
        names = {*connection.exec_driver_sql(NAMES).scalars()}
    migrate.downgrade(engine, revisions.newest())
    assert revisions.installed_on(engine) == revisions.newest()
    with engine.begin() as connection:
        assert {*connection.exec_driver_sql(NAMES).scalars()} == names


DEPENDENT = "ALTER TABLE room ALTER COLUMN ceiling TYPE {}"


def test_revisions_change_what_functions_depend_on(engine: Engine) -> None:
    to_numeric, back = DEPENDENT.format("numeric"), DEPENDENT.format("double precision")
    with pytest.raises(NotSupportedError, match="used by"), engine.begin() as connection:
        connection.exec_driver_sql(to_numeric)
    released = revisions.newest()
    with next_revision([to_numeric], [back]) as following:
        open_engine(engine.url).dispose()
        assert revisions.installed_on(engine) == following
        migrate.downgrade(engine, released)
        assert revisions.installed_on(engine) == f"{released} without functions"
        with pytest.raises(OldSchema, match=f"{released} without functions, .* needs {following}"):
            open_engine(engine.url, check=True)
    with pytest.raises(OldSchema, match=f"{released} without functions, .* needs {released}"):
        open_engine(engine.url, check=True)
    open_engine(engine.url).dispose()
    assert revisions.installed_on(engine) == released


def test_functions_of_another_version_are_made_again(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.exec_driver_sql("DROP VIEW semmap.door_faults")
        connection.exec_driver_sql("COMMENT ON SCHEMA semmap IS 'functions of before'")
        names = {*connection.exec_driver_sql(NAMES).scalars()}
    newest = revisions.newest()
    assert revisions.installed_on(engine) == f"{newest} with other functions"
    with pytest.raises(OldSchema, match=f"{newest} with other functions, .* run semmap db upgrade"):
        open_engine(engine.url, check=True)
    open_engine(engine.url).dispose()
    assert revisions.installed_on(engine) == newest
    with engine.begin() as connection:
        assert "door_faults" in {*connection.exec_driver_sql(NAMES).scalars()} - names


def test_drop_and_install_again(engine: Engine) -> None:
    with engine.begin() as connection:
        connection.exec_driver_sql("INSERT INTO map (name) VALUES ('gone')")
    migrate.drop(engine)
    assert revisions.installed_on(engine) is None
    again = open_engine(engine.url)
    with again.connect() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM map").scalar() == 0
    again.dispose()


def test_without_migrate_nothing_is_changed(empty: URL) -> None:
    engine = open_engine(empty, migrate=False)
    assert revisions.installed_on(engine) is None
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT to_regnamespace('semmap')").scalar() is None
    engine.dispose()


def test_processes_that_migrate_at_once(empty: URL) -> None:
    url = empty.render_as_string(hide_password=False)
    comers = [python(CONNECT, url) for _ in range(3)]
    assert [said(comer) for comer in comers] == [0, 0, 0]


@pytest.mark.parametrize("revision", ["9999", "0035"])
@pytest.mark.parametrize("check", [False, True])
def test_unknown_revision(engine: Engine, revision: str, check: bool) -> None:
    with pytest.raises(DatabaseError, match="knows the revisions 0001, 0002"):
        migrate.upgrade(engine, revision)
    with engine.begin() as connection:
        connection.exec_driver_sql(f"UPDATE public.semmap_version SET version_num = '{revision}'")
    with pytest.raises(DatabaseError, match=f"{revision}, .*a newer semmap made it, or one from"):
        open_engine(engine.url, check=check)
    with pytest.raises(DatabaseError, match=f"'{revision}'.*knows the revisions 0001, 0002"):
        migrate.upgrade(engine)
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM object").scalar() == 0


def test_files_run_as_they_stand(empty: URL, own_schema: Path) -> None:
    (own_schema / "schema/tables/2.sql").write_text("INSERT INTO times VALUES (DEFAULT);")
    (own_schema / "schema/tables/1.sql").write_text(COLONS_AND_PERCENTS)
    write_revision(own_schema, "x1", None, "tables/*.sql")
    engine = open_engine(empty)
    assert revisions.installed_on(engine) == "x1"
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
        open_engine(empty)
    engine = open_engine(empty, migrate=False)
    assert revisions.installed_on(engine) is None
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT to_regnamespace('semmap')").scalar() is None
    engine.dispose()


def test_pattern_that_fits_no_file(empty: URL, own_schema: Path) -> None:
    write_revision(own_schema, "x1", None, "views/*.sql")
    with pytest.raises(DatabaseError, match=r"no file that fits views/\*.sql"):
        open_engine(empty)


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
        open_engine(visitor)
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
    engine = open_engine(visitor)
    assert revisions.installed_on(engine) == revisions.newest()
    engine.dispose()


@pytest.mark.docker
def test_reader_connects_and_does_not_upgrade(docker_postgis: Engine, visitor: URL) -> None:
    migrate.upgrade(docker_postgis)
    with docker_postgis.begin() as connection:
        connection.exec_driver_sql("GRANT semmap_reader TO visitor")
    engine = open_engine(visitor)
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM map").scalar() == 0
    engine.dispose()
    refused = pytest.raises(DatabaseError, match=r"visitor may not change the schema .* admin")
    with next_revision(), refused:
        open_engine(visitor)


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
    execute = administrator(docker_server)
    execute("CREATE DATABASE bare TEMPLATE template0")
    try:
        if control is not None:
            assert run(["sh", "-c", f'echo "{control}" > {file}']).exit_code == 0
        with pytest.raises(DatabaseError, match=said):
            open_engine(docker_server.set(database="bare"))
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
        open_engine(empty)
