"""ORM sessions that see one map."""

from __future__ import annotations

from sqlalchemy import Connection, Engine, event
from sqlalchemy.orm import Session

from semmap.database import maps


def map_session(engine: Engine, map_name: str) -> Session:
    """A session in each of whose transactions the schema's views show the map of a name.

    Examples
    --------
    >>> from semmap.model import Object
    >>> with map_session(engine, "office") as session:  # doctest: +SKIP
    ...     session.scalars(select(Object).where(Object.is_a("furniture")))
    """
    session = Session(engine)

    @event.listens_for(session, "after_begin")
    def see_map(_session: Session, _transaction: object, connection: Connection) -> None:
        maps.see_map(connection, map_name)

    return session
