"""All inferences of a map at once."""

from __future__ import annotations

import gc
from collections.abc import Iterator

from semmap.knowledge.map_view import MapView
from semmap.knowledge.reasoning.axioms import OntologyAxioms
from semmap.knowledge.reasoning.closure import FactIndex, Rows, close_all
from semmap.knowledge.reasoning.engine import SAME_AS, TYPE_OF, Node, close
from semmap.knowledge.reasoning.store import Stored, StoredFacts
from semmap.knowledge.reasoning.told_facts import (
    COLUMNS,
    DIRECT_TYPE,
    KIND,
    Hierarchy,
    told_facts,
)


def first_run(view: MapView, ontology: OntologyAxioms) -> tuple[OntologyAxioms, Stored]:
    """Store all that follows from the facts of a map; return the rules that were needed, too.

    The rules of equality are about all facts, and are left out as long as nothing is the same.
    """
    view.session.execute("DELETE FROM inference WHERE map_id = %s", (view.number,))
    ontology = ontology.with_equality(view, False)
    done = None if ontology.equality else _by_relation(view, ontology)
    if done is None:
        ontology = ontology.with_equality(view, True)
        done = _by_fact(view, ontology)
    if done.added.total() > 1_000:
        view.session.execute("ANALYZE inference")  # skipped where another role owns the table
    return ontology, done


def _by_relation(view: MapView, ontology: OntologyAxioms) -> Stored | None:
    """Infer without rules of equality; None where they apply, and nothing is stored."""
    rules = ontology.rules
    wanted = rules.classes | rules.heads
    told, facts = FactIndex(), FactIndex()
    for fact in told_facts(view, ontology.hierarchy, rules.properties, wanted):
        told.add(fact)
    for key, rows in told.rows.items():
        facts.extend(key, rows)
    for key, rows in _types(told, ontology.hierarchy, wanted):
        facts.extend(key, rows)
    added = close_all(facts, rules.rules)
    if SAME_AS in added.rows:
        return None
    done = Stored(complete=True)
    copy = f"COPY inference (map_id, {COLUMNS}, told) FROM STDIN"
    with view.session.cursor() as cursor, cursor.copy(copy.encode()) as lines:
        for relations, is_told in ((told, "t"), (added, "f")):
            for key, rows in relations.rows.items():
                lines.write(_lines(view.number, key, rows, is_told))
    for key, rows in added.rows.items():
        verb, node = key if isinstance(key, tuple) else (key, "")
        done.note(verb, node, len(rows))
    return done


def _types(
    told: FactIndex, hierarchy: Hierarchy, wanted: frozenset[Node]
) -> Iterator[tuple[object, Rows]]:
    """Yield the wanted classes that entities are of by their types, with the entities."""
    for verb in (DIRECT_TYPE, KIND):
        for type_, entities in told.by(verb, 1).items():
            for c in hierarchy.of([type_]) & wanted:
                yield (TYPE_OF, c), set(entities)


def _lines(number: int, key: object, rows: Rows, told: str) -> str:
    """Return the lines of COPY for the rows of a relation."""
    if isinstance(key, tuple):
        verb, node = key
        end = f"{_escaped(verb)}\t{_object(node)}\t{told}\n"
        return "".join([f"{number}\t{_subject(each)}\t{end}" for each in rows])
    begin, verb = f"{number}\t", f"\t{_escaped(str(key))}\t"
    end = f"\t{told}\n"
    return "".join([f"{begin}{_subject(a)}{verb}{_object(b)}{end}" for a, b in rows])


def _subject(node: Node) -> str:
    return f"{node}\t\\N" if isinstance(node, int) else f"\\N\t{_escaped(str(node))}"


def _object(node: Node) -> str:
    if isinstance(node, int):
        return f"{node}\t\\N\t\\N"
    text, tag = (node, "I") if isinstance(node, str) else node
    return f"\\N\t{_escaped(text)}\t{_escaped(tag)}"


_ESCAPES = str.maketrans({"\\": "\\\\", "\t": "\\t", "\n": "\\n", "\r": "\\r"})


def _escaped(text: str) -> str:
    return text.translate(_ESCAPES)


def _by_fact(view: MapView, ontology: OntologyAxioms) -> Stored:
    """Infer with rules of equality, a fact at a time."""
    facts, rules = StoredFacts(view, ontology, empty=True), ontology.rules
    wanted = rules.classes | rules.heads
    for fact in told_facts(view, ontology.hierarchy, rules.properties, wanted):
        facts.add(fact, told=True)
    start = list(facts.all())
    for fact in rules.stated():
        facts.add(fact)
        start.append(fact)
    gc.disable()  # facts have no cycles, and looking for some takes long
    try:
        close(facts, rules.rules, start)
    finally:
        gc.enable()
    return facts.store()
