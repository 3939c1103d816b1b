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
    from semmap.api.database import Database as Database
    from semmap.api.database import connect as connect
    from semmap.api.map import Map as Map
    from semmap.api.map_entity import Door as Door
    from semmap.api.map_entity import MapEntity as MapEntity
    from semmap.database.embedded import Cluster as Cluster
    from semmap.database.error import DatabaseError as DatabaseError
    from semmap.error import Error as Error
    from semmap.error import InvalidArgumentError as InvalidArgumentError
    from semmap.error import UnknownNameError as UnknownNameError
    from semmap.geometry.pose import Pose as Pose
    from semmap.ingest.world import WorldError as WorldError
    from semmap.query.map_events import MapEvent as MapEvent
    from semmap.query.placements import EntityVersion as EntityVersion

    __version__: str

_load, __all__ = load_on_use(__name__)
__all__ += ["__version__"]


def __getattr__(name: str) -> Any:
    """Load a public name from its module when it is first used."""
    if name == "__version__":
        from importlib.metadata import version

        return version("semmap")
    return _load(name)
