"""The copy of a map in which a simulated run takes place: the map itself does not change.

Why: docs/decisions/a_simulated_run_happens_in_a_copy_of_the_map.md
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import numpy as np
from sqlalchemy import Connection, Engine, text

from planner.mission.store.mission_list import MissionError
from semmap.geometry.mesh import Mesh
from semmap.ingest.store.holder_store import find_surfaces
from semmap.ingest.store.model_store import store_models
from semmap.ingest.world import Entry, Shape
from semmap.query.snapshot import Snapshot
from semmap.query.storey_reader import read_entities

KEY = 0x73696D75
"""Upper half of the keys of locks on copies. A lock is released when its process dies."""


@contextmanager
def simulation_map(engine: Engine, map_name: str, world: Path | None = None) -> Iterator[str]:
    """The name of a copy of a map, for one simulated run.

    Without a world file, the copy of an earlier run that has ended is replaced, so that one remains
    to look at. With one, runs that share the file share the copy; a copy from before the file was
    made is replaced. A run that is refused before it has a mission leaves the earlier copy as it
    was. Raises MissionError for a login without the role `semmap_admin`.
    """
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        _check_rights(connection, map_name)
        if world is None:
            names = (f"{map_name} (simulated{f' {n}' if n > 1 else ''})" for n in count(1))
            name = next(n for n in names if _take_over(connection, map_name, n))
        else:
            digest = hashlib.sha256(str(world.resolve()).encode()).hexdigest()[:8]
            name = f"{map_name} (simulated in {world.name}, {digest})"
            _share(connection, map_name, name, world)
        try:
            yield name
        except BaseException:
            _restore(connection, name)
            raise
        else:
            _drop(connection, _former(name))
        finally:
            connection.execute(text("SELECT pg_advisory_unlock_all()"))


def _take_over(connection: Connection, map_name: str, name: str) -> bool:
    """Copy a map for this process alone; False if another process or mission needs the copy."""
    if not connection.execute(text(_TRY_LOCK), {"key": KEY, "name": name}).scalar():
        return False
    if connection.execute(text(_UNFINISHED), {"name": name}).scalar():
        connection.execute(text(_UNLOCK), {"key": KEY, "name": name})
        return False
    _copy(connection, map_name, name)
    return True


def _share(connection: Connection, map_name: str, name: str, world: Path) -> None:
    """Copy a map for all processes that use a world file, unless one of them did."""
    alone = connection.execute(text(_TRY_LOCK), {"key": KEY, "name": name}).scalar()
    if alone and not (world.is_file() and _exists(connection, name)):
        _copy(connection, map_name, name)
    connection.execute(text(_SHARED_LOCK), {"key": KEY, "name": name})
    if alone:
        connection.execute(text(_UNLOCK), {"key": KEY, "name": name})


def _check_rights(connection: Connection, map_name: str) -> None:
    user = connection.execute(text(_MAY_NOT_COPY)).scalar()
    if user is not None:
        raise MissionError(
            f"{user} may not copy the map {map_name}, in which a simulated run would take place: "
            f"it needs the role semmap_admin (GRANT semmap_admin TO {user})"
        )


def _copy(connection: Connection, map_name: str, name: str) -> None:
    """Copy a map, and set an earlier copy of this name aside until the run has a mission."""
    if _exists(connection, name):
        _drop(connection, _former(name))
        connection.execute(text(_RENAME), {"name": name, "new": _former(name)})
    connection.execute(text("SELECT copy_map(:map, :name)"), {"map": map_name, "name": name})


def _restore(connection: Connection, name: str) -> None:
    """Put the earlier copy in the place of one in which no mission has begun."""
    if _exists(connection, _former(name)):
        begun = connection.execute(text(_HAS_MISSIONS), {"name": name}).scalar()
        _drop(connection, _former(name) if begun else name)
        if not begun:
            connection.execute(text(_RENAME), {"name": _former(name), "new": name})


def _former(name: str) -> str:
    """The name under which the earlier copy is set aside."""
    return f"{name}, former"


def _drop(connection: Connection, name: str) -> None:
    if _exists(connection, name):
        connection.execute(text("SELECT drop_map(:name)"), {"name": name})


def _exists(connection: Connection, name: str) -> bool:
    found = connection.execute(text("SELECT 1 FROM map WHERE name = :name"), {"name": name})
    return found.scalar() is not None


_MAY_NOT_COPY = """
SELECT current_user WHERE NOT has_function_privilege('copy_map(text, text)', 'EXECUTE')
"""

_ID = "(CAST(:key AS bigint) << 32) # (hashtext(:name) & 2147483647)"

_TRY_LOCK = f"SELECT pg_try_advisory_lock({_ID})"

_SHARED_LOCK = f"SELECT pg_advisory_lock_shared({_ID})"

_UNLOCK = f"SELECT pg_advisory_unlock({_ID})"

_RENAME = "UPDATE map SET name = :new WHERE name = :name"

_HAS_MISSIONS = """
SELECT EXISTS (SELECT FROM mission s JOIN map m ON m.id = s.map_id WHERE m.name = :name)
"""

_UNFINISHED = """
SELECT EXISTS (SELECT FROM mission s JOIN map m ON m.id = s.map_id
               WHERE m.name = :name AND s.state IN ('waiting', 'running'))
"""


DIGITS = 6  # decimals of the corners, so that equal boxes at different places are one model


def store_assumed_sizes(seen: Snapshot) -> list[str]:
    """Give the objects without geometry a typical box for their type, and return their names.

    For maps in which a simulation happens: what is assumed is no part of a map that robots share.
    """
    found = read_entities(seen, kinds=["object"], assume_sizes=True)
    assumed = [entity for entity in found if entity.assumed]
    entries = []
    for entity in assumed:
        corners = entity.pose.inverse().apply(entity.triangles.reshape(-1, 3)).round(DIGITS) + 0.0
        vertices, faces = np.unique(corners, axis=0, return_inverse=True)
        mesh = Mesh(vertices, faces.reshape(-1, 3).astype(np.int32))
        entries.append(Entry(entity.name, "object", shapes=[Shape("box", mesh)]))
    session = seen.session
    with session.cursor() as cursor:
        models, _ = store_models(cursor, entries, lambda stage, done, total: None)
        rows = [
            (entity.id, models[id(entry.shapes[0])])
            for entity, entry in zip(assumed, entries, strict=True)
        ]
        cursor.executemany("INSERT INTO entity_model (entity_id, model_id) VALUES (%s, %s)", rows)
    ((map_id,),) = session.execute("SELECT current_map()").fetchall()
    find_surfaces(session, map_id)
    return sorted(entity.name for entity in assumed)
