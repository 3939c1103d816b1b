"""The database with the rights of a reader."""

from __future__ import annotations

from semmap.api.database import Database, connect


def reading_database(database: Database) -> Database:
    """Open the same database for what only reads: by the login that only reads, else as its role.

    psycopg.Error where the login of the database may not take the role `semmap_reader`.
    """
    engine = database.reading_engine
    url = engine.url.set(drivername="postgresql")
    if engine is database.engine:
        url = url.update_query_dict({"options": "-c role=semmap_reader"}, append=True)
    return connect(url.render_as_string(hide_password=False), migrate=False)
