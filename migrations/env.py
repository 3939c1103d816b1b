"""Alembic's environment: the caller's connection, the caller's transaction."""

from __future__ import annotations

from alembic import context
from sqlalchemy import Connection

from semmap.database.error import DatabaseError
from semmap.database.revisions import VERSION_SCHEMA, VERSION_TABLE


def run(connection: Connection) -> None:
    """Run the revisions asked for in the transaction that `connection` is in."""
    context.configure(
        connection=connection,
        version_table=VERSION_TABLE,
        version_table_schema=VERSION_SCHEMA,
        transactional_ddl=True,
        transaction_per_migration=False,
    )
    context.run_migrations()
    # who only reads asks for the revision, too
    connection.exec_driver_sql(f"GRANT SELECT ON {VERSION_SCHEMA}.{VERSION_TABLE} TO PUBLIC")


given = context.config.attributes.get("connection")
if not isinstance(given, Connection) or context.is_offline_mode():
    raise DatabaseError("revisions run on a connection: semmap db upgrade, semmap db downgrade")
run(given)
