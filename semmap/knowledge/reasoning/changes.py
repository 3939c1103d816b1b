"""What changed facts lead to: only they, and what a rule needs besides, are read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from semmap.knowledge.map_view import MapView
from semmap.knowledge.reasoning.axioms import OntologyAxioms
from semmap.knowledge.reasoning.engine import SAME_AS, TYPE_OF, close, retract
from semmap.knowledge.reasoning.store import Stored, StoredFacts
from semmap.knowledge.reasoning.told_facts import DIRECT_TYPE, KIND, told_facts

MANY = 5_000
"""From so many changed entities on, all facts are read again."""


@dataclass(frozen=True)
class Changed:
    """What changed: the ids of entities, and whether other facts did."""

    ids: frozenset[int]
    others: bool

    @classmethod
    def since(cls, view: MapView, cursor: str, at: Any) -> Changed | None:
        """Return what changed since a run; None where it is not known, or too much."""
        row = view.session.execute("SELECT reaches_back(%s)", (cursor,)).fetchone()
        if row is None or not row[0]:
            return None
        ids: set[int] = set()
        others = False
        for what, entities in view.session.execute(
            "SELECT what, entities FROM changes_since(%s) WHERE map_id = %s", (cursor, view.number)
        ):
            others |= what in ("statement", "removed")
            ids.update(entities)
        for pair in view.session.execute(
            "SELECT subject_id, object_id FROM statement WHERE map_id = %s AND until > %s "
            "AND until <= statement_timestamp()",
            (view.number, at),
        ):
            others = True
            ids.update(each for each in pair if each is not None)
        return None if len(ids) > MANY else cls(frozenset(ids), others)


def consider(view: MapView, ontology: OntologyAxioms, changed: Changed) -> Stored | None:
    """Store what follows from changed facts, and remove what does not; None: equality is new."""
    facts, compiled = StoredFacts(view, ontology), ontology.rules
    if not changed.ids and not changed.others:
        return Stored()
    wanted = compiled.classes | compiled.heads
    old = facts.read_told(changed.ids, others=changed.others)
    new = set(
        told_facts(
            view,
            ontology.hierarchy,
            compiled.properties,
            wanted,
            changed.ids,
            others=changed.others,
        )
    )
    facts.need_subjects({fact[0] for fact in old ^ new})
    typed = {f[0] for f in old ^ new if f[1] in (DIRECT_TYPE, KIND)}
    types = {entity: facts.types_of(entity) for entity in typed}
    gone = old - new
    come = [fact for fact in new - old if fact not in facts]
    for fact in gone:
        facts.untell(fact)
        if fact[1] in (DIRECT_TYPE, KIND):
            facts.remove(fact)
    for fact in new - old:
        facts.add(fact, told=True)
    lost = {(e, TYPE_OF, c) for e in typed for c in types[e] - facts.types_of(e)}
    won = [(e, TYPE_OF, c) for e in typed for c in facts.types_of(e) - types[e]]
    for fact in won:
        facts.touch(fact)
    retract(facts, compiled.rules, gone | lost)
    close(facts, compiled.rules, [*come, *won])
    if not ontology.equality and facts.infers(SAME_AS):
        return None
    return facts.store()
