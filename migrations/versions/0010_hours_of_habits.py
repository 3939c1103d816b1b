"""Keep how habits follow the hours of the day.

`learned_lift.by_part`: how many times as often as in the whole day, in each of as many parts of
equal length as it has numbers, from midnight on; null before a map learns again.
`belief_model.time_zone`: of the building, whose clock people live by.
"""

from __future__ import annotations

from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns; habits have no hours until a map learns."""
    op.execute(
        "ALTER TABLE semmap.learned_lift ADD COLUMN by_part double precision[] CONSTRAINT "
        "learned_lift_by_part_is_positive CHECK (0 < ALL (by_part) AND 'Infinity' > ALL (by_part))"
    )
    op.execute(
        "ALTER TABLE semmap.belief_model ADD COLUMN time_zone text NOT NULL DEFAULT 'UTC' "
        "CONSTRAINT belief_model_time_zone_is_known CHECK ("
        "timestamptz '2000-01-01 00:00+00' AT TIME ZONE time_zone IS NOT NULL "
        "AND time_zone !~ '^[A-Za-z]+[+-]?[0-9]')"  # UTC+2 would be two hours west
    )


def downgrade() -> None:
    """Drop the columns: things move as often, to the same places, at all hours of UTC."""
    op.execute("ALTER TABLE semmap.learned_lift DROP COLUMN by_part")
    op.execute("ALTER TABLE semmap.belief_model DROP COLUMN time_zone")
