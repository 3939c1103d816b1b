"""The span of time of which the updates of sources are kept."""

from __future__ import annotations

from datetime import datetime

from semmap.fields.store.run_statement import Connection, run
from semmap.fields.store.source_history import RECORD


def kept_span(connection: Connection) -> tuple[datetime, datetime] | None:
    """Return the times of the oldest and the newest update that are kept; None without any."""
    (row,) = run(
        connection,
        "SELECT min(v.at) AS first, max(v.at) AS last FROM field_version v "
        "JOIN field f ON f.id = v.field_id WHERE f.map_id = current_map() AND f.property = %(p)s",
        {"p": RECORD},
    )
    return None if row.first is None else (row.first, row.last)
