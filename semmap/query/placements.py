"""Where an entity was: its former poses in the map's frame and its former holders."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import zip_longest

from semmap.geometry.pose import Pose
from semmap.query.snapshot import Snapshot


@dataclass(frozen=True)
class EntityVersion:
    """Where an entity was from `begin` to `end`, which is None for the present version.

    `pose` is in the map's frame, also where a holder carried it; `holder` is the last name of what
    held it, None for the map itself.
    """

    begin: datetime
    end: datetime | None
    pose: Pose
    holder: str | None


_WITHIN_ONE = timedelta(microseconds=1)
"""Between versions of one entity that one statement makes: it moves, and gets another holder."""


def read_history(seen: Snapshot, entity: int, since: datetime | None = None) -> list[EntityVersion]:
    """The versions of an entity's place that the map has, the oldest first, that end after `since`.

    A version begins when the entity moves, when what holds it moves, and when it gets another
    holder. The retention of the map thins out those of agents (`docs/semmap.md`).
    """
    rows = seen.session.execute(
        "WITH RECURSIVE above (id) AS (SELECT %(id)s::bigint UNION SELECT v.holder_id FROM above a "
        "CROSS JOIN LATERAL (SELECT holder_id FROM placement WHERE entity_id = a.id UNION "
        "SELECT holder_id FROM placement_history WHERE entity_id = a.id) v "
        "WHERE v.holder_id IS NOT NULL), moment (t) AS ("
        "SELECT p.since FROM above a JOIN placement p ON p.entity_id = a.id UNION "
        "SELECT unnest(ARRAY[lower(h.during), upper(h.during)]) "
        "FROM above a JOIN placement_history h ON h.entity_id = a.id) "
        "SELECT t, pose_at(%(id)s, t), coalesce(e.name, (SELECT h.name FROM entity_history h "
        "WHERE h.entity_id = p.holder_id AND h.ended)) FROM moment "
        "CROSS JOIN LATERAL placement_at(%(id)s, t) p LEFT JOIN entity e ON e.id = p.holder_id "
        "WHERE p.pose IS NOT NULL OR t > (SELECT min(lower(h.during)) FROM placement_history h "
        "WHERE h.entity_id = %(id)s) ORDER BY t",
        {"id": entity},
    ).fetchall()
    left = [
        row
        for row, following in zip_longest(rows, rows[1:])
        if following is None or following[0] - row[0] > _WITHIN_ONE
    ]
    states = [row for n, row in enumerate(left) if n == 0 or (row[1], row[2]) != (left[n - 1][1:])]
    ends = [row[0] for row in [*states[1:], (None,)]][: len(states)]
    return [
        EntityVersion(begin, end, Pose(*pose), holder)
        for (begin, pose, holder), end in zip(states, ends, strict=True)
        if pose is not None and (end is None or since is None or end > since)
    ]
