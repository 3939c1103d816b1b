"""The tables, as `schema/tables` makes them.

Going down keeps all rows: the schema is put aside as ``semmap_kept``, and going up takes it again.
``semmap db drop`` deletes.
"""

from __future__ import annotations

from alembic import op
from sqlalchemy import text

from semmap.database.migrate import run_sql_files

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the tables, or take those that were kept."""
    run_sql_files(op.get_bind(), "extensions.sql")
    if op.get_bind().scalar(text("SELECT to_regnamespace('semmap_kept') IS NOT NULL")):
        op.execute("ALTER SCHEMA semmap_kept RENAME TO semmap")
    else:
        op.execute("CREATE SCHEMA semmap")
        run_sql_files(op.get_bind(), "tables/*.sql")


def downgrade() -> None:
    """Put the tables aside."""
    op.execute("ALTER SCHEMA semmap RENAME TO semmap_kept")
