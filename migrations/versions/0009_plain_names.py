"""Plain names: `travel_time` for `walk`, `command` and `message` of a step of a mission.

A new database has the names from its first revision on. Going down keeps them.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import run_sql_files

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Rename what has an old name."""
    run_sql_files(op, "renames.sql")


def downgrade() -> None:
    """Leave the names as they are."""
