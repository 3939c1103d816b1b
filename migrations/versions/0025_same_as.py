"""Links between records as owl:sameAs.

The functions of the schema are made again with each revision; no table changes.
"""

from __future__ import annotations

revision = "0025"
down_revision = "0023"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Change no table."""


def downgrade() -> None:
    """Change no table."""
