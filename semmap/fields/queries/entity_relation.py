"""What relations hold between things, as a query asks for it."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from semmap.language.property import Property
from semmap.fields.relations.relations import Relations
from semmap.fields.queries.statements import Statements, Things

__all__ = ["ThingRelation"]


class ThingRelation:
    """`thing property thing`, of the relation that has the property's name.

    Parameters
    ----------
    property : its `name` is that of a rule: `in`, `on`, `touching`, `near` or `sees`
    relations : what holds; things are called as they are in facts
    """

    def __init__(self, property: Property, relations: Relations) -> None:
        known = [rule.name for rule in relations.rules]
        if property.name not in known:
            raise LookupError(f"no rule is named {property.name}: there are {', '.join(known)}")
        self.property = property
        self._relations = relations

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        pairs = sorted(
            (str(fact.subject), str(fact.object))
            for fact in self._relations.holding(self.property.name)
        )
        wanted = [
            (subject, object)
            for subject, object in pairs
            if (subjects is None or subject in subjects) and (objects is None or object in objects)
        ]
        return Statements(Things.of(a for a, _ in wanted), Things.of(b for _, b in wanted))
