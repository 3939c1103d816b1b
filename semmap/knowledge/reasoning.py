"""What follows from the facts of a map by OWL 2 RL, kept in the table `inference`.

The first time, all facts are read and closed. Then only those that changed: what follows from them
is derived, what lost its last reason is removed, and other facts are read where a rule needs them.
"""

from __future__ import annotations

import gc
import hashlib
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import rdflib

from semmap.ingest.ontology.tbox import ontology_files
from semmap.knowledge.constants import Constants, tag_and_text
from semmap.knowledge.map_view import MapView, Session, term_of
from semmap.knowledge.mapping import is_mapped
from semmap.knowledge.queries import limited
from semmap.knowledge.reasoning_engine import (
    SAME_AS,
    TYPE_OF,
    Facts,
    Node,
    Proof,
    Triple,
    close,
    retract,
)
from semmap.knowledge.reasoning_rules import (
    AXIOM_CLASSES,
    AXIOM_PROPERTIES,
    CONTRADICTION,
    SUB,
    Compiled,
    compile_rules,
)
from semmap.knowledge.told_facts import (
    DIRECT_TYPE,
    KIND,
    Hierarchy,
    columns_of,
    fact_of,
    told_facts,
)
from semmap.knowledge.vocabulary import prefixes, short
from semmap.language.parser import parse_sparql

__all__ = ["Reasoned", "Why", "contradictions", "forget", "is_reasoned", "reason", "refresh", "why"]

MANY = 5_000
"""From so many changed entities on, all facts are read again."""
COLUMNS = "subject_id, subject, predicate, object_id, object, tag"


@dataclass(frozen=True)
class Reasoned:
    """What a run of the reasoner changed.

    Attributes
    ----------
    added, removed : numbers of inferences
    inferences, contradictions : how many there are now
    complete : all facts were read
    seconds : how long it took
    """

    added: int
    removed: int
    inferences: int
    contradictions: int
    complete: bool
    seconds: float


@dataclass(frozen=True)
class Why:
    """Why a fact is one, in words.

    Attributes
    ----------
    fact : as Turtle
    axiom : from which it follows; "" where it is told
    because : the facts that meet the axiom
    """

    fact: str
    axiom: str = ""
    because: tuple[Why, ...] = ()

    def lines(self, indent: str = "") -> Iterator[str]:
        """Yield the lines of a text."""
        yield f"{indent}{self.fact}{f', as {self.axiom}:' if self.axiom else ''}"
        for reason_ in self.because:
            yield from reason_.lines(f"{indent}  ")

    def as_json(self) -> dict[str, Any]:
        """Return what JSON writes."""
        because = [each.as_json() for each in self.because]
        return {"fact": self.fact, "axiom": self.axiom or None, "because": because}


def reason(session: Session, *, complete: bool = False, seconds: float | None = None) -> Reasoned:
    """Reason about the map that a session sees, from now on after each update, too.

    Parameters
    ----------
    complete : read all facts, even if only few changed
    seconds : after which it is stopped; by default the limit of `semmap.limits`

    Examples
    --------
    >>> reason(db.map("house").session_of_map()).contradictions  # doctest: +SKIP
    0
    """
    with limited(session, seconds) as deadline:
        view = MapView.of(session)
        view.deadline = deadline
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
    row = view.session.execute("SELECT FROM reasoning WHERE map_id = %s", (view.number,))
    return row.fetchone() is not None


def refresh(view: MapView, *, complete: bool = False) -> Reasoned | None:
    """Bring the inferences of a map up to date; None where it is not reasoned about."""
    start = time.perf_counter()
    row = view.session.execute(
        "SELECT axioms, cursor, at FROM reasoning WHERE map_id = %s FOR UPDATE", (view.number,)
    ).fetchone()
    if row is None:
        return None
    axioms, cursor, at = row
    ontology = _Ontology.read(view)
    changed = None
    if axioms == ontology.digest and not complete:
        changed = _Changed.since(view, cursor, at)
    row = view.session.execute(
        "SELECT change_cursor(), pg_current_xact_id()::text::bigint, statement_timestamp()"
    ).fetchone()
    assert row is not None
    news = _before_own(row[0], row[1]), row[2]
    if changed is None:
        facts = _from_scratch(view, ontology)
    else:
        facts = _changed_only(view, ontology, changed)
    done = facts.store()
    counts = _note(view, ontology, news, done)
    return Reasoned(
        sum(done.added.values()),
        done.removed,
        *counts,
        changed is None,
        time.perf_counter() - start,
    )


def _before_own(cursor: str, own: int) -> str:
    """Return a cursor before all changes of the current transaction: more of them may follow.

    Examples
    --------
    >>> _before_own("7:9:8", 7), _before_own("9:9:", 9)
    ('7:9:7,8', '9:9:')
    """
    lowest, end, running = cursor.split(":")
    if own >= int(end):
        return cursor
    open_ = sorted({own, *(int(each) for each in running.split(",") if each)})
    return f"{min(int(lowest), own)}:{end}:{','.join(map(str, open_))}"


def contradictions(session: Session) -> list[Why]:
    """Return what is inconsistent: which axiom, and which facts contradict it.

    Raises
    ------
    LookupError
        The map is not reasoned about.
    """
    with limited(session, None):
        view = _reasoned_view(session)
        facts, ontology = _reader(view)
        words = _Words(view)
        found = []
        for fact in facts.match(None, CONTRADICTION, None):
            bodies = {frozenset(body): body for _, body in ontology.rules.reasons(facts, fact)}
            for body in bodies.values():
                proofs = [Proof.of(facts, ontology.rules, each) for each in dict.fromkeys(body)]
                because = tuple(words.why(each) for each in proofs if each is not None)
                found.append(Why(words.node(fact[0]), words.node(fact[2]), because))
        return sorted(found, key=lambda each: (each.fact, each.axiom))


def why(session: Session, text: str) -> Why:
    """Return why a fact is one.

    Parameters
    ----------
    text : a triple, such as ``:cup1 a semmap:Mug``

    Raises
    ------
    QueryError
        The text is not a triple.
    LookupError
        It is not a fact, or the map is not reasoned about.
    """
    with limited(session, None):
        view = _reasoned_view(session)
        parsed = parse_sparql(f"ASK {{ {text} }}", "query", tuple(prefixes(view.name).items()))
        tree = parsed.algebra
        while tree.name in ("AskQuery", "Project"):
            tree = tree.p
        if getattr(tree, "name", "") != "BGP" or len(tree.triples) != 1:
            raise parsed.error("this is not one triple: give subject, property and object", 0)
        terms = tree.triples[0]
        if not all(isinstance(t, (rdflib.URIRef, rdflib.Literal)) for t in terms):
            raise parsed.error("a fact has no variables: give subject, property and object", 0)
        facts, ontology = _reader(view)
        words = _Words(view)
        constants = view.constants(terms)
        verb = constants.property(str(terms[1]))
        subject = _node(view, terms[0], constants)
        node = _node(view, terms[2], constants, as_type=verb == TYPE_OF)
        proof = Proof.of(facts, ontology.rules, (subject, verb, node))
        if proof is not None:
            return words.why(proof)
        if not view.run(view.statement(tree, [], 1)):
            raise LookupError(f"{text.strip()} is not a fact of the map {view.name}")
        return Why(words.fact((subject, verb, node)))


def _reasoned_view(session: Session) -> MapView:
    view = MapView.of(session)
    if not is_reasoned(view):
        raise LookupError(
            f"nothing is inferred from the map {view.name}: run semmap knowledge reason"
        )
    return view


def _reader(view: MapView) -> tuple[_MapFacts, Compiled]:
    ontology = _Ontology.read(view)
    return _MapFacts(view, ontology), ontology.compiled


# The ontology


@dataclass(frozen=True)
class _Ontology:
    digest: str
    hierarchy: Hierarchy
    compiled: Compiled

    @classmethod
    def read(cls, view: MapView) -> _Ontology:
        """Return the axioms of a map: of the T-Box and of its statements."""
        hierarchy = Hierarchy.read(view)
        rows = view.session.execute(
            f"SELECT {COLUMNS} FROM statement WHERE map_id = %(map)s AND graph = '' AND (until IS "
            "NULL OR until > statement_timestamp()) AND (predicate = ANY (%(properties)s) OR "
            "predicate = %(type)s AND tag = 'I' AND object = ANY (%(classes)s))",
            {
                "map": view.number,
                "properties": [*AXIOM_PROPERTIES, SAME_AS],
                "type": TYPE_OF,
                "classes": list(AXIOM_CLASSES),
            },
        ).fetchall()
        stated = {fact_of(row) for row in rows}
        same = any(fact[1] == SAME_AS for fact in stated)
        axioms = {fact for fact in stated if fact[1] != SAME_AS} | _shipped_axioms()
        parts = (hierarchy.digest, str(same), *sorted(map(repr, axioms)))
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest()
        if digest not in _COMPILED:
            closure = {(c, d) for c, above in hierarchy.supers.items() for d in above}
            compiled = compile_rules(
                axioms | {(c, SUB, d) for c, d in hierarchy.parents},
                _Words(view).node,
                built_in=frozenset(closure),
                single=is_mapped,
                same=same,
            )
            while len(_COMPILED) > 3:
                del _COMPILED[next(iter(_COMPILED))]
            _COMPILED[digest] = compiled
        return cls(digest, hierarchy, _COMPILED[digest])


_COMPILED: dict[str, Compiled] = {}


@cache
def _shipped_axioms() -> frozenset[Triple]:
    """Return the axioms of `schema/ontology/axioms.ttl`.

    The domains and ranges in `fields.ttl` are of what a field represents, not of its subjects.
    """
    (path,) = (path for path in ontology_files() if path.name == "axioms.ttl")
    graph = rdflib.Graph().parse(path, format="turtle")
    return frozenset((_shipped(s), _shipped(p), _shipped(o)) for s, p, o in graph)


def _shipped(term: Any) -> Node:
    text, tag = tag_and_text(term)
    return {"B": f"_:{text}", "I": text}.get(tag, (text, tag))


def _node(view: MapView, term: Any, constants: Constants, *, as_type: bool = False) -> Node:
    """Return a term of a text as rules have it."""
    text, tag = tag_and_text(term)
    if tag != "I":
        return text, tag
    form, key = constants.node(text, as_type=as_type)
    if form == "type":
        row = view.session.execute("SELECT type_iri(%s)", (key,)).fetchone()
        assert row is not None
        return str(row[0])
    return int(key) if form == "entity" else text


# The facts of a run


@dataclass(frozen=True)
class _Changed:
    """What changed: the ids of entities, and whether other facts did."""

    ids: frozenset[int]
    others: bool

    @classmethod
    def since(cls, view: MapView, cursor: str, at: Any) -> _Changed | None:
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


@dataclass
class _Stored:
    """What was written: the inferences that are new, by property and class, and others."""

    added: Counter[tuple[str, str | None]]
    removed: int
    clashes: int
    scratch: bool


class _MapFacts(Facts):
    """The facts of a map; of entities it is told the types, and those that subsume them.

    Parameters
    ----------
    scratch : all of them are added; else they are read from `inference` where they are needed
    """

    def __init__(self, view: MapView, ontology: _Ontology, *, scratch: bool = False) -> None:
        super().__init__()
        self._view, self._ontology, self._scratch = view, ontology, scratch
        self._before: dict[Triple, bool] = {}
        self._touched: dict[Triple, None] = {}
        self._seen: set[object] = set()
        self._classes_of: dict[frozenset[Node], frozenset[Node]] = {}

    # Reading

    def need_subject(self, subject: Node) -> None:
        if not self._scratch and subject not in self._seen:
            self.need_subjects([subject])

    def need_subjects(self, subjects: Iterable[Node]) -> None:
        """Read the facts of several subjects at once."""
        if self._scratch:
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
        keys = {("object", None, node), ("object", verb, node)}
        if self._scratch or keys & self._seen:
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
                    for c in self._ontology.hierarchy.subclasses(node)
                ],
                verbs=[DIRECT_TYPE, KIND],
            )

    def need_verb(self, verb: Node | None) -> None:
        if not self._scratch and ("verb", verb) not in self._seen:
            self._seen.add(("verb", verb))
            self._read("true" if verb is None else "predicate = %(verb)s", verb=verb)

    def read_old(self, changed: _Changed) -> set[Triple]:
        """Return the told facts as they were, of entities and others that changed."""
        return self._read(
            "(subject_id = ANY (%(ids)s) OR subject_id IS NOT NULL AND object_id = ANY (%(ids)s)"
            f"{' OR subject IS NOT NULL' if changed.others else ''}) AND told",
            ids=list(changed.ids),
        )

    def _read(self, condition: str, **values: Any) -> set[Triple]:
        found = set()
        with self._view.session.cursor() as cursor:
            sql = f"SELECT {COLUMNS}, told FROM inference WHERE map_id = %(map)s AND {condition}"
            values["map"] = self._view.number
            for row in cursor.execute(sql.encode(), values):
                fact = fact_of(row[:6])
                found.add(fact)
                if fact not in self._before:
                    self._before[fact] = row[6]
                    self._keep(fact, told=row[6])
        return found

    # Types

    def types_of(self, entity: Node) -> frozenset[Node]:
        """Return the classes that an entity is told to be of."""
        self.need_subject(entity)
        direct = self._objects.get((entity, DIRECT_TYPE), set())
        direct_types = frozenset(direct | self._objects.get((entity, KIND), set()))
        if direct_types not in self._classes_of:
            self._classes_of[direct_types] = self._ontology.hierarchy.of(direct_types)
        return self._classes_of[direct_types]

    def is_told(self, fact: Triple) -> bool:
        if fact in self._told:
            return True
        return fact[1] == TYPE_OF and isinstance(fact[0], int) and fact[2] in self.types_of(fact[0])

    def __contains__(self, fact: Triple) -> bool:
        return super().__contains__(fact) or self.is_told(fact)

    # Changing

    def add(self, fact: Triple, *, told: bool = False) -> None:
        self.need_subject(fact[0])
        self._touched[fact] = None
        self._keep(fact, told=told)

    def remove(self, fact: Triple) -> None:
        self.need_subject(fact[0])
        self._touched[fact] = None
        super().remove(fact)

    def untell(self, fact: Triple) -> None:
        self._touched[fact] = None
        super().untell(fact)

    def touch(self, fact: Triple) -> None:
        """Look at a fact again when the changes are stored."""
        self._touched[fact] = None

    def _keep(self, fact: Triple, *, told: bool) -> None:
        super().add(fact, told=told)
        if fact[1] in (DIRECT_TYPE, KIND):
            for c in self._ontology.hierarchy.of([fact[2]]) & self._ontology.compiled.classes:
                super().add((fact[0], TYPE_OF, c))

    def _state(self, fact: Triple) -> bool | None:
        """Return whether a fact is told; None where it has no row."""
        if fact in self._told:
            return True
        if self.is_told(fact) or not super().__contains__(fact):
            return None
        return False

    def store(self) -> _Stored:
        """Write what changed."""
        gone, come = [], []
        done = _Stored(Counter(), 0, 0, self._scratch)
        for fact in self._touched:
            before, after = self._before.get(fact), self._state(fact)
            if before is after:
                continue
            clash = fact[1] == CONTRADICTION
            if before is not None:
                gone.append(fact)
            if before is False:
                done.removed += 1
                done.clashes -= clash
            if after is not None:
                come.append((self._view.number, *columns_of(fact), after))
            if after is False:
                class_ = fact[2] if fact[1] == TYPE_OF and isinstance(fact[2], str) else None
                done.added[str(fact[1]), class_] += 1
                done.clashes += clash
        session = self._view.session
        if self._scratch:
            session.execute("DELETE FROM inference WHERE map_id = %s", (self._view.number,))
        with session.cursor() as cursor:
            for fact in gone:
                sql, values = _delete(self._view.number, fact)
                cursor.execute(sql, values)
            copy = f"COPY inference (map_id, {COLUMNS}, told) FROM STDIN"
            with cursor.copy(copy.encode()) as lines:
                for row in come:
                    lines.write_row(row)
        if self._scratch and len(come) > 1_000:
            session.execute("ANALYZE inference")  # skipped where another role owns the table
        return done


def _delete(number: int, fact: Triple) -> tuple[bytes, tuple[Any, ...]]:
    names = COLUMNS.split(", ")
    given = [(n, v) for n, v in zip(names, columns_of(fact), strict=True) if v is not None]
    where = " AND ".join(f"{name} = %s" for name, _ in given)
    sql = f"DELETE FROM inference WHERE map_id = %s AND {where}"
    return sql.encode(), (number, *(value for _, value in given))


def _from_scratch(view: MapView, ontology: _Ontology) -> _MapFacts:
    """Return all facts, closed."""
    facts = _MapFacts(view, ontology, scratch=True)
    compiled = ontology.compiled
    wanted = compiled.classes | compiled.heads
    for fact in told_facts(view, ontology.hierarchy, compiled.properties, wanted):
        facts.add(fact, told=True)
    start = list(facts.all())
    for fact in compiled.stated():
        facts.add(fact)
        start.append(fact)
    gc.disable()  # facts have no cycles, and looking for some takes long
    try:
        close(facts, compiled.rules, start)
    finally:
        gc.enable()
    return facts


def _changed_only(view: MapView, ontology: _Ontology, changed: _Changed) -> _MapFacts:
    """Return the facts that changed, and what they change."""
    facts, compiled = _MapFacts(view, ontology), ontology.compiled
    if not changed.ids and not changed.others:
        return facts
    wanted = compiled.classes | compiled.heads
    old = facts.read_old(changed)
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
    return facts


def _note(
    view: MapView, ontology: _Ontology, news: tuple[Any, Any], done: _Stored
) -> tuple[int, int]:
    """Write the state of the reasoner; return the numbers of inferences and contradictions."""
    properties = sorted({p for p, _ in done.added})
    classes = sorted({c for _, c in done.added if c is not None})
    merged = "ARRAY(SELECT DISTINCT unnest({0} || %({0})s::text[]) ORDER BY 1)"
    kept = "%({0})s::text[]" if done.scratch else merged
    start = "0" if done.scratch else "{}"
    row = view.session.execute(
        f"UPDATE reasoning SET axioms = %(axioms)s, cursor = %(cursor)s, at = %(at)s, "
        f"properties = {kept.format('properties')}, classes = {kept.format('classes')}, "
        f"inferences = {start.format('inferences')} + %(more)s, "
        f"contradictions = {start.format('contradictions')} + %(clashes)s "
        "WHERE map_id = %(map)s "
        "RETURNING inferences, contradictions".encode(),
        {
            "axioms": ontology.digest,
            "cursor": news[0],
            "at": news[1],
            "properties": properties,
            "classes": classes,
            "more": sum(done.added.values()) - done.removed,
            "clashes": done.clashes,
            "map": view.number,
        },
    ).fetchone()
    assert row is not None
    return row[0], row[1]


class _Words:
    """Terms and proofs as text, entities by their names."""

    def __init__(self, view: MapView) -> None:
        self._view, self._names = view, cache(self._name)
        self._prefixes = prefixes(view.name)

    def _name(self, entity: int) -> str:
        row = self._view.session.execute("SELECT entity_iri(%s)", (entity,)).fetchone()
        return f"entity {entity}" if row is None or row[0] is None else self.node(row[0])

    def node(self, node: Node) -> str:
        """Return a term; of a string, its text."""
        if isinstance(node, int):
            return str(self._names(node))
        if isinstance(node, str):
            return short(node, self._prefixes)
        return node[0]

    def fact(self, fact: Triple) -> str:
        """Return a triple as Turtle."""
        subject, verb, node = fact
        end = self.node(node)
        if isinstance(node, tuple):
            literal = term_of(*node)
            assert literal is not None
            end = literal.n3()
        return f"{self.node(subject)} {'a' if verb == TYPE_OF else self.node(verb)} {end}"

    def why(self, proof: Proof) -> Why:
        """Return a proof in words."""
        return Why(self.fact(proof.fact), proof.text, tuple(map(self.why, proof.reasons)))
