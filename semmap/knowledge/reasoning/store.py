"""The facts and inferences of a map in the table `inference`, read where they are needed."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import INFERRED_GRAPH
from semmap.knowledge.reasoning.axioms import OntologyAxioms
from semmap.knowledge.reasoning.engine import TYPE_OF, Facts, Node, Triple
from semmap.knowledge.reasoning.rules import CONTRADICTION
from semmap.knowledge.reasoning.told_facts import COLUMNS, DIRECT_TYPE, KIND, columns_of, fact_of


@dataclass
class Stored:
    """What was written."""

    # numbers of new inferences, by property and class
    added: Counter[tuple[str, str | None]] = field(default_factory=Counter)
    removed: int = 0  # number of inferences
    clashes: int = 0  # how many contradictions there are more
    complete: bool = False  # nothing was there before

    def include(self, other: Stored) -> None:
        """Count what was written of another graph, too."""
        self.added += other.added
        self.removed += other.removed
        self.clashes += other.clashes


class StoredFacts(Facts):
    """The facts of a map, or of a named graph.

    Of entities a map is told the types, and those that subsume them.
    """

    def __init__(self, view: MapView, ontology: OntologyAxioms, *, empty: bool = False) -> None:
        super().__init__()
        self._view, self.ontology, self._empty = view, ontology, empty
        self._place = {"map": view.number, "graph": ontology.graph or INFERRED_GRAPH}
        self._before: dict[Triple, bool] = {}
        self._touched: dict[Triple, None] = {}
        self._seen: set[object] = set()
        self._classes_of: dict[frozenset[Node], frozenset[Node]] = {}
        self._types: dict[Node, frozenset[Node]] = {}
        classes, hierarchy = ontology.rules.classes, ontology.hierarchy
        self._met = cache(lambda told: hierarchy.of([told]) & classes)
        for fact in ontology.known:
            super().add(fact)

    def need_subject(self, subject: Node) -> None:
        """Read the facts of a subject."""
        if not self._empty and subject not in self._seen:
            self.need_subjects([subject])

    def need_subjects(self, subjects: Iterable[Node]) -> None:
        """Read the facts of several subjects at once."""
        if self._empty:
            return
        new = {s for s in subjects if s not in self._seen}
        self._seen |= new
        ids = [s for s in new if isinstance(s, int)]
        iris = [s for s in new if isinstance(s, str)]
        if ids:
            self._read("subject_id = ANY (%(a)s)", a=ids)
        if iris:
            self._read("subject = ANY (%(a)s)", a=iris)

    def need_object(self, verb: Node | None, node: Node) -> None:
        """Read the facts with an object, of a property or of all."""
        keys = {("object", None, node), ("object", verb, node)}
        if keys & self._seen:
            return
        self._seen.add(("object", verb, node))
        of = "" if verb is None else " AND predicate = %(verb)s"
        if isinstance(node, int):
            self._read(f"object_id = %(a)s{of}", a=node, verb=verb)
            return
        text, tag = (node, "I") if isinstance(node, str) else node
        self._read(
            f"object IS NOT NULL AND md5(object) = md5(%(a)s) AND object = %(a)s "
            f"AND tag = %(tag)s{of}",
            a=text,
            tag=tag,
            verb=verb,
        )
        if verb in (None, TYPE_OF) and isinstance(node, str):
            self._read(
                "object IS NOT NULL AND md5(object) = ANY (%(a)s) AND predicate = ANY (%(verbs)s)",
                a=[
                    hashlib.md5(str(c).encode()).hexdigest()
                    for c in self.ontology.hierarchy.subclasses(node)
                ],
                verbs=[DIRECT_TYPE, KIND],
            )

    def need_verb(self, verb: Node | None) -> None:
        """Read the facts of a property, or all."""
        if ("verb", verb) not in self._seen:
            self._seen.add(("verb", verb))
            self._read("true" if verb is None else "predicate = %(verb)s", verb=verb)

    def read_told(self, ids: Collection[int], *, others: bool) -> set[Triple]:
        """Return the facts that were told, of entities and others."""
        return self._read(
            "(subject_id = ANY (%(ids)s) OR subject_id IS NOT NULL AND object_id = ANY (%(ids)s)"
            f"{' OR subject IS NOT NULL' if others else ''}) AND told",
            ids=list(ids),
        )

    def _read(self, condition: str, **values: Any) -> set[Triple]:
        found: set[Triple] = set()
        if self._empty:
            return found
        with self._view.session.cursor() as cursor:
            sql = (
                f"SELECT {COLUMNS}, told FROM inference "
                f"WHERE map_id = %(map)s AND graph = %(graph)s AND {condition}"
            )
            for row in cursor.execute(sql.encode(), values | self._place):
                fact = fact_of(row[:6])
                found.add(fact)
                if fact not in self._before:
                    self._before[fact] = row[6]
                    self._keep(fact, told=row[6])
        return found

    def types_of(self, entity: Node) -> frozenset[Node]:
        """Return the classes that an entity is told to be of."""
        self.need_subject(entity)
        if entity in self._types:
            return self._types[entity]
        direct = self._objects.get((entity, DIRECT_TYPE), set())
        direct_types = frozenset(direct | self._objects.get((entity, KIND), set()))
        if direct_types not in self._classes_of:
            self._classes_of[direct_types] = self.ontology.hierarchy.of(direct_types)
        return self._types.setdefault(entity, self._classes_of[direct_types])

    def is_told(self, fact: Triple) -> bool:
        """Return whether a fact is stated, or a type that subsumes one."""
        if fact in self._told:
            return True
        return fact[1] == TYPE_OF and isinstance(fact[0], int) and fact[2] in self.types_of(fact[0])

    def __contains__(self, fact: Triple) -> bool:
        return super().__contains__(fact) or self.is_told(fact)

    def add(self, fact: Triple, *, told: bool = False) -> None:
        """Add a fact, to be stored."""
        self.need_subject(fact[0])
        self._touched[fact] = None
        self._keep(fact, told=told)

    def remove(self, fact: Triple) -> None:
        """Remove a fact, here and from the table."""
        self.need_subject(fact[0])
        self._touched[fact] = None
        self._types.pop(fact[0], None)
        super().remove(fact)

    def untell(self, fact: Triple) -> None:
        """Let a fact be no longer stated."""
        self._touched[fact] = None
        super().untell(fact)

    def touch(self, fact: Triple) -> None:
        """Look at a fact again when the changes are stored."""
        self._touched[fact] = None

    def _keep(self, fact: Triple, *, told: bool) -> None:
        super().add(fact, told=told)
        if fact[1] in (DIRECT_TYPE, KIND):
            self._types.pop(fact[0], None)
            for c in self._met(fact[2]):
                super().add((fact[0], TYPE_OF, c))

    def _state(self, fact: Triple) -> bool | None:
        """Return whether a fact is told; None where it has no row."""
        if fact in self._told:
            return True
        known = fact in self.ontology.known or self.is_told(fact)
        if known or not super().__contains__(fact):
            return None
        return False

    def infers(self, verb: Node) -> bool:
        """Return whether something with a property was inferred."""
        return any(fact[1] == verb and self._state(fact) is False for fact in self._touched)

    def store(self) -> Stored:
        """Write what changed."""
        gone, come = [], []
        done = Stored(complete=self._empty)
        for fact in self._touched:
            before, after = self._before.get(fact), self._state(fact)
            if before is after:
                continue
            if before is not None:
                gone.append(fact)
            if before is False:
                done.removed += 1
                done.clashes -= fact[1] == CONTRADICTION
            if after is not None:
                come.append((*self._place.values(), *columns_of(fact), after))
            if after is False:
                _, verb, node = fact
                done.added[str(verb), str(node) if verb == TYPE_OF else None] += 1
                done.clashes += verb == CONTRADICTION
        with self._view.session.cursor() as cursor:
            for by in ("subject_id", "subject"):
                values = _columns(gone, by)
                if values[0]:
                    cursor.execute(_DELETE.format(by=by).encode(), (*values, *self._place.values()))
            if come:
                copy = f"COPY inference (map_id, graph, {COLUMNS}, told) FROM STDIN"
                with cursor.copy(copy.encode()) as lines:
                    for row in come:
                        lines.write_row(row)
        return done


_DELETE = (
    "DELETE FROM inference i USING unnest(%s::bigint[], %s::text[], %s::text[], %s::bigint[], "
    f"%s::text[], %s::text[]) f ({COLUMNS}) WHERE i.map_id = %s AND i.graph = %s "
    "AND i.{by} = f.{by} AND i.predicate = f.predicate "
    "AND i.object_id IS NOT DISTINCT FROM f.object_id "
    "AND (i.object, i.tag) IS NOT DISTINCT FROM (f.object, f.tag)"
)


def _columns(facts: Iterable[Triple], by: str) -> list[list[Any]]:
    """Return the columns of the facts whose subject is an entity or, by "subject", an IRI."""
    is_entity = by == "subject_id"
    rows = [columns_of(fact) for fact in facts if isinstance(fact[0], int) == is_entity]
    return [list(column) for column in zip(*rows, strict=True)] or [[]]
