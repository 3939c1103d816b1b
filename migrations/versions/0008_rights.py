"""Rights that hold against a reader or robot that means harm, isolation, and retention.

A new database has the columns and tables from its first revision on. Going down keeps them.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import run_sql_files

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

STATEMENTS = (
    "SET LOCAL search_path = semmap, public",
    "ALTER TABLE entity_history ADD COLUMN IF NOT EXISTS ended boolean NOT NULL DEFAULT false",
    """
    UPDATE entity_history h SET ended = true
    WHERE NOT EXISTS (SELECT FROM entity e WHERE e.id = h.entity_id)
      AND NOT EXISTS (SELECT FROM entity_history n
                      WHERE n.entity_id = h.entity_id AND lower(n.during) > lower(h.during))
    """,
    "CREATE INDEX IF NOT EXISTS entity_history_ended ON entity_history (upper(during)) WHERE ended",
    """
    CREATE TABLE IF NOT EXISTS change_pruned (
        id  integer PRIMARY KEY DEFAULT 1 CHECK (id = 1),
        xid bigint NOT NULL
    )
    """,
    """
    INSERT INTO retention (kind, keep_every, keep_for)
    VALUES ('object', NULL, '1 year'), ('change', NULL, '7 days') ON CONFLICT DO NOTHING
    """,
)

CHECKS = (
    ("retention", "retention_keep_every_check", "keep_every > '0'", None),
    ("retention", "retention_keep_for_check", "keep_for > '0'", None),
    ("entity", "entity_since_is_finite", "isfinite(since)", "since = now()"),
    ("placement", "placement_since_is_finite", "isfinite(since)", "since = now()"),
)
"""Table, name of a constraint, its condition, and what is set where a row does not meet it."""

ADD_CHECK = """
DO $$
BEGIN
    IF NOT EXISTS (SELECT FROM pg_constraint
                   WHERE conrelid = '{table}'::regclass AND conname = '{name}') THEN
        {repair}
        ALTER TABLE {table} ADD CONSTRAINT {name} CHECK ({condition});
    END IF;
END $$
"""


def upgrade() -> None:
    """Add what is missing."""
    for statement in STATEMENTS:
        op.execute(statement)
    for table, name, condition, value in CHECKS:
        repair = f"UPDATE {table} SET {value} WHERE NOT {condition};" if value else ""
        op.execute(ADD_CHECK.format(table=table, name=name, condition=condition, repair=repair))
    run_sql_files(op, "renames.sql")


def downgrade() -> None:
    """Leave all as it is."""
