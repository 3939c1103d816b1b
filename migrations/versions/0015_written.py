"""Keep the keys of transactions, by which a client learns whether one was committed.

A connection that breaks during a commit leaves the client in doubt. A transaction stores its key,
as done, with what it writes; the question whether it did stores the key as not done, so that a
transaction that is late cannot be committed any more.
"""

from __future__ import annotations

from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table; retention prunes it."""
    op.execute(
        "CREATE TABLE semmap.written ("
        "key uuid PRIMARY KEY, done boolean NOT NULL, "
        "at timestamptz NOT NULL DEFAULT clock_timestamp())"
    )
    op.execute("CREATE INDEX written_at ON semmap.written USING brin (at)")


def downgrade() -> None:
    """Drop the table: transactions are written without keys."""
    op.execute("DROP TABLE semmap.written")
