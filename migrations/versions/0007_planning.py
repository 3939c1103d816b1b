"""Joins that are planned faster, as `tables/090_planning.sql` has it; the code anew, for `face`.

Going down keeps them: they change no answer. A table that was analysed before keeps its histograms,
which cost a part of the gain until the map is imported into a new database.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import drop_code, run_code, run_sql_files

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the indexes anew, set what the planner goes by, and replace the code."""
    drop_code(op)
    op.execute("SET LOCAL search_path = semmap, public")
    run_sql_files(op, "tables/090_planning.sql")
    run_code(op)


def downgrade() -> None:
    """Leave all as it is."""
