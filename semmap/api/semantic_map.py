"""One map: its entities by name, questions to it, what changes it."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from psycopg import errors
from psycopg.pq import TransactionStatus

from semmap.api.map_entity import MapEntity
from semmap.query import entity_query
from semmap.query.entity_query import Near

if TYPE_CHECKING:
    import psycopg
    import shapely
    import trimesh
    from sqlalchemy.orm import Session

    from semmap.api.database import Database
    from semmap.geometry.mesh import Mesh
    from semmap.ingest.importer import ImportSummary
    from semmap.ingest.store.model_store import Progress

__all__ = ["SemanticMap"]

ATTEMPTS = 5
"""How often a single statement is tried that PostgreSQL ends to resolve a deadlock."""

PlanarPose = Sequence[float]
"""(x, y, z, yaw): metres and radians in the map's frame; yaw may be left out."""


class SemanticMap:
    """A map of one environment, by the names of its entities.

    Attributes
    ----------
    database : Database
    name : the name of the map
    """

    def __init__(self, database: Database, name: str) -> None:
        self.database, self.name = database, name

    def __getitem__(self, name: str) -> MapEntity:
        """The entity of a name.

        Raises
        ------
        LookupError
            The map has none; the message names those that come near it.
        """
        return MapEntity(self, entity_query.entity_id(self._session(), name))

    def __contains__(self, name: object) -> bool:
        return bool(self.execute("SELECT entity_id(%s)", name)[0][0])

    def __iter__(self) -> Iterator[MapEntity]:
        return iter(self.find())

    def __len__(self) -> int:
        return int(self.execute("SELECT count(*) FROM entity WHERE map_id = current_map()")[0][0])

    def __repr__(self) -> str:
        return f"<map {self.name}>"

    # --- questions

    def find(
        self,
        type: str | None = None,
        *,
        in_: str | None = None,
        label: str | None = None,
        where: Mapping[str, Any] | None = None,
        near: Near | None = None,
        within: float | None = None,
        box: Sequence[float] | None = None,
    ) -> list[MapEntity]:
        """The entities that meet all conditions; with `near`, the nearest first, else by name.

        Parameters
        ----------
        type : a semantic type; its subtypes count
        in_ : name of an entity that holds them, or holds what holds them
        label : the property label of the entity or of its type, such as ``kitchen``
        where : properties and their values
        near : a point (x, y, z) in the map's frame, metres, or the name of an entity
        within : metres from `near` to the entity's 3D box
        box : (x0, y0, z0, x1, y1, z1), metres: the entity's 3D box meets it

        Raises
        ------
        LookupError, ValueError
            As `semmap.query.entity_query.find`.
        """
        rows = self.table(
            type, in_=in_, label=label, where=where, near=near, within=within, box=box
        )
        return [self[row["name"]] for row in rows]

    def table(
        self, type: str | None = None, *, in_: str | None = None, **conditions: Any
    ) -> list[dict[str, Any]]:
        """As `find`, but plain rows, as ``semmap ls --json`` prints them."""
        return entity_query.find(self._session(), type=type, holder=in_, **conditions)

    def describe(self, name: str, at: datetime | None = None) -> dict[str, Any]:
        """All that the map has of an entity; with `at`, also where it was then."""
        return entity_query.describe(self._session(), name, at)

    def types(self) -> list[dict[str, Any]]:
        """The semantic types with their parents, and how many entities of the map are of each."""
        return entity_query.list_types(self._session())

    def incomplete(self) -> list[dict[str, Any]]:
        """The entities that lack geometry, type, placement or topology."""
        return entity_query.list_incomplete(self._session())

    def check(self) -> list[dict[str, Any]]:
        """Where the map disagrees with itself; empty for a sound map."""
        return entity_query.contradictions(self._session())

    def changes(
        self, since: str | None = None, *, follow: bool = False, stop: threading.Event | None = None
    ) -> Iterator[dict[str, Any]]:
        """What changed in the map, one change after the other: `what`, `names`, `at`, `cursor`.

        Parameters
        ----------
        since : the `cursor` of a change that was seen; by default from now on where `follow`,
            else all changes that are kept
        follow : wait for more, until `stop` is set

        Yields
        ------
        Dictionaries; an entity that was deleted since has None for its name.
        """
        if since is None and follow:
            since = str(self.execute("SELECT change_cursor()")[0][0])
        while True:
            cursor, rows = entity_query.changes_since(self._session(), since)
            for row in rows:
                if row["map"] == self.name:
                    yield self._change(row, cursor)
            since = cursor
            if not follow or (stop is not None and stop.is_set()):
                return
            self._wait(stop)

    def _change(self, row: dict[str, Any], cursor: str) -> dict[str, Any]:
        names = dict(
            self.execute("SELECT id, name FROM entity WHERE id = ANY (%s)", row["entities"])
        )
        return {
            "what": row["what"],
            "names": [names.get(number) for number in row["entities"]],
            "at": row["at"],
            "cursor": cursor,
        }

    def _wait(self, stop: threading.Event | None, seconds: float = 0.5) -> None:
        """Wait for the next change; a change between two looks is found at the next one."""
        session = self._session()
        session.execute("LISTEN semmap")
        for _ in session.notifies(timeout=seconds, stop_after=1):
            return

    # --- changes

    def import_file(
        self,
        path: str | Path,
        *,
        geometry: Literal["visual", "collision"] = "visual",
        mesh_as: Literal["object", "room"] = "object",
        strict: bool = False,
        source: str | None = None,
        progress: Progress = lambda stage, done, total: None,
    ) -> ImportSummary:
        """Read a world file into the map, in one transaction; a repeated import updates it.

        Raises
        ------
        WorldError
            The file cannot be used as a whole; the map stays as it was.
        """
        from semmap.ingest.importer import import_file

        return import_file(
            self.database.engine,
            Path(path),
            map_name=self.name,
            geometry=geometry,
            mesh_as=mesh_as,
            strict=strict,
            source=source,
            progress=progress,
        )

    def add_storey(
        self, name: str, *, elevation: float = 0.0, height: float | None = None
    ) -> MapEntity:
        """Add a storey: its floor's height above the map's origin and its clear height, metres."""
        from semmap.api.additions import storey

        return self._add(storey(name, elevation, height))

    def add_room(
        self,
        name: str,
        polygon: shapely.Polygon | Sequence[Sequence[float]],
        *,
        floor: float = 0.0,
        ceiling: float | None = None,
        storey: str | None = None,
        type: str | None = None,
        label: str | None = None,
    ) -> MapEntity:
        """Add a room.

        Parameters
        ----------
        polygon : the outline, (N, 2) metres in the map's frame
        floor, ceiling : heights in the map's frame, metres
        storey : by default the one on whose floor it is, if there is one

        Raises
        ------
        ValueError
            The name is taken, the outline is none, or the ceiling is not above the floor.
        """
        from semmap.api.additions import room

        return self._add(room(name, polygon, floor, ceiling, type, label), storey=storey)

    def add_region(
        self,
        name: str,
        polygon: shapely.Polygon | Sequence[Sequence[float]],
        *,
        floor: float = 0.0,
        ceiling: float | None = None,
        type: str | None = None,
        label: str | None = None,
        storey: str | None = None,
    ) -> MapEntity:
        """Add a region (a zone): an outline with a meaning; as `add_room`."""
        from semmap.api.additions import region

        return self._add(region(name, polygon, floor, ceiling, type, label), storey=storey)

    def add_object(
        self,
        name: str,
        *,
        type: str | None = None,
        mesh: str | Path | trimesh.Trimesh | Mesh | None = None,
        size: Sequence[float] | None = None,
        pose: PlanarPose | None = None,
        on: str | None = None,
        in_: str | None = None,
        label: str | None = None,
        properties: Mapping[str, Any] | None = None,
    ) -> MapEntity:
        """Add an object.

        Parameters
        ----------
        mesh : the geometry in the object's own frame, metres: a file, a trimesh or a `Mesh`
        size : instead of a mesh, a box of (x, y, z) metres that stands on its frame's origin
        pose : (x, y, z, yaw) in the map's frame; by default the middle of `on` or `in_`
        on, in_ : names of what holds it; without them, the geometry says it

        Raises
        ------
        ValueError
            The name is taken, a part contradicts another, or the pose is not on or in the holder.
        LookupError
            There is no such holder.
        """
        from semmap.api.additions import thing

        return self._add(
            thing(name, "object", type, mesh, size, pose, label, properties), on=on, in_=in_
        )

    def add_agent(
        self,
        name: str,
        *,
        type: str | None = None,
        size: Sequence[float] | None = None,
        mesh: str | Path | trimesh.Trimesh | Mesh | None = None,
        pose: PlanarPose | None = None,
        in_: str | None = None,
    ) -> MapEntity:
        """Add a robot or a person; as `add_object`."""
        from semmap.api.additions import thing

        return self._add(thing(name, "agent", type, mesh, size, pose, None, None), in_=in_)

    def add_door(
        self,
        name: str,
        place_a: str,
        place_b: str | None,
        line: Sequence[Sequence[float]],
        *,
        width: float | None = None,
        state: Literal["open", "closed", "locked"] = "open",
        form: Literal["door", "elevator_door", "stairs", "ramp"] = "door",
        direction: Literal["both", "forward", "backward"] = "both",
        height: float = 0.0,
        clearance: float = 0.6,
    ) -> MapEntity:
        """Add a connector of two places.

        Parameters
        ----------
        place_a, place_b : names of rooms; `place_b` None: it leads outside
        line : ((x, y), (x, y)): the opening from post to post, metres in the map's frame
        width : of the clear opening; by default the line's length
        height : of the floor in the map's frame, metres
        clearance : how far from the line a robot stands before and behind it, metres

        Raises
        ------
        LookupError
            There is no such room.
        ValueError
            The name is taken, or neither side of the line is in `place_a`.
        """
        from semmap.api.additions import DoorShape, door

        rooms = [self[place] for place in (place_a, place_b) if place is not None]
        distances = [partial(self._distance, room) for room in rooms]
        shape = DoorShape(line, width, height, clearance)
        return self._add(door(name, place_a, place_b, shape, distances, form, direction, state))

    def spot(self, holder: MapEntity, relation: str) -> tuple[float, float, float]:
        """A point on or in a holder: the middle of its highest surface, or of its floor."""
        from semmap.api.additions import spot

        return spot(self, holder, relation)

    def _distance(self, room: MapEntity, x: float, y: float) -> float:
        row = self.execute(
            "SELECT ST_Distance(footprint, ST_MakePoint(%s, %s)) FROM world WHERE entity_id = %s",
            x,
            y,
            room.id,
        )
        if not row or row[0][0] is None:
            raise ValueError(f"{room.name} has no outline")
        return float(row[0][0])

    def _add(
        self,
        entry: Any,
        *,
        on: str | None = None,
        in_: str | None = None,
        storey: str | None = None,
    ) -> MapEntity:
        from semmap.api.additions import add_entry

        return add_entry(self, entry, on=on, in_=in_, storey=storey)

    # --- for SQL and the ORM

    def execute(self, statement: str, *values: Any) -> list[tuple[Any, ...]]:
        """The rows of a SQL statement (psycopg's ``%s`` for values); it sees this map.

        A statement that PostgreSQL ends to resolve a deadlock is repeated, outside of transactions.

        Raises
        ------
        ValueError
            The statement breaks a rule of the map; it changed nothing.
        """
        session = self._session()
        attempts = ATTEMPTS if session.info.transaction_status == TransactionStatus.IDLE else 1
        while True:
            attempts -= 1
            try:
                cursor = session.execute(statement, values or None)
                return cursor.fetchall() if cursor.description else []
            except (errors.DeadlockDetected, errors.SerializationFailure):
                if not attempts:
                    raise
            except errors.CheckViolation as error:
                parts = (error.diag.message_primary, error.diag.message_hint)
                raise ValueError(". ".join(filter(None, parts))) from error

    def check_type(self, type: str) -> None:
        """Refuse a semantic type that the map does not have.

        Raises
        ------
        LookupError
            With the types that come near it.
        """
        if not self.execute("SELECT 1 FROM semantic_type WHERE name = %s", type):
            names = [row[0] for row in self.execute("SELECT name FROM semantic_type")]
            raise LookupError(f"the map has no type {type}{entity_query.similar(type, names)}")

    def transaction(self) -> AbstractContextManager[Any]:
        """A transaction: all statements in the ``with`` block, or none."""
        return self._session().transaction()

    def session(self) -> Session:
        """A SQLAlchemy session that sees this map; use it in a ``with`` block."""
        from semmap.model.session import map_session

        return map_session(self.database.engine, self.name)

    def _session(self) -> psycopg.Connection[Any]:
        self.database.show(self.name)
        return self.database.session
