"""Rows of derived tables that contradict the rest on purpose: no trigger sees them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def forge(execute: Callable[..., Any], statement: str, *values: Any) -> Any:
    """Execute a statement as a superuser does who switches all triggers off."""
    execute("SET session_replication_role = replica")
    try:
        return execute(statement, *values)
    finally:
        execute("SET session_replication_role = origin")
