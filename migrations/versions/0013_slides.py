"""Store openings along a slide: a motion of kind `open` may be a translation.

The constraint took an axis with an angle alone, which no drawer has.
"""

from __future__ import annotations

from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

MOTION = """
ALTER TABLE semmap.action DROP CONSTRAINT action_motion_is_that_of_its_kind,
ADD CONSTRAINT action_motion_is_that_of_its_kind CHECK (
    coalesce(cardinality(motion), 0) = ANY (CASE kind WHEN 'push' THEN ARRAY[3]
        WHEN 'turn' THEN ARRAY[7] WHEN 'open' THEN {open} ELSE ARRAY[0] END)
    AND coalesce(array_position(motion, NULL) IS NULL AND 'NaN' <> ALL (motion)
                 AND 'Infinity' > ALL (motion) AND '-Infinity' < ALL (motion), true))
"""


def upgrade() -> None:
    """Allow three numbers, too."""
    op.execute(MOTION.format(open="ARRAY[3, 7]"))


def downgrade() -> None:
    """Delete openings along a slide, which former versions cannot store; their tasks stay."""
    op.execute("DELETE FROM semmap.action WHERE kind = 'open' AND cardinality(motion) = 3")
    op.execute(MOTION.format(open="ARRAY[7]"))
