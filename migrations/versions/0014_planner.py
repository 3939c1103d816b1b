"""Copies of maps, in which simulated runs take place, and pgRouting where the server has it.

Connectors whose places were deleted are deleted, too.
"""

from __future__ import annotations

from alembic import op

revision = "0014"
down_revision = "0011"
branch_labels = None
depends_on = None

PGROUTING = """
DO $$ BEGIN
    IF EXISTS (SELECT FROM pg_extension
               WHERE extname = 'pgrouting' AND extnamespace = 'semmap'::regnamespace) THEN
        ALTER EXTENSION pgrouting SET SCHEMA public;  -- created with the search path of semmap
    ELSIF EXISTS (SELECT FROM pg_available_extensions WHERE name = 'pgrouting') THEN
        CREATE EXTENSION IF NOT EXISTS pgrouting SCHEMA public;
    END IF;
EXCEPTION WHEN insufficient_privilege THEN
    RAISE NOTICE 'only an administrator can create the extension pgrouting';
END $$
"""


def upgrade() -> None:
    """Create the extension and the column, delete connectors without a row."""
    op.execute(PGROUTING)
    op.execute(
        "ALTER TABLE semmap.map ADD COLUMN IF NOT EXISTS "
        "copy_of integer REFERENCES semmap.map ON DELETE CASCADE"
    )
    op.execute(
        "DELETE FROM semmap.entity e WHERE e.kind = 'connector' "
        "AND NOT EXISTS (SELECT FROM semmap.connector c WHERE c.entity_id = e.id)"
    )


def downgrade() -> None:
    """Keep the column, and the extension, which others may use."""
