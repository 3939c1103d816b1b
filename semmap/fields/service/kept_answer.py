"""What sources and users kept, on the grid of a mirror: for commands without a service."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

from semmap.fields.maps.live_entities import LiveEntities
from semmap.fields.maps.vocabulary import Vocabulary
from semmap.fields.store.map_store import load_maps
from semmap.fields.store.source_history import load_updates
from semmap.fields.store.statements import Connection

if TYPE_CHECKING:
    from semmap.fields.store.mirror_state import MirrorState
    from semmap.fields.store.voxel_mirror import VoxelMirror

__all__ = ["show_kept"]


def show_kept(
    mirror: MirrorState | VoxelMirror, connection: Connection, vocabulary: Vocabulary
) -> datetime | None:
    """Put the maps that were kept last into the buffer of a mirror, and on its grid.

    Returns
    -------
    datetime or None
        When sources last kept one; None if they kept none.
    """
    newest = None
    for source, updates in load_updates(connection, vocabulary).items():
        for each in updates:
            mirror.maps.put(source, each.maps, each.time, provides=each.provides)
            newest = each.time if newest is None else max(newest, each.time)
    mirror.maps.put("kept", load_maps(connection, vocabulary).values())
    LiveEntities(mirror.regions, mirror.names, mirror.roles, mirror.views).update(mirror.maps.now())
    return newest
