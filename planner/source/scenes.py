"""Where things are, for costmaps."""

from __future__ import annotations

from collections.abc import Collection
from datetime import datetime

from sqlalchemy import Connection, text

from semmap.query.storey_reader import read_entities, read_scene, read_storey_names
from semmap.query.storey_scene import SceneEntity, StoreyScene

__all__ = ["read_moment", "read_objects", "read_regions_on", "scene_of"]


def scene_of(connection: Connection, storey: str) -> StoreyScene:
    """The scene of a storey of the current map as it is now; of "" in a map without storeys."""
    name = storey or read_storey_names(connection)[0]
    return read_scene(connection, name, moment=read_moment(connection))


def read_objects(connection: Connection, ids: Collection[int]) -> list[SceneEntity]:
    """The objects among these entities, as scenes have them."""
    return read_entities(connection, ids, kinds=["object"])


def read_regions_on(connection: Connection, storey: str, ids: Collection[int]) -> list[SceneEntity]:
    """The regions among these entities that are in the scene of a storey now."""
    name = storey or read_storey_names(connection)[0]
    moment = read_moment(connection)
    return read_entities(connection, ids, kinds=["region"], storey=name, moment=moment)


def read_moment(connection: Connection) -> datetime:
    """When this transaction began, which is what it means by now."""
    moment: datetime = connection.execute(text("SELECT now()")).scalar_one()
    return moment
