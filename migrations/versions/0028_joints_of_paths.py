"""Positions of an arm's joints beside the poses of its path."""

from __future__ import annotations

from alembic import op

revision = "0028"
down_revision = "0027"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add them, empty, to the paths that are stored."""
    op.execute(
        "ALTER TABLE semmap.path ADD COLUMN IF NOT EXISTS joints text[], "
        "ADD COLUMN IF NOT EXISTS positions double precision[], "
        "DROP CONSTRAINT IF EXISTS path_positions_are_those_of_its_joints, "
        "ADD CONSTRAINT path_positions_are_those_of_its_joints CHECK ("
        "num_nulls(joints, positions) = 2 OR array_length(positions, 1) = array_length(poses, 1) "
        "AND array_length(positions, 2) = cardinality(joints))"
    )


def downgrade() -> None:
    """Leave them as they are."""
