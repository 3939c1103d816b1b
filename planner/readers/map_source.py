"""What names a map: an engine and a name, or an object that has both."""

from __future__ import annotations

from typing import Protocol, TypeAlias, runtime_checkable

from sqlalchemy import Engine

from semmap.query.change_feed import ChangeFeed

__all__ = ["MapHandle", "MapSource", "open_feed"]


@runtime_checkable
class MapHandle(Protocol):
    """A map of an open database."""

    @property
    def engine(self) -> Engine:
        """The database."""
        ...

    @property
    def name(self) -> str:
        """The name of the map."""
        ...


MapSource: TypeAlias = Engine | MapHandle
"""An engine, which sees all maps of its database, or a map."""


def open_feed(source: MapSource, map_name: str | None = None) -> ChangeFeed:
    """The change feed of a map.

    Parameters
    ----------
    map_name
        By default the map of a handle, or the chosen or only map of an engine.
    """
    if isinstance(source, Engine):
        return ChangeFeed(source, map_name, durable=False)
    return ChangeFeed(source.engine, map_name or source.name, durable=False)
