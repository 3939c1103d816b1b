"""The results of queries and updates as JSON, for the command line and the socket."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from itertools import islice
from pathlib import Path
from typing import Any

from semmap.fields.queries import SelectResult, StoreResult, query, update
from semmap.fields.queries.catalogue import FieldCatalogue
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.store.map_store import save_map
from semmap.fields.store.mirror_state import MirrorState
from semmap.fields.store.run_statement import Connection
from semmap.fields.store.stated_voxels import save_stated

Open = Callable[[], AbstractContextManager[Connection]]


def query_reply(
    catalogue: FieldCatalogue,
    text: str,
    open_transaction: Open,
    *,
    limit: int | None = None,
    output: str | None = None,
    keep: str | None = None,
) -> dict[str, Any]:
    """Answer a query with at most `limit` rows; write or keep the map of STORE.

    Returns ``{"ask": bool}``, ``{"variables": [...], "rows": [...], "total": int}``, or ``{"store":
    {...}}`` with property, voxels, file, kept and version. ``"left_out"`` lists the entities
    without voxels, of which the answer says nothing.
    """
    result = query(catalogue, text)
    left_out = {"left_out": sorted(catalogue.left_out())}
    if isinstance(result, bool):
        return {"ask": result} | left_out
    if isinstance(result, SelectResult):
        rows = [list(row) for row in islice(result, limit)]
        return {"variables": list(result.names), "rows": rows, "total": len(result)} | left_out
    return {"store": _stored(result, open_transaction, output, keep)} | left_out


def _stored(
    result: StoreResult, open_transaction: Open, output: str | None, keep: str | None
) -> dict[str, Any]:
    summary: dict[str, Any] = {"property": result.property.name, "voxels": len(result)}
    if output is not None:
        result.to_map().write(Path(output))
        summary["file"] = output
    if keep is not None:
        with open_transaction() as connection:
            summary["kept"] = keep
            summary["version"] = save_map(connection, keep, result.to_map(), answer=True)
    return summary


def update_map(
    mirror: MirrorState, catalogue: FieldCatalogue, text: str, session: Any
) -> dict[str, Any]:
    """Carry out a SPARQL update: all of it or nothing.

    Returns `new`, the names of inserted regions by blank node, and the names `changed`. Raises
    QueryError or ValueError: the text is wrong, or changes what a source sees.
    """
    grid, sets = mirror.regions.state()
    of_map = {name for each, name in dict(mirror.names).items() if isinstance(each, int)}
    names = {
        each: name if isinstance(each, int) or name not in of_map else f"{name} as seen"
        for each, name in dict(mirror.names).items()
    }
    copy = RegionMap.from_state(
        grid, {number: [names[each] for each in members] for number, members in sets.items()}
    )
    result = update(copy, text, catalogue)
    seen = {names[each] for each in names if not isinstance(each, int) or each in mirror.seen}
    for name in sorted(result.changed & seen):
        raise ValueError(f"{name} is what a source sees: an update cannot change it")
    with session.transaction():
        for name in sorted(result.changed):
            save_stated(session, name, copy.voxels(name), mirror.regions.voxel_size)
    return {"new": dict(result.new), "changed": sorted(result.changed)}
