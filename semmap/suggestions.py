"""Similar names, for errors about a name that is unknown."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def misspelt(name: str, known: Iterable[str]) -> str | None:
    """The known name that a name probably stands for, with a letter or two that are wrong.

    >>> misspelt("tabel", ["table", "stable"]), misspelt("bottle_opener", ["bottle"])
    ('table', None)
    """
    return next(iter(difflib.get_close_matches(name, sorted(set(known)), n=1, cutoff=0.8)), None)


def similar_names(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Return known names that are spelt like a name, the most similar first, or that contain it.

    >>> similar_names("shelf", ["shelve", "bookshelf2", "table1"])
    ['shelve', 'bookshelf2']
    """
    names = sorted(set(known))
    close = difflib.get_close_matches(name, names, n=count, cutoff=0.5)
    containing = [k for k in names if name and name.lower() in k.lower() and k not in close]
    return [*close, *containing[: count - len(close)]]


def suggestion(name: str, known: Iterable[str], otherwise: str = "") -> str:
    """Return the end of an error about an unknown name; `otherwise` where no known one is similar.

    >>> "there is no room kichen" + suggestion("kichen", ["kitchen", "hall"])
    'there is no room kichen; did you mean kitchen?'
    """
    names = similar_names(name, known)
    if names:
        return f"; did you mean {' or '.join(names)}?"
    return f"; {otherwise}" if otherwise else ""
