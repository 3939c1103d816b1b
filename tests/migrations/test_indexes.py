"""The indexes of the tables: no code names them, so that a lost one would only be slow."""

from pathlib import Path

from sqlalchemy import create_engine, text

INDEXES = Path(__file__).with_name("indexes.txt")


def test_the_tables_have_their_indexes(database: str) -> None:
    """Those of keys and constraints apart, which the tables state themselves."""
    engine = create_engine(database)
    with engine.connect() as connection:
        found = connection.execute(
            text(
                "SELECT pg_get_indexdef(i.indexrelid) FROM pg_index i "
                "JOIN pg_class c ON c.oid = i.indrelid "
                "WHERE c.relnamespace = 'semmap'::regnamespace AND NOT EXISTS "
                "(SELECT FROM pg_constraint WHERE conindid = i.indexrelid AND conrelid = c.oid)"
            )
        ).scalars()
        assert sorted(found) == INDEXES.read_text().splitlines()
    engine.dispose()
