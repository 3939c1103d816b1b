"""Topologies that load faster: walks as they are sent, and the code anew, for `current_map`.

A new database has the column from its first revision on. Going down keeps it.
"""

from __future__ import annotations

from alembic import op

from semmap.database.migrate import drop_code, run_code

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

PACKED = """
ALTER TABLE semmap.walk ADD COLUMN IF NOT EXISTS packed bytea GENERATED ALWAYS AS
    (int8send(place_id) || int8send(from_id) || int8send(to_id)
     || float8send(seconds) || float8send(metres)) STORED
"""


def upgrade() -> None:
    """Add the column where it is missing, and replace the code."""
    drop_code(op)
    op.execute(PACKED)
    run_code(op)


def downgrade() -> None:
    """Leave the column where it is."""
