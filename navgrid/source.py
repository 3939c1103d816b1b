"""The storeys of the current map, read from the database: the one module here that does so."""

from __future__ import annotations

import difflib

from sqlalchemy import Connection

from semmap.draw.view import StoreyView
from semmap.query.storeys import read_storeys

__all__ = ["read_wanted_storeys"]


def read_wanted_storeys(connection: Connection, name: str | None = None) -> list[StoreyView]:
    """The storeys of the current map, the lowest first; only that of a name where it is given.

    Raises
    ------
    LookupError
        There is no storey of that name; the message names those that there are.
    """
    storeys = read_storeys(connection)
    if name is None:
        return storeys
    wanted = [s for s in storeys if s.name == name]
    if not wanted:
        names = [s.name for s in storeys]
        near = difflib.get_close_matches(name, names, n=1)
        mend = f"did you mean {near[0]}?" if near else f"there are: {', '.join(names)}"
        raise LookupError(f"there is no storey named {name}; {mend}")
    return wanted
