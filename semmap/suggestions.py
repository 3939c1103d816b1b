"""Similar names, for errors about a name that is unknown."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["similar_names", "suggestion"]


def similar_names(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Return the known names that are spelt like a name, the most similar first.

    Parameters
    ----------
    name : the unknown name
    known : the names to choose from
    count : the most names to return

    Examples
    --------
    >>> similar_names("desk", ["disk", "desk1", "table1"])
    ['desk1', 'disk']
    """
    return get_close_matches(name, list(known), n=count)


def suggestion(name: str, known: Iterable[str], count: int = 3) -> str:
    """Return the end of an error about an unknown name; empty without similar names.

    Parameters
    ----------
    name, known, count : as in `similar_names`

    Examples
    --------
    >>> "there is no entity desk" + suggestion("desk", ["disk", "desk1", "table1"])
    'there is no entity desk; similar names: desk1, disk'
    """
    names = similar_names(name, known, count)
    return f"; similar names: {', '.join(names)}" if names else ""
