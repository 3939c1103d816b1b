"""Topologies that load faster: travel times as they are sent, and the code again.

A new database has the column from its first revision on. Going down keeps it.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import run_sql_files

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

PACKED = """
ALTER TABLE semmap.travel_time ADD COLUMN IF NOT EXISTS packed bytea GENERATED ALWAYS AS
    (int8send(place_id) || int8send(from_id) || int8send(to_id)
     || float8send(seconds) || float8send(metres)) STORED
"""


def upgrade() -> None:
    """Add the column where it is missing."""
    run_sql_files(op, "renames.sql")
    op.execute(PACKED)


def downgrade() -> None:
    """Leave the column where it is."""
