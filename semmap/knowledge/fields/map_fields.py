"""The fields of the map that a session sees: those of the service, else of what was kept."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import TYPE_CHECKING

from sqlalchemy import URL
from sqlalchemy.exc import DBAPIError

from semmap.database.engine import make_engine
from semmap.fields.maps.map_buffer import MapBuffer
from semmap.fields.queries import query as query_fields
from semmap.fields.queries.mirror_catalogue import mirror_catalogue
from semmap.fields.queries.query_result import SelectResult
from semmap.fields.service.client import find_service, url_of
from semmap.fields.service.kept_answer import show_kept
from semmap.fields.store.names import read_map_vocabulary, read_names
from semmap.fields.store.voxel_mirror import VoxelMirror
from semmap.knowledge.fields.properties import FieldAnswer, FieldError, FieldQuery
from semmap.knowledge.sparql.kept_queries import Session
from semmap.language.error import QueryError
from semmap.query.snapshot import open_snapshot

if TYPE_CHECKING:
    from semmap.knowledge.map_view import MapView

VOXEL_SIZE = 0.05  # metres; the same as by default of `semmap fields`


_UNSEEN = """
SELECT EXISTS (SELECT FROM change WHERE map_id = (SELECT current_map())
               AND xid = pg_current_xact_id_if_assigned()::text::bigint
               AND what NOT IN ('belief', 'statement', 'inferred', 'field'))
"""

_MESSAGE = re.compile(r"(?:line \d+, column \d+: )?([^\n]*)")


def ask_fields(view: MapView, query: FieldQuery) -> FieldAnswer:
    """Return the answer of the service of the map if it is running, else of the kept state.

    FieldError: no source provides a property, an entity is unknown, or the session's transaction
    has changed the map, of which fields see what is committed.
    """
    if view.value(_UNSEEN):
        raise FieldError(
            "this transaction has changed the map, which fields do not see before it is "
            "committed: commit first",
            query.place,
        )
    try:
        with find_service(url_of(view.session), view.name, VOXEL_SIZE) as service:
            if service is not None:
                reply = service.ask("query", text=query.text, limit=None)
                rows = [tuple(row) for row in reply["rows"]]
                by = f"the service of {view.name}"
                return FieldAnswer(rows, VOXEL_SIZE, by, tuple(reply["left_out"]))
        return _from_kept_state(view, query.text)
    except QueryError as error:
        raise FieldError(error.reason, query.place) from error
    except (ValueError, LookupError) as error:  # the service sends errors as texts
        found = _MESSAGE.match(str(error))
        raise FieldError(found[1] if found else str(error), query.place) from error


def _from_kept_state(view: MapView, text: str) -> FieldAnswer:
    vocabulary = read_map_vocabulary()
    with _mirror_of(_url(view.session), view.name) as mirror:
        with open_snapshot(view.session, view.name) as now:
            newest, names = show_kept(mirror, now, vocabulary), read_names(now)
        catalogue = mirror_catalogue(mirror, names, vocabulary)
        result = query_fields(catalogue, text)
        assert isinstance(result, SelectResult)
        seen = f", sources as kept at {newest:%Y-%m-%d %H:%M:%S %Z}" if newest else ""
        left_out = tuple(sorted(catalogue.left_out()))
    return FieldAnswer(list(result), VOXEL_SIZE, f"the kept state of the map{seen}", left_out)


def _url(session: Session) -> URL:
    info = session.info
    given = info.get_parameters()
    for name in ("user", "dbname", "password", "options"):
        given.pop(name, None)
    given |= {"host": info.host, "port": str(info.port)}
    return URL.create(
        "postgresql+psycopg",
        info.user,
        info.password or None,
        database=info.dbname,
        query=given,
    )


class _Kept:
    """A mirror between queries; one query at a time reads it."""

    def __init__(self, url: URL, map_name: str) -> None:
        self.lock = threading.Lock()
        self._engine = make_engine(url)
        self._mirror: VoxelMirror | None = None
        self._map_name = map_name

    def caught_up(self) -> VoxelMirror:
        """Return the mirror of the present state of the map, without what sources saw."""
        try:
            if self._mirror is None:
                self._mirror = VoxelMirror.resume(self._engine, self._map_name, VOXEL_SIZE)
            mirror = self._mirror
            if mirror.catch_up():
                with suppress(DBAPIError):  # a user who may only read computes them each time
                    mirror.save()
        except BaseException:
            self._mirror = None
            raise
        finally:
            self._engine.dispose()
        mirror.maps = MapBuffer()
        mirror.forget_sources()
        return mirror


_kept = lru_cache(maxsize=4)(_Kept)


@contextmanager
def _mirror_of(url: URL, map_name: str) -> Iterator[VoxelMirror]:
    kept = _kept(url, map_name)
    with kept.lock:
        yield kept.caught_up()
