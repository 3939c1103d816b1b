"""Pages of questions: each has blocks of SPARQL, SQL and Python, and the answer as text."""

from __future__ import annotations

import re
from collections.abc import Iterable
from decimal import Decimal
from pathlib import Path
from typing import Any

from semmap.knowledge.vocabulary import decode

DOCS = Path(__file__).parents[1] / "docs"


def blocks_of(text: str) -> dict[str, str]:
    """Return the blocks of a part of a page by their language."""
    return dict(re.findall(r"^```(\w+)\n(.*?)^```$", text, re.S | re.M))


def questions(page: str, heading: str = "") -> dict[str, dict[str, str]]:
    """Return the blocks of each question of a page, below the headings that begin with a text."""
    chapters = (DOCS / page).read_text(encoding="utf-8").split("\n## ")[1:]
    parts = [
        part
        for chapter in chapters
        if chapter.startswith(heading)
        for part in chapter.split("\n### ")[1:]
    ]
    return {part.splitlines()[0]: blocks for part in parts if (blocks := blocks_of(part))}


def plain(term: Any) -> Any:
    """Return an entity of the map as its name, another IRI as itself, a literal as its value."""
    text = str(term)
    if text.startswith("urn:semmap:map:"):
        return decode(text.rsplit("#")[-1])
    return text if term is None or text.startswith("urn:") else term.toPython()


def written(rows: Iterable[Iterable[Any]]) -> str:
    """Return rows as pages have them: sorted, floating-point numbers to three digits."""

    def text(value: Any) -> str:
        return f"{value:.3f}" if isinstance(value, (float, Decimal)) else str(value)

    return "".join(sorted("  ".join(map(text, row)) + "\n" for row in rows))
