"""Runs of the reasoner, and the state that they leave in the table `reasoning`."""

from __future__ import annotations

import gc
import time
from dataclasses import dataclass
from typing import Any

from psycopg.types.json import Jsonb

from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import limited_view
from semmap.knowledge.reasoning.axioms import OntologyAxioms
from semmap.knowledge.reasoning.engine import SAME_AS, TYPE_OF, close, retract
from semmap.knowledge.reasoning.rules import CONTRADICTION
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
        "SELECT axioms, graphs, cursor, at FROM reasoning WHERE map_id = %s FOR UPDATE",
        (view.number,),
    ).fetchone()
    if row is None:
        return None
    state, states, cursor, at = row
    # Before the changes are read: what is committed after this is read by the next run.
    news = view.session.execute("SELECT change_cursor(), statement_timestamp()").fetchone()
    assert news is not None
    changed = None if complete else Changed.since(view, cursor, at)
    ontology, done = _run(view, "", state, changed)
    if done.complete:  # what is noted begins again
        changed, states = None, {}
    stated = _named_graphs(view)
    chosen = None if changed is None else changed.graphs
    for graph in sorted(stated | states.keys() if chosen is None else chosen - {""}):
        of_graph, more = _run(view, graph, states.pop(graph, ""), changed)
        states |= {graph: of_graph.state} if graph in stated else {}
        done.include(more)
    counts = _note(view, ontology, states, news, done)
    return Reasoned(
        done.added.total(),
        done.removed,
        *counts,
        done.complete,
        time.perf_counter() - start,
    )


def _run(
    view: MapView, graph: str, state: str, changed: Changed | None
) -> tuple[OntologyAxioms, Stored]:
    """Bring the inferences of a graph up to date, after a run that left a state."""
    ontology = OntologyAxioms.read(view, state, graph)
    if changed is not None and ontology.is_of(state):
        done = _consider(view, ontology, changed)
        if done is not None:
            return ontology, done
    return _first_run(view, ontology)


def _named_graphs(view: MapView) -> set[str]:
    """Return the named graphs that have statements."""
    rows = view.session.execute(
        "WITH RECURSIVE g (id) AS ("
        "(SELECT graph FROM triple WHERE map_id = %(map)s AND graph <> 0 ORDER BY graph LIMIT 1) "
        "UNION ALL SELECT (SELECT graph FROM triple WHERE map_id = %(map)s AND graph <> 0 "
        "AND graph > g.id ORDER BY graph LIMIT 1) FROM g WHERE g.id IS NOT NULL) "
        "SELECT t.text FROM g JOIN term t USING (id)",
        {"map": view.number},
    )
    return {text for (text,) in rows}


def _note(
    view: MapView,
    ontology: OntologyAxioms,
    states: dict[str, str],
    news: tuple[Any, Any],
    done: Stored,
) -> tuple[int, int]:
    """Write the state of the reasoner; return the numbers of inferences and contradictions."""
    properties = sorted({p for p, _ in done.added})
    classes = sorted({c for _, c in done.added if c is not None})
    merged = "ARRAY(SELECT DISTINCT unnest({0} || %({0})s::text[]) ORDER BY 1)"
    kept = "%({0})s::text[]" if done.complete else merged
    start = "0" if done.complete else "{}"
    row = view.session.execute(
        f"UPDATE reasoning SET axioms = %(axioms)s, graphs = %(graphs)s, "
        "cursor = %(cursor)s, at = %(at)s, "
        f"properties = {kept.format('properties')}, classes = {kept.format('classes')}, "
        f"inferences = {start.format('inferences')} + %(more)s, "
        f"contradictions = {start.format('contradictions')} + %(clashes)s "
        "WHERE map_id = %(map)s "
        "RETURNING inferences, contradictions".encode(),
        {
            "axioms": ontology.state,
            "graphs": Jsonb(states),
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
    """What changed: the ids of entities, and the graphs of statements; None: perhaps all."""

    ids: frozenset[int]
    graphs: frozenset[str] | None

    @classmethod
    def since(cls, view: MapView, cursor: str, at: Any) -> Changed | None:
        """Return what changed since a run; None where it is not known, or too much."""
        if not view.value("SELECT reaches_back(%s)", cursor):
            return None
        ids: set[int] = set()
        graphs: set[str | None] = set()
        for what, entities, facts in view.session.execute(
            "SELECT what, entities, facts FROM changes_since(%s) WHERE map_id = %s",
            (cursor, view.number),
        ):
            if what == "statement":
                graphs.update([None] if facts is None else (graph for graph, *_ in facts))
            elif what == "removed":
                graphs.add("")
            ids.update(entities)
        for graph, *ends in view.session.execute(
            "SELECT coalesce(g.text, ''), subject_id, object_id FROM triple t "
            "LEFT JOIN term g ON g.id = t.graph WHERE map_id = %s AND until > %s "
            "AND until <= statement_timestamp()",
            (view.number, at),
        ):
            graphs.add(graph)
            ids.update(each for each in ends if each is not None)
        if len(ids) > MANY:
            return None
        named = frozenset(each for each in graphs if each is not None)
        return cls(frozenset(ids), None if None in graphs else named)


def _consider(view: MapView, ontology: OntologyAxioms, changed: Changed) -> Stored | None:
    """Store what follows from changed facts, and remove what does not; None: equality is new."""
    facts, compiled = StoredFacts(view, ontology), ontology.rules
    others = changed.graphs is None or ontology.graph in changed.graphs
    if not changed.ids and not others:
        return Stored()
    old = facts.read_told(changed.ids, others=others)
    new = set(told_facts(view, ontology, changed.ids, others=others))
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
    """Store all that follows, of the map before its graphs.

    The rules of equality are left out as long as nothing is the same.
    """
    gone = view.session.execute(
        "WITH gone AS (DELETE FROM inference WHERE map_id = %(map)s "
        "AND (%(graph)s::text = '' OR graph = %(graph)s) RETURNING predicate, told) "
        "SELECT count(*), count(*) FILTER (WHERE predicate = %(clash)s) FROM gone WHERE NOT told",
        {"map": view.number, "graph": ontology.graph, "clash": CONTRADICTION},
    ).fetchone()
    ontology = ontology.with_equality(view, False)
    facts = _closed(view, ontology)
    if not ontology.equality and facts.infers(SAME_AS):
        ontology = ontology.with_equality(view, True)
        facts = _closed(view, ontology)
    done = facts.store()
    if ontology.graph and gone is not None:
        done.removed, done.clashes = gone[0], done.clashes - gone[1]
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
