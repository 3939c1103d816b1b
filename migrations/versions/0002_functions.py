"""Functions, triggers, views and roles: all that is code, so that it can be replaced as a whole."""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import drop_code, make_tables, run_sql_files

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the tables that renames speak of."""
    make_tables(op, "060_fields.sql", "field")
    make_tables(op, "070_topology.sql", "robot_class")
    make_tables(op, "080_missions.sql", "mission")
    run_sql_files(op, "renames.sql")


def downgrade() -> None:
    """Drop all code of the schema; the tables and their rows stay."""
    drop_code(op.get_bind())
