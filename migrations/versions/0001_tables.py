"""The tables: maps, entities, geometry, placements, history.

Going down keeps the data: the schema is put aside as ``semmap_kept`` and taken up again on the way
up, so that no row is lost. ``semmap db drop`` is what deletes.
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
    """Make the tables, or take up those that were kept."""
    kept = op.get_bind().scalar(text("SELECT to_regnamespace('semmap_kept') IS NOT NULL"))
    if kept:
        op.execute("ALTER SCHEMA semmap_kept RENAME TO semmap")
        return
    op.execute("CREATE EXTENSION IF NOT EXISTS postgis SCHEMA public")
    op.execute("CREATE SCHEMA semmap")
    op.execute("SET LOCAL search_path = semmap, public")
    run_sql_files(op, "tables/*.sql")


def downgrade() -> None:
    """Put the tables aside."""
    op.execute("ALTER SCHEMA semmap RENAME TO semmap_kept")
