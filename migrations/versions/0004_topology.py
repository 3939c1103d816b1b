"""Classes of robots and their travel times: the tables, and the code again, views and rights.

A new database has the tables from its first revision on. Going down keeps them, and every row.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import make_tables, run_sql_files

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the tables where they are missing."""
    make_tables(op, "070_topology.sql", "robot_class")
    make_tables(op, "080_missions.sql", "mission")
    run_sql_files(op, "renames.sql")


def downgrade() -> None:
    """Leave the tables where they are."""
