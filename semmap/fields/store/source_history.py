"""What sources saw, kept in the database: their newest maps and the former ones.

A record is a version of the field `source NAME`: the time, the properties that the source provided,
and the versions of the fields of its maps. A map that did not change has no new version.
"""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

from semmap.fields.maps.grids import empty_grid
from semmap.fields.maps.lattice import Lattice
from semmap.fields.maps.map_buffer import SourceUpdate
from semmap.fields.maps.representation_map import RepresentationMap
from semmap.fields.store import field_store
from semmap.fields.store.map_store import load_map, save_map
from semmap.fields.store.run_statement import Connection, run
from semmap.query.snapshot import Snapshot

if TYPE_CHECKING:
    from semmap.fields.maps.vocabulary import Properties

RECORD = "urn:semmap:ontology#provides"
"""The property of records; no map has it."""


class SourceHistory:
    """Keeps that many updates of each source; for one thread."""

    def __init__(self, keep: int) -> None:
        self._keep = keep
        self._newest: dict[str, SourceUpdate] = {}
        self._versions: dict[str, tuple[RepresentationMap, int]] = {}

    def save(self, connection: Connection, updates: dict[str, SourceUpdate]) -> int:
        """Keep the newest update of each source that has a new one; return how many were kept."""
        fresh = {n: each for n, each in updates.items() if self._newest.get(n) is not each}
        for source, update in fresh.items():
            fields: dict[str, int] = {}
            for map in update.maps:
                name = " ".join(filter(None, (source, map.property.name, map.about)))
                while name in fields:
                    name += " +"
                fields[name] = self._save_map(connection, name, map, update.time)
            field_store.save(
                connection,
                f"source {source}",
                empty_grid("bool", Lattice(1.0)),
                property=RECORD,
                state={"source": source, "provides": sorted(update.provides), "maps": fields},
                at=update.time,
            )
            field_store.prune(connection, f"source {source}", self._keep)
            for name in fields:
                field_store.prune(connection, name, self._keep)
            self._newest[source] = update
        return len(fresh)

    def _save_map(
        self, connection: Connection, name: str, map: RepresentationMap, time: datetime
    ) -> int:
        before = self._versions.get(name)
        if before is not None and before[0] is map:
            return before[1]
        number = save_map(connection, name, map, state={"of": "source"}, at=time)
        self._versions[name] = (map, number)
        return number


def load_updates(
    seen: Snapshot,
    vocabulary: Properties,
    begin: datetime | None = None,
    end: datetime | None = None,
) -> dict[str, list[SourceUpdate]]:
    """Return the kept updates of each source, the oldest first: the newest, or those in between."""
    rows = run(
        seen.session,
        "SELECT * FROM (SELECT f.name, v.at, v.state, "
        "lead(v.at) OVER (PARTITION BY f.id ORDER BY v.version) AS until "
        "FROM field f JOIN field_version v ON v.field_id = f.id "
        "WHERE f.map_id = current_map() AND f.property = %(record)s) each "
        "WHERE CASE WHEN %(begin)s::timestamptz IS NULL THEN until IS NULL ELSE "
        "at <= %(end)s::timestamptz AND (until IS NULL OR until > %(begin)s) END ORDER BY at",
        {"record": RECORD, "begin": begin, "end": end},
    )
    loaded: dict[tuple[str, int], RepresentationMap | None] = {}
    found: dict[str, list[SourceUpdate]] = {}
    for row in rows:
        versions = row.state["maps"].items()
        for each in versions:
            if each not in loaded:
                loaded[each] = load_map(seen, vocabulary, *each)
        maps = tuple(map for each in versions if (map := loaded[each]) is not None)
        source, provides = row.state["source"], frozenset(row.state["provides"])
        found.setdefault(source, []).append(SourceUpdate(row.at, maps, provides, source))
    return found
