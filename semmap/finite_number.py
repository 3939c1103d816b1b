"""Which values of a file are numbers that a float can hold."""

from __future__ import annotations

import sys
from typing import TypeGuard

__all__ = ["is_finite_number"]


def is_finite_number(value: object) -> TypeGuard[float]:
    """Whether a value of YAML or JSON is a finite number; truth values are none.

    Their integers have no largest one: `float` raises an error for one of 400 digits.

    Examples
    --------
    >>> [is_finite_number(value) for value in (0.5, 7, True, "7", float("nan"), 10**400)]
    [True, True, False, False, False, False]
    """
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )
