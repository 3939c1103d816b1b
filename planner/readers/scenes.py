"""Reads what costmaps are made of."""

from __future__ import annotations

from collections.abc import Collection

from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_entities, read_scene, read_storey_names
from semmap.query.storey_scene import SceneEntity, StoreyScene


def read_storey_scene(seen: Snapshot, storey: str, *, assume_sizes: bool = False) -> StoreyScene:
    """The present scene of a storey of the current map; of "" in a map that has no storeys."""
    name = storey or read_storey_names(seen)[0]
    return read_scene(seen, name, moment=seen.moment, assume_sizes=assume_sizes)


def read_objects(
    seen: Snapshot, ids: Collection[int], *, assume_sizes: bool = False
) -> list[SceneEntity]:
    """The objects among the entities with these ids."""
    return read_entities(seen, ids, kinds=["object"], assume_sizes=assume_sizes)


def read_storey_regions(seen: Snapshot, storey: str, ids: Collection[int]) -> list[SceneEntity]:
    """The regions among the entities with these ids that lie on a storey and are valid now."""
    name = storey or read_storey_names(seen)[0]
    return read_entities(seen, ids, kinds=["region"], storey=name, moment=seen.moment)
