"""Joins that are planned faster, as `tables/090_planning.sql` has it; the code again; a bound.

Going down keeps them: they change no answer.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import run_sql_files

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


FORGET_HISTOGRAMS = (
    "ALTER TABLE placement ALTER COLUMN entity_id TYPE bigint",
    "ALTER TABLE entity_chunk ALTER COLUMN id TYPE bigint",
)
"""A column that is given its own type again loses its statistics, and no row is written."""


WITHIN = """
DO $$
BEGIN
    IF NOT EXISTS (SELECT FROM pg_constraint WHERE conrelid = 'placement'::regclass
                   AND conname = 'placement_pose_is_within_ten_thousand_kilometres')
       AND NOT EXISTS (SELECT FROM placement
                       WHERE greatest(abs(pose[1]), abs(pose[2]), abs(pose[3])) > 1e7) THEN
        ALTER TABLE placement ADD CONSTRAINT placement_pose_is_within_ten_thousand_kilometres
            CHECK (greatest(abs(pose[1]), abs(pose[2]), abs(pose[3])) <= 1e7);
    END IF;
END $$
"""
"""What is farther off overflows; a map that has such a thing is left as it is."""


def upgrade() -> None:
    """Make the indexes again, and set the statistics that the planner uses."""
    op.execute("SET LOCAL search_path = semmap, public")
    run_sql_files(op, "tables/090_planning.sql")
    for statement in (*FORGET_HISTOGRAMS, WITHIN):
        op.execute(statement)
    run_sql_files(op, "renames.sql")


def downgrade() -> None:
    """Leave all as it is."""
