"""Keep the volume that a gripper's fingers pass, and return outcomes of similar shapes one by one.

`gripper.swept`: null before its URDF is read again. Functions are made after the last revision.
"""

from __future__ import annotations

from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the column; grippers are compared by opening and depth where it is null."""
    op.execute(
        "ALTER TABLE semmap.gripper ADD COLUMN swept double precision CONSTRAINT "
        "gripper_swept_is_positive CHECK (swept > 0 AND swept < 'Infinity')"
    )


def downgrade() -> None:
    """Drop the column."""
    op.execute("ALTER TABLE semmap.gripper DROP COLUMN swept")
