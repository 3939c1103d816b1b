"""Nobody gains rights through the schema: its functions, triggers and views."""

from __future__ import annotations

import os
from collections.abc import Iterator

import psycopg
import pytest
from sqlalchemy import Engine, text

ROLES = ("public", "semmap_reader", "semmap_robot", "semmap_admin")

EXECUTABLE = {
    "derive_again": {"semmap_admin"},
    "follow_change": {"semmap_admin"},
    "copy_map": {"semmap_admin"},
    "drop_map": {"semmap_admin"},
    "drop_unused_models": {"semmap_admin"},
    "end_idle_robots": {"semmap_robot", "semmap_admin"},
    "hold_still": {"semmap_robot", "semmap_admin"},
    "prune_changes": {"semmap_admin"},
    "prune_observations": {"semmap_admin"},
    "prune_terms": {"semmap_admin"},
    "prune_history": {"semmap_admin"},
    "prune_written": {"semmap_admin"},
    "refresh_belief": {"semmap_robot", "semmap_admin"},
    "robot_wastes_turn": {"semmap_robot", "semmap_admin"},
    "keep_relation": {"semmap_reader", "semmap_robot", "semmap_admin"},
    "settle": {"semmap_reader", "semmap_robot", "semmap_admin"},
    "note_write": {"semmap_robot", "semmap_admin"},
    "was_written": {"semmap_robot", "semmap_admin"},
}
"""Who may call the functions that run with their owner's rights; the others are for triggers."""


def test_functions_with_their_owners_rights_search_temporary_tables_last(
    module_engine: Engine,
) -> None:
    with module_engine.connect() as connection:
        rows = connection.execute(
            text(
                "SELECT proname, proconfig FROM pg_proc "
                "WHERE pronamespace = 'semmap'::regnamespace AND prosecdef"
            )
        ).all()
    assert len(rows) >= 20
    for name, settings in rows:
        path = [s for s in settings or [] if s.startswith("search_path=")]
        assert path == ["search_path=semmap, public, pg_temp"], name


def test_functions_with_their_owners_rights_are_granted_sparingly(
    module_engine: Engine,
) -> None:
    statement = text(
        "SELECT p.proname, r.role FROM pg_proc p, unnest(CAST(:roles AS text[])) r (role) "
        "WHERE pronamespace = 'semmap'::regnamespace "
        "AND (prosecdef OR prorettype = 'trigger'::regtype) "
        "AND has_function_privilege(r.role, p.oid, 'EXECUTE')"
    )
    found: dict[str, set[str]] = {}
    with module_engine.connect() as connection:
        for name, role in connection.execute(statement, {"roles": list(ROLES)}):
            found.setdefault(name, set()).add(role)
    assert found == EXECUTABLE


def test_no_view_is_written_with_its_owners_rights(module_engine: Engine) -> None:
    statement = text(
        "SELECT relname FROM pg_class c WHERE relnamespace = 'semmap'::regnamespace "
        "AND relkind = 'v' AND pg_relation_is_updatable(oid, false) & 28 <> 0 "
        "AND NOT EXISTS (SELECT FROM pg_trigger t WHERE t.tgrelid = c.oid AND t.tgtype & 64 <> 0 "
        "AND t.tgtype & 4 <> 0 AND t.tgtype & 8 <> 0 AND t.tgtype & 16 <> 0)"
    )
    with module_engine.connect() as connection:
        assert connection.execute(statement).all() == []


SHELF = """
INSERT INTO map (name) VALUES ('m');
INSERT INTO entity (map_id, kind, name)
    SELECT m.id, 'object', v.name FROM map m, (VALUES ('a'), ('b')) v (name);
INSERT INTO placement (entity_id) SELECT id FROM entity WHERE name = 'a';
INSERT INTO placement (entity_id, holder_id)
    SELECT b.id, a.id FROM entity a, entity b WHERE a.name = 'a' AND b.name = 'b';
WITH made AS (
    INSERT INTO model (digest, kind, triangles, hull)
    VALUES ('x', 'box', 2, 'MULTIPOINT Z (0 0 0, 1 1 1)') RETURNING id
), meshed AS (
    INSERT INTO chunk (model_id, number, geom)
    SELECT id, 0, prism_tin(ST_MakeEnvelope(0, 0, 1, 1), 0, 1) FROM made
) INSERT INTO entity_model SELECT e.id, made.id FROM entity e, made;
"""


@pytest.mark.parametrize("view", ["object", "inventory", "fa_to_ob", "face"])
def test_not_even_the_owner_deletes_through_a_view(module_engine: Engine, view: str) -> None:
    with module_engine.connect() as connection:
        connection.exec_driver_sql(SHELF)
        assert connection.execute(text(f"SELECT count(*) FROM {view}")).scalar_one() > 0
        with pytest.raises(Exception, match="is derived and cannot be written"):
            connection.execute(text(f"DELETE FROM {view}"))
        connection.rollback()


@pytest.fixture
def intruder(engine: Engine) -> Iterator[tuple[psycopg.Connection[tuple[object, ...]], str]]:
    """A session of a login that may read, and its name."""
    name = f"intruder_{os.getpid()}"
    with engine.begin() as connection:
        connection.execute(text("INSERT INTO map (name) VALUES ('m')"))
        connection.execute(
            text("INSERT INTO entity (map_id, kind, name) SELECT id, 'object', 'mug' FROM map")
        )
        connection.execute(text("INSERT INTO placement (entity_id) SELECT id FROM entity"))
        connection.execute(text(f"CREATE ROLE {name} IN ROLE semmap_robot"))
    url = engine.url.set(drivername="postgresql").render_as_string(hide_password=False)
    own = psycopg.connect(url, autocommit=True, options="-c search_path=semmap,public")
    own.execute(f"SET SESSION AUTHORIZATION {name}")
    yield own, name
    own.close()
    with engine.begin() as connection:
        connection.execute(text(f"DROP OWNED BY {name}"))
        connection.execute(text(f"DROP ROLE {name}"))


def test_a_temporary_table_does_not_stand_in_for_one_of_the_schema(
    intruder: tuple[psycopg.Connection[tuple[object, ...]], str],
) -> None:
    own, name = intruder
    own.execute(
        "CREATE FUNCTION pg_temp.seize() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "
        f"EXECUTE 'ALTER ROLE {name} SUPERUSER'; RETURN NEW; END $$"
    )
    tables = own.execute(
        "SELECT relname FROM pg_class "
        "WHERE relnamespace = 'semmap'::regnamespace AND relkind = 'r' ORDER BY 1"
    ).fetchall()
    shadows = {str(table): f"(LIKE semmap.{table} INCLUDING DEFAULTS)" for (table,) in tables}
    shadows |= dict.fromkeys(("fresh", "former"), "(id bigint)")  # the transition tables
    assert len(shadows) > 30
    for shadow, columns in shadows.items():
        own.execute(f"CREATE TEMP TABLE {shadow} {columns}")
        own.execute(
            f"CREATE TRIGGER seize BEFORE INSERT OR UPDATE OR DELETE ON pg_temp.{shadow} "
            "FOR EACH ROW EXECUTE FUNCTION pg_temp.seize()"
        )
    own.execute("SET search_path = pg_temp, semmap, public")
    mug = own.execute("SELECT id FROM semmap.entity WHERE name = 'mug'").fetchone()
    assert mug is not None
    own.execute("UPDATE semmap.placement SET pose[1] = 3 WHERE entity_id = %s", mug)
    own.execute("UPDATE semmap.entity SET label = 'x' WHERE id = %s", mug)
    own.execute("SELECT semmap.move_to(%s, 1, 2, 3)", mug)
    own.execute("SELECT semmap.put(%s, NULL)", mug)
    own.execute(
        "INSERT INTO semmap.entity (map_id, kind, name) "
        "SELECT map_id, 'region', 'wet' FROM semmap.entity"
    )
    own.execute(
        "INSERT INTO semmap.region (entity_id) SELECT id FROM semmap.entity WHERE name = 'wet'"
    )
    own.execute("UPDATE semmap.region SET valid = '[2026-01-01, 2026-01-02)'")
    moved = own.execute("SELECT pose[1] FROM semmap.world WHERE entity_id = %s", mug).fetchone()
    assert moved == (1.0,)
    found = own.execute("SELECT rolsuper FROM pg_roles WHERE rolname = current_user").fetchone()
    assert found == (False,)


def test_a_trigger_function_is_not_attached_to_a_users_table(
    intruder: tuple[psycopg.Connection[tuple[object, ...]], str],
) -> None:
    own, _ = intruder
    own.execute("CREATE TEMP TABLE mine (id bigint, entity_id bigint)")
    names = own.execute(
        "SELECT proname FROM pg_proc WHERE pronamespace = 'semmap'::regnamespace "
        "AND prorettype = 'trigger'::regtype"
    ).fetchall()
    assert len(names) > 15
    for (function,) in names:
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            own.execute(
                "CREATE TRIGGER t AFTER DELETE ON mine REFERENCING OLD TABLE AS former "
                f"FOR EACH STATEMENT EXECUTE FUNCTION semmap.{function}()"
            )


def test_a_robot_does_not_stand_in_with_its_mesh_for_an_imported_one(
    engine: Engine, intruder: tuple[psycopg.Connection[tuple[object, ...]], str]
) -> None:
    own, name = intruder
    own.execute(
        "INSERT INTO model (digest, kind, triangles, hull) "
        "VALUES ('abc', 'mesh', 0, 'MULTIPOINT Z (0 0 0)')"
    )
    with engine.connect() as connection:
        digests = connection.execute(text("SELECT digest FROM model")).scalars().all()
    assert digests == [f"{name}/abc"]
