"""Runs of the reasoner, and the state that they leave in the table `reasoning`."""

from __future__ import annotations

import gc
import time
from dataclasses import dataclass
from typing import Any

from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import limited_view
from semmap.knowledge.reasoning.axioms import OntologyAxioms
from semmap.knowledge.reasoning.engine import SAME_AS, TYPE_OF, close, retract
from semmap.knowledge.reasoning.store import Stored, StoredFacts
from semmap.knowledge.reasoning.told_facts import DIRECT_TYPE, KIND, told_facts
from semmap.knowledge.sparql.kept_queries import Session

MANY = 5_000  # from so many changed entities on, all facts are read again


@dataclass(frozen=True)
class Reasoned:
    """The changes by a run of the reasoner."""

    added: int
    removed: int
    inferences: int  # how many there are now
    contradictions: int
    complete: bool  # all facts were read
    seconds: float


def reason(session: Session, *, complete: bool = False, seconds: float | None = None) -> Reasoned:
    """Reason about the map that a session sees, from now on after each update, too."""
    with limited_view(session, seconds) as view:
        session.execute(
            "INSERT INTO reasoning (map_id, axioms, cursor) VALUES (%s, '', change_cursor()) "
            "ON CONFLICT DO NOTHING",
            (view.number,),
        )
        done = refresh(view, complete=complete)
        assert done is not None
        return done


def forget(session: Session) -> None:
    """Remove the inferences of a map, and reason about it no more."""
    with session.transaction():
        session.execute("DELETE FROM reasoning WHERE map_id = %s", (MapView.of(session).number,))


def is_reasoned(view: MapView) -> bool:
    """Return whether a map is reasoned about."""
    return view.value("SELECT true FROM reasoning WHERE map_id = %s", view.number) is not None


def refresh(view: MapView, *, complete: bool = False) -> Reasoned | None:
    """Bring the inferences of a map up to date; None where it is not reasoned about."""
    start = time.perf_counter()
    row = view.session.execute(
        "SELECT axioms, cursor, at FROM reasoning WHERE map_id = %s FOR UPDATE", (view.number,)
    ).fetchone()
    if row is None:
        return None
    state, cursor, at = row
    # Before the changes are read: what is committed after this is read by the next run.
    news = view.session.execute("SELECT change_cursor(), statement_timestamp()").fetchone()
    assert news is not None
    ontology = OntologyAxioms.read(view, state)
    changed = None
    if ontology.is_of(state) and not complete:
        changed = Changed.since(view, cursor, at)
    done = None if changed is None else _consider(view, ontology, changed)
    if done is None:
        ontology, done = _first_run(view, ontology)
    counts = _note(view, ontology, news, done)
    return Reasoned(
        done.added.total(),
        done.removed,
        *counts,
        done.complete,
        time.perf_counter() - start,
    )


def _note(
    view: MapView, ontology: OntologyAxioms, news: tuple[Any, Any], done: Stored
) -> tuple[int, int]:
    """Write the state of the reasoner; return the numbers of inferences and contradictions."""
    properties = sorted({p for p, _ in done.added})
    classes = sorted({c for _, c in done.added if c is not None})
    merged = "ARRAY(SELECT DISTINCT unnest({0} || %({0})s::text[]) ORDER BY 1)"
    kept = "%({0})s::text[]" if done.complete else merged
    start = "0" if done.complete else "{}"
    row = view.session.execute(
        f"UPDATE reasoning SET axioms = %(axioms)s, cursor = %(cursor)s, at = %(at)s, "
        f"properties = {kept.format('properties')}, classes = {kept.format('classes')}, "
        f"inferences = {start.format('inferences')} + %(more)s, "
        f"contradictions = {start.format('contradictions')} + %(clashes)s "
        "WHERE map_id = %(map)s "
        "RETURNING inferences, contradictions".encode(),
        {
            "axioms": ontology.state,
            "cursor": news[0],
            "at": news[1],
            "properties": properties,
            "classes": classes,
            "more": done.added.total() - done.removed,
            "clashes": done.clashes,
            "map": view.number,
        },
    ).fetchone()
    assert row is not None
    return row[0], row[1]


@dataclass(frozen=True)
class Changed:
    """What changed: the ids of entities, and whether other facts did."""

    ids: frozenset[int]
    others: bool

    @classmethod
    def since(cls, view: MapView, cursor: str, at: Any) -> Changed | None:
        """Return what changed since a run; None where it is not known, or too much."""
        if not view.value("SELECT reaches_back(%s)", cursor):
            return None
        ids: set[int] = set()
        others = False
        for what, entities in view.session.execute(
            "SELECT what, entities FROM changes_since(%s) WHERE map_id = %s", (cursor, view.number)
        ):
            others |= what in ("statement", "removed")
            ids.update(entities)
        for pair in view.session.execute(
            "SELECT subject_id, object_id FROM triple WHERE map_id = %s AND until > %s "
            "AND until <= statement_timestamp()",
            (view.number, at),
        ):
            others = True
            ids.update(each for each in pair if each is not None)
        return None if len(ids) > MANY else cls(frozenset(ids), others)


def _consider(view: MapView, ontology: OntologyAxioms, changed: Changed) -> Stored | None:
    """Store what follows from changed facts, and remove what does not; None: equality is new."""
    facts, compiled = StoredFacts(view, ontology), ontology.rules
    if not changed.ids and not changed.others:
        return Stored()
    old = facts.read_told(changed.ids, others=changed.others)
    new = set(told_facts(view, ontology, changed.ids, others=changed.others))
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


def _first_run(view: MapView, ontology: OntologyAxioms) -> tuple[OntologyAxioms, Stored]:
    """Store all that follows; the rules of equality are left out as long as nothing is the same."""
    view.session.execute("DELETE FROM inference WHERE map_id = %s", (view.number,))
    ontology = ontology.with_equality(view, False)
    facts = _closed(view, ontology)
    if not ontology.equality and facts.infers(SAME_AS):
        ontology = ontology.with_equality(view, True)
        facts = _closed(view, ontology)
    done = facts.store()
    if done.added.total() > 1_000:
        view.session.execute("ANALYZE inference")  # skipped where another role owns the table
    return ontology, done


def _closed(view: MapView, ontology: OntologyAxioms) -> StoredFacts:
    facts, rules = StoredFacts(view, ontology, empty=True), ontology.rules
    for fact in told_facts(view, ontology):
        facts.add(fact, told=True)
    for fact in rules.stated():
        facts.add(fact)
    gc.disable()  # facts have no cycles, and looking for some takes long
    try:
        close(facts, rules.rules, list(facts.all()))
    finally:
        gc.enable()
    return facts
