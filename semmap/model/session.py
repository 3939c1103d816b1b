"""ORM sessions that see one map."""

from __future__ import annotations

from sqlalchemy import Engine, event, text
from sqlalchemy.orm import Session

__all__ = ["map_session"]


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
    def see_map(_session: Session, _transaction: object, connection: object) -> None:
        connection.execute(  # type: ignore[attr-defined]
            text("SELECT set_config('semmap.map', :name, true)"), {"name": map_name}
        )

    return session
