"""A database with maps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import psycopg
from psycopg import sql

from semmap.api.checked import Positive, checked, checked_class
from semmap.api.database_interlinking import DatabaseInterlinking
from semmap.api.database_manipulation import DatabaseManipulation
from semmap.api.map import Map
from semmap.api.map_questions import MapQuestions, sql_rows
from semmap.database.configuration import READER
from semmap.database.maps import pick_map
from semmap.database.session import is_idle, open_session
from semmap.database.shared_engine import shared_engine
from semmap.database.sure_connection import SureConnection
from semmap.query import entity_query

if TYPE_CHECKING:
    from sqlalchemy import Engine

    from planner.robot_class import RobotClass
    from semmap.api.driving_posture import DrivingPosture
    from semmap.database.embedded import Cluster
    from semmap.ingest.importer import ImportSummary
    from semmap.ingest.store.model_store import Progress
    from semmap.query.sql_statement import SqlRows


CONNECTED = 10
"""Maps of a database that keep their connections at a time; PostgreSQL has 100 by default."""


@checked
def connect(url: str | Cluster | None = None, *, migrate: bool | None = None) -> Database:
    """Open the database of the maps; close it with `Database.close` or a ``with`` statement.

    Parameters
    ----------
    url : ``postgresql://user:password@host:5432/database``; by default ``$SEMMAP_DB``, else the
        user's embedded database
    migrate : make the schema, or bring it to the newest revision; by default only where the
        embedded database is made

    Raises
    ------
    DatabaseError
        The database cannot be reached, or it has no schema or an old one and `migrate` is not True.

    Examples
    --------
    >>> import semmap
    >>> with semmap.connect() as db:
    ...     flat = db.create_map("flat")
    ...     flat.add_room("kitchen", [(0, 0), (4, 0), (4, 3), (0, 3)], floor=0, ceiling=2.6)
    ...     flat.add_object("table1", type="table", size=(1.6, 0.8, 0.75), in_="kitchen")
    ...     mug = flat.add_object("mug1", type="mug", size=(0.08, 0.08, 0.1), on="table1")
    ...     mug.move_to(0.5, 0.5, 0)
    ...     print(mug.holder, flat["table1"].contents)
    ...     db.drop_map("flat")
    <room kitchen>
    <object table1>
    <room kitchen> []
    3
    """
    return Database(url, migrate=_is_new_cluster(url) if migrate is None else migrate)


def _is_new_cluster(url: str | Cluster | None) -> bool:
    """Whether the embedded database is meant, and is not made yet."""
    import os

    from semmap.database.embedded import Cluster

    if url is None and os.environ.get("SEMMAP_DB"):
        return False
    cluster = Cluster() if url is None else url
    return isinstance(cluster, Cluster) and not cluster.exists


@checked_class
class Database(DatabaseManipulation, DatabaseInterlinking):
    """The maps of a database; for one thread at a time. `connect` opens it.

    `session` is a psycopg connection in autocommit mode, its search path on the schema. One that
    the server left is opened again.
    """

    def __init__(self, url: str | Cluster | None = None, *, migrate: bool = False) -> None:
        self._session = open_session(url, migrate=migrate)
        self._url = url
        self._maps: dict[str, Map] = {}
        self._reading: psycopg.Connection[Any] | None = None
        self._is_closed = False

    def __enter__(self) -> Self:
        """Return this; the end of the ``with`` block closes it."""
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the sessions, and the pool of `engine`."""
        for opened in self._maps.values():
            opened.close()
        self._is_closed = True
        for session in (self._reading, self._session):
            if session is not None:
                session.close()
        for name in ("reading_engine", "engine"):
            if name in vars(self):
                getattr(self, name).dispose()

    @property
    def session(self) -> SureConnection:
        """A psycopg connection with autocommit, its search path on the schema."""
        if self._session.closed and not self._is_closed:
            self._session = self._session.reopen(self._session.conninfo)
        return self._session

    def is_usable(self) -> bool:
        """Whether its sessions are between transactions, and the server has not left them."""
        own = (self._session, self._reading or self._session)
        of_maps = (session for each in self._maps.values() for session in each._sessions)
        return all(map(is_idle, (*own, *of_maps)))

    def _release_idle(self, but: MapQuestions) -> None:
        """Close idle connections of maps `but` of one, as far as more than `CONNECTED` have some.

        Those of the maps asked for first are closed. A map connects again when it is used.
        """
        others = [each for each in self._maps.values() if each is not but and each._sessions]
        for each in others[: max(len(others) - CONNECTED + 1, 0)]:
            if all(map(is_idle, each._sessions)):
                each.close()

    @cached_property
    def engine(self) -> Engine:
        """A SQLAlchemy engine on the same database, for the ORM and other packages."""
        from semmap.database.engine import open_engine

        return open_engine(self._url, check=True)

    @cached_property
    def reading_engine(self) -> Engine:
        """As `engine`; on the embedded database, its login can only read."""
        from semmap.database.reading_login import as_reader

        return as_reader(self.engine) or self.engine

    @property
    def address(self) -> str | None:
        """Which database it is, as `connect` takes it: a URL; None for the default one."""
        if self._url is None or isinstance(self._url, str):
            return self._url
        from semmap.fields.service.client import url_of

        return url_of(self.session)

    @property
    def maps(self) -> list[str]:
        """The names of the maps, the oldest first, without copies for simulated runs."""
        rows = self.session.execute(
            "SELECT name FROM map WHERE copy_of IS NULL ORDER BY id"
        ).fetchall()
        return [row[0] for row in rows]

    def map(self, name: str | None = None) -> Map:
        """The map of a name; without one, that of the setting ``semmap.map``, else the only one.

        Raises
        ------
        LookupError
            There is no such map, none at all, or several and none was named.
        """
        return self._map(pick_map(self.session, name))

    def _map(self, name: str) -> Map:
        known = self._maps.pop(name, None)
        self._maps[name] = Map(self, name) if known is None else known  # the latest is the last
        return self._maps[name]

    def create_map(self, name: str) -> Map:
        """Make an empty map; ValueError if there is one of this name, or the name is empty."""
        from semmap.ingest.ontology.type_store import load_tbox

        if not name:
            raise ValueError("a map needs a name")
        try:
            with self.session.transaction(), shared_engine(self.session).connect() as connection:
                self.session.execute("INSERT INTO map (name) VALUES (%s)", (name,))
                load_tbox(connection)
        except psycopg.errors.UniqueViolation:
            raise ValueError(f"there is a map {name} already") from None
        return self._map(name)

    def drop_map(self, name: str) -> int:
        """Delete a map with all its entities; returns how many there were."""
        self._maps.pop(self.map(name).name).close()
        with self.session.transaction():
            row = self.session.execute("SELECT drop_map(%s)", (name,)).fetchone()
        assert row is not None
        return int(row[0])

    def list_maps(self) -> list[dict[str, Any]]:
        """Each map with its numbers of entities and rooms, as ``semmap maps`` prints them."""
        return entity_query.list_maps(self.session)

    def sql(self, statement: str, *values: Any, write: bool = False) -> SqlRows:
        """As `Map.sql` of the map that `map` takes, where there is one.

        `statement`: a statement of PostgreSQL. `write`: let the statement change the map.
        Without maps, ``current_map()`` is NULL; with several and no choice, it is a ValueError.
        """
        row = self.session.execute(
            "SELECT count(*) = 1 OR coalesce(current_setting('semmap.map', true), '') <> '' "
            "AND count(*) > 0 FROM map WHERE copy_of IS NULL"
        ).fetchone()
        if row is not None and row[0]:
            return self.map().sql(statement, *values, write=write)
        return sql_rows(self.session if write else self._reader, statement, values, write=write)

    @property
    def _reader(self) -> psycopg.Connection[Any]:
        from semmap.database.reading_login import reading_session

        if self._reading is None or self._reading.closed:
            self._reading = reading_session(self.session)
        return self._reading or self.session

    def use(self, name: str) -> None:
        """Choose the map that later sessions of this user see where they name none."""
        chosen = self.map(name).name
        roles = self.session.execute(
            "SELECT rolname, current_database() FROM pg_roles WHERE rolname = current_user "
            "OR rolname = %s AND (SELECT rolsuper FROM pg_roles WHERE rolname = current_user)",
            (READER,),
        ).fetchall()
        for role, database in roles:
            self.session.execute(
                sql.SQL("ALTER ROLE {} IN DATABASE {} SET semmap.map = {}").format(
                    sql.Identifier(role), sql.Identifier(database), sql.Literal(chosen)
                )
            )

    def import_file(
        self,
        path: str | Path,
        *,
        map: str | None = None,
        geometry: Literal["visual", "collision"] = "visual",
        mesh_as: Literal["object", "room", "scene"] | None = None,
        strict: bool = False,
        source: str | None = None,
        model_path: Sequence[str | Path] = (),
        scale: Positive = 1.0,
        define: bool = False,
        find_rooms: bool = False,
        progress: Progress = lambda stage, done, total: None,
    ) -> ImportSummary:
        """Read a world file into a map, in one transaction; a repeated import updates it.

        Parameters
        ----------
        path : SDF, Open-RMF ``building.yaml``, IFC, IndoorGML, IMDF (zip or folder), GeoJSON, also
            with OpenStreetMap's indoor tags, GeoPackage, a mesh, a point cloud, or the ``map.yaml``
            of a SLAM program, which has walls for `find_rooms`
        map : made where it is not there; by default the file's own name
        geometry : of SDF models
        mesh_as : a mesh file is one object, a room, or a scene of an object for each named node; by
            default a scene where it has several and is more than 4 m across, else an object
        strict : take nothing if anything is left out or a door leads from no room to another
        source : the name under which a repeated import finds its entities; by default the file's
        model_path : folders of SDF models, also of Open-RMF buildings, searched first
        scale : metres per unit of a mesh file
        define : add types of drawn features that the map does not have; otherwise such a feature
            is left out
        find_rooms : afterwards, find rooms and doorways in the walls of a map without rooms, and
            add them
        progress : called with a stage, how much of it is done, and how much there is

        Raises
        ------
        WorldError
            The file cannot be used as a whole; nothing is changed.
        """
        from navgrid.explored_map import is_map_file, read_explored_map
        from semmap.ingest.importer import import_file

        path = Path(path)
        if absent := [folder for folder in model_path if not Path(folder).is_dir()]:
            raise ValueError(f"model_path: {absent[0]} is not a folder")
        summary = import_file(
            self.engine,
            path,
            map_name=map,
            geometry=geometry,
            mesh_as=mesh_as,
            strict=strict,
            source=source,
            model_path=[Path(folder) for folder in model_path],
            scale=scale,
            define=define,
            progress=progress,
            world=read_explored_map(path) if is_map_file(path) else None,
        )
        made = self.map(summary.map)
        if find_rooms and not made.rooms:
            try:
                for each in made.find_rooms(add=True):
                    left = f"; left out: {each.problem}" if each.problem else ""
                    what = f"{len(each.rooms)} rooms, {len(each.doorways)} doorways"
                    summary.notes += [f"{each.storey}: found {what}{left}", *each.notes]
            except ValueError as error:  # the world is in the map all the same
                summary.notes.append(
                    f"found no rooms: {error}. Give walls that type, or draw rooms in a GeoJSON "
                    "file and import it into this map"
                )
        return summary

    def add_robot(
        self,
        name: str,
        urdf: Path | str,
        *,
        posture: str | Mapping[str, float] | None = None,
        parts: Path | str | None = None,
        max_step: float = 0.02,
        max_slope: float = 6.0,
        speed: float = 0.5,
        reach: tuple[float, float] = (0.2, 0.8),
        heights: tuple[float, float] = (0.0, 1.6),
        capacity: int = 1,
        behaviours: Iterable[str] | None = None,
        permissions: Iterable[str] = (),
        opens: bool = True,
        unlocks: bool = False,
        outside: bool = False,
    ) -> RobotClass:
        """Store a class of robots from a URDF, or replace the one of this name.

        Parameters
        ----------
        name : of the class
        urdf : the robot's URDF
        posture, parts : as for `Map.costmaps`
        max_step : the highest step that it drives over, metres
        max_slope : the steepest slope that it climbs, degrees
        speed : metres a second on clear ground
        reach : lowest and highest distance of objects that it takes, metres
        heights : lowest and highest height of objects that it takes, metres
        capacity : how many objects it carries at once
        behaviours : those that it has; by default all
        permissions : those that it has
        opens : it opens closed doors
        unlocks : it unlocks locked doors
        outside : it may leave the building

        Raises
        ------
        ValueError
            The URDF cannot be used, or a number is out of range.
        """
        import math

        from navgrid.terrain import DriveLimits
        from planner.readers.robot_class import store_robot_class
        from planner.robot_class import RobotClass
        from semmap.robot import load_robot, robot_parts

        path, grouped = Path(urdf), None if parts is None else Path(parts)
        chosen = self.driving_posture(path, posture, grouped)
        shape = robot_parts(load_robot(path), chosen.joints, grouped)
        limits = DriveLimits(max_step, math.radians(max_slope))
        added = RobotClass(
            name,
            tuple(shape),
            limits,
            speed,
            None if behaviours is None else frozenset(behaviours),
            frozenset(permissions),
            opens,
            unlocks,
            outside,
            reach,
            heights,
            capacity,
        )
        with self.session.transaction(), shared_engine(self.session).connect() as connection:
            store_robot_class(connection, added, urdf=path)
        return added

    def driving_posture(
        self,
        urdf: Path | str,
        posture: str | Mapping[str, float] | None = None,
        parts: Path | str | None = None,
    ) -> DrivingPosture:
        """The posture in which a robot drives, and its origin; arguments as of `add_robot`."""
        from semmap.api.driving_posture import driving_posture

        grouped = None if parts is None else Path(parts)
        return driving_posture(self.session, Path(urdf), posture, grouped)

    def changes(self, since: str | None = None) -> tuple[str, list[dict[str, Any]]]:
        """The cursor for the next call, and the changes of all maps after a cursor.

        `since`: a cursor of an earlier call. Without one, all that are kept: `id`, `at`, `map`,
        `what` (moved, removed, ...) and `entities`, their ids. ValueError refuses a text that is no
        cursor.
        """
        from semmap.query.entity_query import changes_since

        return changes_since(self.session, since)

    def delete_robot(self, name: str) -> None:
        """Delete a class of robots, and its travel times."""
        from planner.readers.robot_class import delete_robot_class

        with self.session.transaction(), shared_engine(self.session).connect() as connection:
            delete_robot_class(connection, name)
