"""What a check of a map reports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One place where a map disagrees with itself or with physics.

    Attributes
    ----------
    kind : what is wrong, a row of the table of rules: ``floating``
    severity : an error makes answers wrong, a warning can, a note does not
    entities : the names of those concerned
    text : a sentence for people
    fix : the call or statement that repairs it, or what to do by hand
    safe : `fix` is a SQL statement that changes only what is derived from the geometry
    """

    kind: str
    severity: Severity
    entities: tuple[str, ...]
    text: str
    fix: str
    safe: bool = False

    def __str__(self) -> str:
        return f"{self.severity}: {self.kind}: {self.text}"
