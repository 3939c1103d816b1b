"""Relations between entities, such as `on` and `sees`, as statements for queries."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from semmap.fields.queries.statements import ALL, Demand, Entities, Statements, UnknownError
from semmap.fields.relations.facts import RelationFact
from semmap.fields.relations.rules import RelationRule
from semmap.language.schema import Property


class Relations(Protocol):
    """What is true: a `RelationTracker`, or what was true in the past."""

    @property
    def rules(self) -> tuple[RelationRule, ...]:
        """The rules of the relations."""
        ...

    def holding(self, relation: str | None = None) -> Mapping[RelationFact, Any]:
        """Return the facts, of one relation if given."""
        ...


@dataclass(eq=False)
class EntityRelation:
    """States `entity property entity`, from the relation that has the property's name."""

    property: Property  # its `name` is that of a rule: `in`, `on`, `touching`, `near` or `sees`
    tracker: Callable[[], Relations]  # named as in facts; called when statements are read
    # returns the entities that have no voxels, whose relations are therefore unknown
    unknown: Callable[[], Collection[str]] = tuple
    # returns the property that nothing provides, and without which all is unknown
    missing: Callable[[], str | None] = lambda: None
    left_out: set[str] = field(default_factory=set)  # by the statements that were read

    def statements(self, wanted: Demand = ALL) -> Statements:
        """Return the statements that are wanted.

        Raises UnknownError: all entities to which a side is limited have no voxels, or what the
        relation follows from is missing. Raises LookupError: no rule of the tracker has the
        property's name.
        """
        subjects, objects, _ = wanted
        tracker, name = self.tracker(), self.property.name
        known = [rule.name for rule in tracker.rules]
        if name not in known:
            raise LookupError(f"there is no relation {name}; relations: {', '.join(known)}")
        missing = self.missing()
        if missing is not None:
            raise UnknownError(
                f"no source provides :{missing}, so that :{name} is unknown. Start one: semmap "
                "fields serve -h"
            )
        for side in (subjects, objects):
            self._check_known(side)
        facts = sorted((str(fact.subject), str(fact.object)) for fact in tracker.holding(name))
        holding = [
            (subject, object)
            for subject, object in facts
            if (subjects is None or subject in subjects) and (objects is None or object in objects)
        ]
        return Statements(
            Entities.from_names(subject for subject, _ in holding),
            Entities.from_names(object for _, object in holding),
        )

    def _check_known(self, names: Collection[str] | None) -> None:
        without = set(self.unknown())
        self.left_out |= without if names is None else without & set(names)
        if names and without.issuperset(names):
            shown = ", ".join(sorted(names)[:5])
            raise UnknownError(
                f"{shown}: no voxels, so that :{self.property.name} is unknown. Give the entity a "
                "geometry, or ask for its holder: semmap show NAME"
            )
