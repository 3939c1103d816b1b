"""The end of an error about an unknown name: the names that are like it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["similar_names", "suggestion"]


def similar_names(name: str, known: Iterable[str], count: int = 3) -> list[str]:
    """Up to `count` known names that are spelt like `name` or contain it, the most similar first.

    Examples
    --------
    >>> similar_names("ofice4", ["office4", "office5", "lab1"], 1)
    ['office4']
    """
    names = sorted(set(known))
    close = difflib.get_close_matches(name, names, n=count, cutoff=0.5)
    containing = [k for k in names if name and name.lower() in k.lower() and k not in close]
    return [*close, *containing[: count - len(close)]]


def suggestion(name: str, known: Iterable[str], otherwise: str) -> str:
    """``did you mean A or B?``, or `otherwise` if no known name is similar."""
    similar = similar_names(name, known)
    return f"did you mean {' or '.join(similar)}?" if similar else otherwise
