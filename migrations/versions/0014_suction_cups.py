"""Keep suction cups: a form of grippers, and the force of their vacuum."""

from __future__ import annotations

from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Allow the form, and add the column: newtons, null for fingers."""
    op.execute("ALTER TABLE semmap.gripper DROP CONSTRAINT gripper_form_check")
    op.execute(
        "ALTER TABLE semmap.gripper ADD CONSTRAINT gripper_form_is_known "
        "CHECK (form IN ('parallel', 'multi-finger', 'suction'))"
    )
    op.execute(
        "ALTER TABLE semmap.gripper ADD COLUMN force double precision CONSTRAINT "
        "gripper_force_is_positive CHECK (force > 0 AND force < 'Infinity')"
    )
    op.execute(
        "ALTER TABLE semmap.gripper ADD CONSTRAINT gripper_force_is_that_of_suction "
        "CHECK (force IS NULL OR form = 'suction')"
    )


def downgrade() -> None:
    """Drop suction cups and the column."""
    op.execute(
        "UPDATE semmap.automaton SET gripper_id = NULL WHERE gripper_id IN "
        "(SELECT device_id FROM semmap.gripper WHERE form = 'suction')"
    )
    op.execute(
        "DELETE FROM semmap.device WHERE id IN "
        "(SELECT device_id FROM semmap.gripper WHERE form = 'suction')"
    )
    op.execute("ALTER TABLE semmap.gripper DROP COLUMN force")
    op.execute("ALTER TABLE semmap.gripper DROP CONSTRAINT gripper_form_is_known")
    op.execute(
        "ALTER TABLE semmap.gripper ADD CONSTRAINT gripper_form_check "
        "CHECK (form IN ('parallel', 'multi-finger'))"
    )
