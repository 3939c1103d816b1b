"""What names a map to the planners that follow it: a database and a name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from semmap.query.change_feed import ChangeFeed

if TYPE_CHECKING:
    from sqlalchemy import Engine


class MapSource(Protocol):
    """A map, as `semmap.Map` is one, or a `MapHandle`."""

    @property
    def engine(self) -> Engine:
        """The database."""
        ...

    @property
    def name(self) -> str | None:
        """The name of the map; None: the chosen or only one."""
        ...


@dataclass(frozen=True)
class MapHandle:
    """A map of a database that no `semmap.Map` is open for."""

    engine: Engine
    name: str | None = None


def open_feed(source: MapSource) -> ChangeFeed:
    """Return the change feed of a map, without a write to the server's disk at each look."""
    return ChangeFeed(source.engine, source.name, durable=False)
