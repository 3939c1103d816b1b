"""Joins that are planned faster, as `tables/090_planning.sql` has it; the code anew, for `face`.

Going down keeps them: they change no answer.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import drop_code, run_code, run_sql_files

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


FORGET_HISTOGRAMS = (
    "ALTER TABLE placement ALTER COLUMN entity_id TYPE bigint",
    "ALTER TABLE entity_chunk ALTER COLUMN id TYPE bigint",
)
"""A column that is given its own type anew loses its statistics, and no row is written."""


def upgrade() -> None:
    """Make the indexes anew, set what the planner goes by, and replace the code."""
    drop_code(op)
    op.execute("SET LOCAL search_path = semmap, public")
    run_sql_files(op, "tables/090_planning.sql")
    for statement in FORGET_HISTOGRAMS:
        op.execute(statement)
    run_code(op)


def downgrade() -> None:
    """Leave all as it is."""
