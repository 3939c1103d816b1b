"""INSERT and DELETE on the grid of a map: carried out on a copy, and kept in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from semmap.fields.queries import update
from semmap.fields.queries.statements import Catalogue
from semmap.fields.regions.region_map import RegionMap
from semmap.fields.store.stated_voxels import save_stated

if TYPE_CHECKING:
    from semmap.fields.store.mirror_state import MirrorState


def update_map(
    mirror: MirrorState, catalogue: Catalogue, text: str, session: Any
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
    seen = {names[each] for each in names if not isinstance(each, int)}
    for name in sorted(result.changed & seen):
        raise ValueError(f"{name} is what a source sees: an update cannot change it")
    with session.transaction():
        for name in sorted(result.changed):
            save_stated(session, name, copy.voxels(name), mirror.regions.voxel_size)
    return {"new": dict(result.new), "changed": sorted(result.changed)}
