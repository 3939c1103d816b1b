"""Reads what costmaps are made of."""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime

from sqlalchemy import Connection, text

from semmap.query.storey_reader import read_entities, read_scene, read_storey_names
from semmap.query.storey_scene import SceneEntity, StoreyScene

__all__ = ["read_moment", "read_objects", "read_storey_regions", "read_storey_scene"]


def read_storey_scene(
    connection: Connection, storey: str, *, assume_sizes: bool = False
) -> StoreyScene:
    """The present scene of a storey of the current map; of "" in a map that has no storeys."""
    name, moment = storey or read_storey_names(connection)[0], read_moment(connection)
    return read_scene(connection, name, moment=moment, assume_sizes=assume_sizes)


def read_objects(
    connection: Connection, ids: Collection[int], *, assume_sizes: bool = False
) -> list[SceneEntity]:
    """The objects among the entities with these ids."""
    return read_entities(connection, ids, kinds=["object"], assume_sizes=assume_sizes)


def read_storey_regions(
    connection: Connection, storey: str, ids: Collection[int]
) -> list[SceneEntity]:
    """The regions among the entities with these ids that lie on a storey and are valid now."""
    name = storey or read_storey_names(connection)[0]
    moment = read_moment(connection)
    return read_entities(connection, ids, kinds=["region"], storey=name, moment=moment)


def read_moment(connection: Connection) -> datetime:
    """When this transaction began."""
    moment: datetime = connection.execute(text("SELECT now()")).scalar_one()
    return moment
