"""Tables in Markdown, as pages of the documentation have them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Print a heading and a table."""
    lines = [columns, ["---"] * len(columns), *rows]
    print(f"\n## {title}\n")
    for line in lines:
        print("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |")
