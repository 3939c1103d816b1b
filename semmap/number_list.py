"""Numbers with commas between them, as options take points and boxes."""

from __future__ import annotations

import math


def parse_numbers(text: str, count: int, option: str) -> tuple[float, ...]:
    """Return the finite numbers of a text with commas between them; `option` is for the error.

    >>> parse_numbers("1,2.5,0", 3, "--near X,Y,Z")
    (1.0, 2.5, 0.0)
    """
    try:
        found = tuple(float(value) for value in text.split(","))
    except ValueError:
        found = ()
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"{option} takes {count} numbers with commas between them, not {text!r}")
    return found
