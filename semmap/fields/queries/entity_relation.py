"""Relations between entities, such as `on` and `sees`, as statements for queries."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
from numpy.typing import NDArray

from semmap.fields.queries.statements import Entities, Statements
from semmap.fields.relations.tracker import RelationTracker
from semmap.language.schema import Property

__all__ = ["EntityRelation"]


class EntityRelation:
    """States `entity property entity`, from the relation that has the property's name.

    Parameters
    ----------
    property : its `name` is that of a rule: `in`, `on`, `touching`, `near` or `sees`
    tracker : returns the relations, named as in facts; called when statements are read
    """

    def __init__(self, property: Property, tracker: Callable[[], RelationTracker]) -> None:
        self.property = property
        self._tracker = tracker

    def statements(
        self,
        *,
        subjects: Collection[str] | None = None,
        objects: Collection[str] | None = None,
        within: NDArray[np.int64] | None = None,
    ) -> Statements:
        """Return the statements; see `StatementRelation.statements`.

        Raises
        ------
        LookupError
            No rule of the tracker has the name of the property.
        """
        tracker, name = self._tracker(), self.property.name
        known = [rule.name for rule in tracker.rules]
        if name not in known:
            raise LookupError(f"there is no relation {name}; relations: {', '.join(known)}")
        facts = sorted((str(fact.subject), str(fact.object)) for fact in tracker.holding(name))
        wanted = [
            (subject, object)
            for subject, object in facts
            if (subjects is None or subject in subjects) and (objects is None or object in objects)
        ]
        return Statements(
            Entities.from_names(subject for subject, _ in wanted),
            Entities.from_names(object for _, object in wanted),
        )
