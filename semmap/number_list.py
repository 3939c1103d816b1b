"""Numbers with commas between them, as options take points and boxes."""

from __future__ import annotations

import math


def parse_numbers(text: str, count: int, option: str) -> tuple[float, ...]:
    """Return the finite numbers of a text with commas between them.

    Parameters
    ----------
    text : such as "1,2.5,0"
    count : how many numbers it has to have
    option : the option that takes it, for the error

    Raises
    ------
    ValueError
        The text has another number of values, or one that is not a finite number.

    Examples
    --------
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
