"""Texts of options as values: numbers with commas between them, and JSON."""

from __future__ import annotations

import json
from typing import Any

import typer


def numbers(text: str, option: str, count: int | None = None) -> list[float]:
    """Return the numbers of a text; `count` of them, where it is given, else BadParameter."""
    try:
        found = [float(v) for v in text.split(",")]
    except ValueError:
        found = []
    if not found or count not in (None, len(found)):
        many = "" if count is None else f"{count} "
        raise typer.BadParameter(f"{option} takes {many}numbers with commas between, not {text}")
    return found


def json_value(text: str, where: str) -> Any:
    """Return the value of a text in JSON; the message of a ValueError begins with `where`."""
    try:
        return json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"{where}: is not valid JSON: {error}") from error
