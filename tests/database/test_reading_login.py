"""The login that only reads: made with the cluster, and later in clusters that lack it."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest
from sqlalchemy import URL, Engine
from sqlalchemy.exc import DBAPIError
from typer.testing import CliRunner

from semmap import cli
from semmap.database import Cluster, DatabaseError, as_reader, open_engine
from semmap.database.account import server_account
from tests.command_line import semmap
from tests.database.conftest import query

WHO = "SELECT current_user, session_user"
AS_READER = [{"current_user": "semmap_read", "session_user": "semmap_read"}]

AS_BEFORE = """
REASSIGN OWNED BY semmap_read TO semmap;
DROP OWNED BY semmap_read CASCADE;
DROP ROLE semmap_read;
DO $$ DECLARE f regprocedure; BEGIN
    FOR f IN SELECT oid FROM pg_proc WHERE pronamespace = 'pg_catalog'::regnamespace
             AND proname ~ '^(lo_|lowrite|pg_notify|pg_(try_)?advisory|pg_(cancel|terminate)_)' LOOP
        EXECUTE format('GRANT EXECUTE ON FUNCTION %s TO PUBLIC', f);
    END LOOP;
END $$;
GRANT TEMPORARY ON DATABASE semmap TO PUBLIC;
"""


@pytest.fixture
def embedded(own: Cluster, monkeypatch: pytest.MonkeyPatch) -> Cluster:
    """The user's own cluster, with a schema."""
    monkeypatch.setenv("SEMMAP_DATA", str(own.home))
    open_engine().dispose()
    return own


def who() -> list[dict[str, str]]:
    """Whom `semmap sql` reads as."""
    done = CliRunner().invoke(cli.app, ["sql", WHO, "--json"], catch_exceptions=False)
    return json.loads(done.stdout)  # type: ignore[no-any-return]


def test_new_cluster_has_it(embedded: Cluster) -> None:
    log = embedded.log.stat().st_size
    assert who() == AS_READER
    assert "SIGHUP" not in embedded.log.read_text()[log:]


@pytest.mark.parametrize("restart", [False, True])
def test_older_cluster_gets_it(embedded: Cluster, restart: bool) -> None:
    query(embedded, AS_BEFORE)
    owner = server_account(embedded.data).name
    old_map = "".join(f'semmap "{user}" semmap\n' for user in (owner, "root"))
    (embedded.home / "ident.conf").write_text(old_map)
    query(embedded, "SELECT pg_reload_conf()")
    if restart:
        embedded.stop()
    assert who() == AS_READER
    assert who() == AS_READER
    assert not query(
        embedded, "SELECT has_function_privilege('semmap_read', 'pg_notify(text, text)', 'EXECUTE')"
    )


def test_rights_given_by_hand_are_taken_again(embedded: Cluster) -> None:
    query(embedded, "GRANT semmap_admin TO semmap_read; ALTER ROLE semmap_read CREATEROLE")
    assert who() == AS_READER
    assert query(
        embedded,
        "SELECT NOT rolcreaterole AND NOT pg_has_role(oid, 'semmap_admin', 'MEMBER') "
        "FROM pg_roles WHERE rolname = 'semmap_read'",
    )


def test_rights_of_all_readers_are_named(embedded: Cluster) -> None:
    query(embedded, "GRANT pg_read_server_files TO semmap_reader")
    try:
        with pytest.raises(DatabaseError, match="more than read: role pg_read_server_files"):
            who()
    finally:
        query(embedded, "REVOKE pg_read_server_files FROM semmap_reader")
    assert who() == AS_READER


RIGHTS = {
    "SELECT pg_notify('x', 'y')": {"semmap_robot", "semmap_admin"},
    "SELECT pg_advisory_xact_lock(1)": {"semmap_robot", "semmap_admin"},
    "CREATE TEMP TABLE x (id int)": {"semmap_robot", "semmap_admin"},
    "SELECT lo_create(0)": set(),
    "SELECT lo_from_bytea(0, 'x')": set(),
    "SELECT pg_terminate_backend(0)": set(),
    "SELECT pg_read_file('PG_VERSION')": set(),
    "SELECT 1": {"semmap_reader", "semmap_robot", "semmap_admin"},
}


@pytest.mark.parametrize("statement", RIGHTS)
@pytest.mark.parametrize("role", ["semmap_reader", "semmap_robot", "semmap_admin"])
def test_each_role_may_call_its_functions(engine: Engine, role: str, statement: str) -> None:
    reader = as_reader(engine)
    assert reader is not None
    reader.dispose()
    with engine.connect() as connection:
        connection.exec_driver_sql(f"SET ROLE {role}")
        try:
            connection.exec_driver_sql(statement)
            allowed = True
        except DBAPIError as error:
            if getattr(error.orig, "sqlstate", None) != "42501":  # insufficient_privilege
                raise
            allowed = False
    assert allowed == (role in RIGHTS[statement])


@pytest.fixture
def boss(embedded: Cluster) -> Iterator[URL]:
    """A superuser of another name: a database by URL that is not known to be embedded."""
    query(embedded, "CREATE ROLE boss SUPERUSER LOGIN")
    with (embedded.home / "ident.conf").open("a") as file:
        file.write(f'semmap "root" boss\nsemmap "{server_account(embedded.data).name}" boss\n')
    query(embedded, "SELECT pg_reload_conf()")
    yield embedded.ensure().set(username="boss")
    query(embedded, "DROP ROLE boss")


def test_superuser_of_another_database_is_warned(boss: URL) -> None:
    url = boss.render_as_string(hide_password=False)
    done = semmap(url, "sql", WHO, "--json")
    assert json.loads(done.stdout) == [{"current_user": "semmap_reader", "session_user": "boss"}]
    assert "this login is a superuser" in done.stderr
    assert done.stderr.count("\n") == 1
    assert "superuser" not in semmap(url, "sql", "--write", WHO).stderr


def test_reader_of_another_database_is_not_warned(embedded: Cluster) -> None:
    reader = embedded.ensure().set(username="semmap_read")
    done = semmap(reader.render_as_string(hide_password=False), "sql", WHO, "--json")
    assert json.loads(done.stdout) == AS_READER
    assert "superuser" not in done.stderr


def test_a_reader_follows_the_changes(embedded: Cluster) -> None:
    reader = embedded.ensure().set(username="semmap_read")
    url = reader.render_as_string(hide_password=False)
    cursor = json.loads(semmap(url, "changes", "--json").stdout)["cursor"]
    assert json.loads(semmap(url, "changes", cursor, "--json").stdout)["changes"] == []
