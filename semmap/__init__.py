"""semmap: one semantic map of an environment, kept in PostGIS.

>>> import semmap
>>> db = semmap.connect()
>>> flat = db.create_map("flat")
>>> flat.add_room("kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.6)
<room kitchen>
>>> db.drop_map("flat")
1
>>> db.close()
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from semmap.lazy_names import load_on_use

if TYPE_CHECKING:
    from semmap.api.database import Database, connect
    from semmap.api.map import Map
    from semmap.api.map_entity import Door, MapEntity
    from semmap.database.embedded import Cluster
    from semmap.database.error import DatabaseError
    from semmap.error import Error, InvalidArgumentError, UnknownNameError
    from semmap.geometry.pose import Pose
    from semmap.ingest.world import WorldError
    from semmap.query.map_events import MapEvent
    from semmap.query.placements import EntityVersion

    __version__: str

__all__ = [
    "Cluster",
    "Database",
    "DatabaseError",
    "Door",
    "EntityVersion",
    "Error",
    "InvalidArgumentError",
    "Map",
    "MapEntity",
    "MapEvent",
    "Pose",
    "UnknownNameError",
    "WorldError",
    "__version__",
    "connect",
]

_HOMES = {
    "Cluster": "semmap.database.embedded",
    "Database": "semmap.api.database",
    "DatabaseError": "semmap.database.error",
    "Door": "semmap.api.map_entity",
    "EntityVersion": "semmap.query.placements",
    "MapEvent": "semmap.query.map_events",
    "Error": "semmap.error",
    "InvalidArgumentError": "semmap.error",
    "UnknownNameError": "semmap.error",
    "MapEntity": "semmap.api.map_entity",
    "Pose": "semmap.geometry.pose",
    "Map": "semmap.api.map",
    "WorldError": "semmap.ingest.world",
    "connect": "semmap.api.database",
}

_load = load_on_use(__name__, _HOMES)


def __getattr__(name: str) -> Any:
    """Load a public name from its module when it is first used."""
    if name == "__version__":
        from importlib.metadata import version

        return version("semmap")
    return _load(name)
