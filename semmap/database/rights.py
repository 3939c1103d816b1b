"""What PostgreSQL gives to everybody, and on the embedded database is for some alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from semmap.database.configuration import READER

if TYPE_CHECKING:
    import psycopg

FOR_WRITERS = (
    "pg_notify",
    "pg_advisory_lock",
    "pg_advisory_lock_shared",
    "pg_advisory_xact_lock",
    "pg_advisory_xact_lock_shared",
    "pg_try_advisory_lock",
    "pg_try_advisory_lock_shared",
    "pg_try_advisory_xact_lock",
    "pg_try_advisory_xact_lock_shared",
)
"""Functions that importers, missions and announcements need, and a reader does not."""

FOR_THE_OWNER = (
    "lo_creat",
    "lo_create",
    "lo_from_bytea",
    "lo_put",
    "lo_open",
    "lowrite",
    "lo_truncate",
    "lo_truncate64",
    "lo_unlink",
    "lo_import",
    "lo_export",
    "pg_cancel_backend",
    "pg_terminate_backend",
    "pg_logical_emit_message",
    "pg_sleep",
    "pg_sleep_for",
    "pg_sleep_until",
)
"""Functions that roles do not need: large objects, which a read-only transaction does not protect
before PostgreSQL 16, the end of other sessions, messages in the log, and sleep."""


def _array(names: tuple[str, ...]) -> str:
    quoted = ", ".join(f"'{name}'" for name in names)
    return f"ARRAY[{quoted}]::name[]"


LIMIT_RIGHTS = f"""
DO $$
DECLARE
    role text;
    called regprocedure;
    writers boolean;
BEGIN
    LOCK TABLE pg_catalog.pg_authid IN SHARE ROW EXCLUSIVE MODE;
    FOREACH role IN ARRAY ARRAY['semmap_reader', 'semmap_robot', 'semmap_admin', '{READER}'] LOOP
        IF NOT EXISTS (SELECT FROM pg_catalog.pg_roles WHERE rolname = role) THEN
            EXECUTE format('CREATE ROLE %I', role);
        END IF;
    END LOOP;
    ALTER ROLE {READER} LOGIN NOSUPERUSER NOCREATEDB NOCREATEROLE NOREPLICATION NOBYPASSRLS;
    ALTER ROLE {READER} SET default_transaction_read_only = on;
    FOR role IN
        SELECT roleid::regrole FROM pg_catalog.pg_auth_members
        WHERE member = '{READER}'::regrole AND roleid <> 'semmap_reader'::regrole
    LOOP
        EXECUTE format('REVOKE %s FROM {READER}', role);
    END LOOP;
    IF NOT pg_has_role('{READER}', 'semmap_reader', 'MEMBER') THEN
        GRANT semmap_reader TO {READER};
    END IF;
    FOR called, writers IN
        SELECT oid, proname = ANY ({_array(FOR_WRITERS)}) FROM pg_catalog.pg_proc
        WHERE pronamespace = 'pg_catalog'::regnamespace
          AND proname = ANY ({_array(FOR_WRITERS + FOR_THE_OWNER)})
    LOOP
        EXECUTE format('REVOKE EXECUTE ON FUNCTION %s FROM PUBLIC', called);
        IF writers THEN
            EXECUTE format('GRANT EXECUTE ON FUNCTION %s TO semmap_robot, semmap_admin', called);
        END IF;
    END LOOP;
    EXECUTE format('REVOKE TEMPORARY ON DATABASE %I FROM PUBLIC', current_database());
    EXECUTE format('GRANT TEMPORARY ON DATABASE %I TO semmap_robot, semmap_admin',
                   current_database());
    REVOKE CREATE ON SCHEMA public FROM PUBLIC;
END $$;
"""
"""Makes the login that only reads, and takes from everybody what it must not have; repeatable."""

_EXCESS = f"""
SELECT 'SUPERUSER or another attribute' FROM pg_catalog.pg_roles WHERE rolname = current_user
    AND (rolsuper OR rolcreatedb OR rolcreaterole OR rolreplication OR rolbypassrls)
UNION ALL SELECT 'role ' || rolname FROM pg_catalog.pg_roles
    WHERE rolname NOT IN (current_user, 'semmap_reader') AND pg_has_role(oid, 'MEMBER')
UNION ALL SELECT 'function ' || oid::regprocedure FROM pg_catalog.pg_proc
    WHERE pronamespace = 'pg_catalog'::regnamespace
    AND proname = ANY ({_array(FOR_WRITERS + FOR_THE_OWNER)})
    AND has_function_privilege(oid, 'EXECUTE')
UNION ALL SELECT 'TEMPORARY' WHERE has_database_privilege(current_database(), 'TEMPORARY')
UNION ALL SELECT 'CREATE in public' WHERE has_schema_privilege('public', 'CREATE')
"""


def excess_rights(session: psycopg.Connection[Any]) -> list[str]:
    """The rights of a session's login that a reader must not have."""
    return [row[0] for row in session.execute(_EXCESS)]
