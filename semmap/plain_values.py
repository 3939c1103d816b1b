"""Values as JSON has them."""

from __future__ import annotations

import math
import sys
from dataclasses import fields, is_dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from psycopg.types.range import Range


def plain(value: Any) -> Any:
    """A value as JSON has it; numbers that it has no form for, and all else, as PostgreSQL says.

    What has a method `as_json` is what that returns; a data class is its fields.
    """
    if hasattr(value, "as_json"):
        value = value.as_json()
    elif is_dataclass(value):
        value = {each.name: getattr(value, each.name) for each in fields(value)}
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(v) for v in value]
    if isinstance(value, Decimal) and value.is_finite():
        return int(value) if value == value.to_integral_value() else float(value)
    if isinstance(value, float | Decimal) and not math.isfinite(value):
        return "NaN" if value != value else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, bytes | memoryview):
        return "\\x" + bytes(value).hex()
    if _is_range(value):
        return _range(value)
    return value if isinstance(value, str | int | float | None) else str(value)


def _is_range(value: Any) -> bool:
    """Whether a value is a range; psycopg is not loaded for a command that had no use for it."""
    loaded = sys.modules.get("psycopg.types.range")
    return loaded is not None and isinstance(value, loaded.Range)


def _range(value: Range[Any]) -> str:
    if value.isempty:
        return "empty"
    low, high = ("" if end is None else str(end) for end in (value.lower, value.upper))
    return f"{'[' if value.lower_inc else '('}{low},{high}{']' if value.upper_inc else ')'}"
