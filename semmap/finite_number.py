"""Which values of a file or a user are numbers that a float can hold."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from typing import Any, TypeGuard


def is_finite_number(value: object) -> TypeGuard[float]:
    """Whether a value of YAML or JSON is a finite number; truth values are none.

    Their integers have no largest one: `float` raises an error for one of 400 digits.

    >>> [is_finite_number(value) for value in (0.5, 7, True, "7", float("nan"), 10**400)]
    [True, True, False, False, False, False]
    """
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def finite_numbers(given: Iterable[Any], count: int | None = None) -> tuple[float, ...] | None:
    """Return finite numbers as floats, also those of NumPy; None where one is not, or for texts.

    Examples
    --------
    >>> finite_numbers((1, 2.5), 2), finite_numbers((1, 2.5), 3), finite_numbers("12")
    ((1.0, 2.5), None, None)
    """
    try:
        found = tuple(math.nan if isinstance(value, str) else float(value) for value in given)
    except (TypeError, ValueError, OverflowError):
        return None
    return found if all(map(math.isfinite, found)) and count in (None, len(found)) else None
