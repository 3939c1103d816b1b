"""What a check of a map reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One place where a map disagrees with itself or with physics."""

    kind: str  # of the table of rules, such as floating
    severity: Severity  # an error makes answers wrong, a warning can, a note does not
    entities: tuple[str, ...]
    text: str
    fix: str  # the call or statement that repairs it, or what to do by hand
    safe: bool = False  # `fix` is SQL that changes only what is derived from the geometry

    def __str__(self) -> str:
        return f"{self.severity}: {self.kind}: {self.text}"
