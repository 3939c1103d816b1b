"""What changes in a map: the changes after a cursor, and a subscription to those that come."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from semmap.api.map import Map
    from semmap.api.map_subscription import MapSubscription
    from semmap.query.map_events import MapEvent


class MapEvents:
    """The part of `Map` that tells changes."""

    def changes(
        self, since: str | None = None, *, follow: bool = False, stop: threading.Event | None = None
    ) -> Iterator[MapEvent]:
        """What changed in the map: one event for each change of an entity by a transaction.

        Parameters
        ----------
        since : the `cursor` of an event that was seen; by default from now on where `follow`, else
            all changes that are kept
        follow : wait for more, until `stop` is set

        Raises
        ------
        ValueError
            `since` is not a cursor.
        """
        from semmap.api.map_subscription import current_cursor

        map = cast("Map", self)
        if follow:
            map.connection.execute("LISTEN semmap")
            since = current_cursor(map.connection) if since is None else since
        return _follow(map, since, follow, stop)

    def subscribe(
        self, callback: Callable[[MapEvent], object], *, since: str | None = None
    ) -> MapSubscription:
        """Call a function with each change of the map, in a thread with a connection of its own.

        No change is skipped and none is repeated, also where the server restarts. An exception of
        the function ends the subscription; `MapSubscription.stop` raises it. The subscription is a
        context manager, too.

        Parameters
        ----------
        callback : called in the thread with one event after the other. It must not use this map,
            which is for one thread at a time: let it open its own by `semmap.connect`
        since : the `cursor` of an event that was seen; by default from now on
        """
        from semmap.api.map_subscription import MapSubscription
        from semmap.database.session import conninfo_of

        map = cast("Map", self)
        return MapSubscription(conninfo_of(map.database.session), map.name, callback, since)


def _follow(
    map: Map, since: str | None, follow: bool, stop: threading.Event | None
) -> Iterator[MapEvent]:
    from semmap.api.map_subscription import LOOK
    from semmap.query.map_events import events_since

    while True:
        since, events = events_since(map.connection, map.name, since)
        yield from events
        if not follow or (stop is not None and stop.is_set()):
            return
        for _ in map.connection.notifies(timeout=LOOK, stop_after=1):
            break
