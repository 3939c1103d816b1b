"""The mass of an entity, as its properties state it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from semmap.finite_number import is_finite_number


def stated_mass(properties: Mapping[str, Any]) -> float | None:
    """The kilograms of the property `weight`, else of `mass`; None where neither is there.

    ValueError where it is no number above 0; its text says which property, and what to give.

    >>> stated_mass({"mass": 2}), stated_mass({"weight": 0.5, "mass": 2}), stated_mass({})
    (2.0, 0.5, None)
    """
    name = "weight" if properties.get("weight") is not None else "mass"
    value = properties.get(name)
    if value is None:
        return None
    if not (is_finite_number(value) and value > 0):
        raise ValueError(f"its property {name} is {value!r}: give kilograms, a number above 0")
    return float(value)
