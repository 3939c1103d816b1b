"""Facts about entities, and the events of their beginning and end."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple


class RelationFact(NamedTuple):
    """A relation between two entities, such as `human1 sees book_326`."""

    relation: str
    subject: Hashable
    object: Hashable


@dataclass(frozen=True)
class RelationEvent:
    """The beginning or end of a fact."""

    # relation, subject, object: the fact
    relation: str
    subject: Hashable
    object: Hashable
    began: bool  # True for the beginning
    time: datetime  # aware

    @property
    def fact(self) -> RelationFact:
        """The fact that begins or ends."""
        return RelationFact(self.relation, self.subject, self.object)

    def __str__(self) -> str:
        """Return the event as a sentence."""
        verb = "begins" if self.began else "ends"
        return f"{self.subject} {self.relation} {self.object} {verb}"
