"""Standing queries on a map: what begins and ceases to be an answer when the map changes.

An index of triple patterns finds the parts of queries that a change concerns; only their solutions
with what changed are evaluated again, parts of one shape by one statement of SQL. These are Rete's
alpha memories, with the database as the memory of all joins.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, NamedTuple

import rdflib

from semmap.knowledge.facts import Fact
from semmap.knowledge.fields.properties import FieldError
from semmap.knowledge.map_view import MapView
from semmap.knowledge.mapping import is_mapped
from semmap.knowledge.queries import plain
from semmap.knowledge.sparql.constants import Constants, resolve
from semmap.knowledge.sparql.kept_queries import Row
from semmap.knowledge.sparql.scope import NOTHING_INFERRED
from semmap.knowledge.sparql.stored_terms import Term
from semmap.knowledge.standing.changes import Changes, Touched, ask
from semmap.knowledge.standing.evaluation import Evaluation, Job, Regions
from semmap.knowledge.standing.index import PatternIndex, Triples
from semmap.knowledge.standing.parts import (
    PartPattern,
    QueryPart,
    Solution,
)
from semmap.knowledge.standing.templates import (
    Filled,
    Node,
    Nodes,
    Template,
    TemplateShape,
    template_of,
)
from semmap.knowledge.standing.triples import TripleLists, has_all, joined, may_match
from semmap.knowledge.triple_map import Form
from semmap.knowledge.vocabulary import KNOWLEDGE_CORE, encode
from semmap.snake_case import local_name

MANY = 200  # more changed entities or statements than this, and all queries are evaluated again


class Difference(NamedTuple):
    """Answers of a query that ceased and began, or why it cannot be answered any more."""

    query: StandingQuery
    gone: list[Row]
    come: list[Row]
    error: Exception | None = None


@dataclass(eq=False)
class StandingQuery:
    """A query, its parts, and how many solutions of parts each answer has."""

    text: str
    template: Template
    filling: tuple[str, ...]
    names: tuple[str, ...]
    parts: list[QueryPart] = field(default_factory=list)
    counts: Counter[Row] = field(default_factory=Counter)

    @property
    def rows(self) -> frozenset[Row]:
        """The answers."""
        return frozenset(self.counts)


class StandingQueries:
    """The standing queries on one map."""

    def __init__(self) -> None:
        self.queries: dict[str, StandingQuery] = {}
        self._templates: dict[str, Template | None] = {}
        self._shapes: dict[Any, TemplateShape] = {}
        self._known: dict[str, Node] = {}
        self._types: dict[str, str] = {}
        self._resolved: dict[str, Nodes] = {}
        self._type_iris: dict[str, str] = {}
        self._foreign: set[str] = set()
        self._constants = Constants(
            self._known, self._types, self._type_iris, foreign=self._foreign
        )
        self._index = PatternIndex()
        self._lists = TripleLists()
        self._evaluation = Evaluation()
        self._named: dict[str, set[QueryPart]] = defaultdict(set)
        self._whole: set[QueryPart] = set()
        # by term at an end of a pattern: the solutions of each part with this term of a variable
        self._having: dict[Term, dict[tuple[QueryPart, str], set[Row]]] = defaultdict(dict)
        self._names: dict[int, str] = {}  # of entities that had another name
        self._inferred = NOTHING_INFERRED

    @property
    def ask_fields(self) -> bool:
        """Whether fields answer some of the queries."""
        return any(part.of_fields for part in list(self._whole))

    def add(self, view: MapView, texts: Iterable[str]) -> list[StandingQuery]:
        """Evaluate queries, and keep all or, if one is wrong, none; ValueError, KnowledgeError."""
        texts = list(texts)
        if not self.queries:
            self._inferred = view.inferred
        new: dict[str, StandingQuery] = {}
        for text in texts:
            if text not in self.queries and text not in new:
                new[text] = _query_of(text, *template_of(view, text, self._templates))
        try:
            self._compile(view, list(new.values()))
            jobs = [Job(part, ()) for found in new.values() for part in found.parts]
            for difference in self._evaluated(view, jobs, new.values()):
                if difference.error is not None:
                    raise difference.error
        except BaseException:
            for found in new.values():
                self._forget(found)
            raise
        self.queries |= new
        return [self.queries[text] for text in texts]

    def remove(self, found: StandingQuery) -> None:
        """Forget a query."""
        if self.queries.pop(found.text, None) is not None:
            self._forget(found)

    def _compile(self, view: MapView, queries: list[StandingQuery]) -> None:
        """Split queries into parts, and put their patterns into the index."""
        iris = [frozenset((*found.template.iris, *found.filling)) for found in queries]
        self._resolve(view, frozenset().union(*iris) - self._resolved.keys())
        for found, each in zip(queries, iris, strict=True):
            found.parts = self._parts(view, found, each)
            for part in found.parts:
                for iri in part.iris:
                    self._named[iri].add(part)
                if not part.patterns:
                    self._whole.add(part)
                self._index.insert(part)

    def _parts(self, view: MapView, found: StandingQuery, iris: frozenset[str]) -> list[QueryPart]:
        canonical = partial(self._canonical, view)
        template, filling = found.template, found.filling
        if filling and not any(map(self._constants.is_foreign, filling)):
            nodes = tuple(self._resolved[iri] for iri in filling)
            forms = tuple((node[0], as_class[0]) for node, as_class in nodes)
            constants = self._constants.only(template.iris)
            key = template.parsed.text.sparql, forms, constants.key, view.inferred
            if key not in self._shapes:
                self._shapes[key] = TemplateShape(view, template, constants, canonical, nodes)
            if not self._shapes[key].is_open:
                return self._shapes[key].filled(
                    found, iris, Filled(filling, nodes, canonical, constants.class_of)
                )
        if filling:
            template = Template(view.parsed(found.text), iris)
        shape = TemplateShape(view, template, self._constants.only(iris), canonical)
        return shape.filled(found, iris, None)

    def _forget(self, found: StandingQuery) -> None:
        for part in found.parts:
            for row in list(part.rows):
                self._remove(part, row)
            self._whole.discard(part)
            self._index.remove(part)
            for iri in part.iris:
                self._named[iri].discard(part)
        found.parts = []

    def _resolve(self, view: MapView, iris: Iterable[str]) -> list[str]:
        """Look up IRIs; return those that stand for another node than before."""
        wanted = set(iris)
        if not wanted:
            return []
        found = resolve(view.session, wanted, view.namespace, view.number)
        changed = [
            each for each in wanted if found.is_foreign(each) > self._constants.is_foreign(each)
        ]
        self._foreign |= found.foreign
        for iri in wanted:
            node, as_class = nodes = found.node(iri), found.node(iri, as_type=True)
            if self._resolved.get(iri, nodes) != nodes:
                changed.append(iri)
            self._resolved[iri] = nodes
            self._known.pop(iri, None)
            self._types.pop(iri, None)
            if node[0] != "iri":
                self._known[iri] = node
            if as_class[0] == "type":
                self._types[iri] = str(as_class[1])
        names = [name for name in self._types.values() if name not in self._type_iris]
        if names:
            rows = view.session.execute(
                "SELECT n, type_iri(n) FROM unnest(%s::text[]) n", (names,)
            ).fetchall()
            self._type_iris |= dict(rows)
        return changed

    def _canonical(self, view: MapView, term: Any, role: str) -> Term:
        """Return the term that solutions have for a term of the text."""
        if not isinstance(term, rdflib.URIRef):
            return plain(term)  # type: ignore[no-any-return]
        if role == "property":
            return rdflib.URIRef(self._constants.property(str(term)))
        form, key = self._constants.node(str(term), as_type=role == "class")
        if form == "type":
            return rdflib.URIRef(self._type_iris[key])
        if form == "entity" and not term.startswith(view.namespace):  # of KnowledgeCore's namespace
            return rdflib.URIRef(f"{view.namespace}{encode(local_name(str(term)))}")
        return plain(term)  # type: ignore[no-any-return]

    def update(self, view: MapView, changes: Changes) -> list[Difference]:
        """Return what begins and ceases to be an answer, by query."""
        many = max(len(changes.entities), len(changes.facts)) > MANY
        if changes.all or many or view.inferred != self._inferred:
            return self.update_all(view)
        ids = changes.every_id
        with view.session.pipeline():  # one message
            answers = ask(view, changes)
            facts = self._lists.ask(view, ids, self._index)
        touched = Touched(view, changes, answers)
        renamed = {n: touched.names[n] for n in touched.renamed}
        if not renamed.items() <= self._names.items():
            self._names |= renamed
            return self.update_all(view)
        again = self._renewed(view, touched)
        regions = Regions(part for found in again for part in found.parts)
        for part in self._whole:
            if _concerns(changes, part):
                regions.evaluate(part, {})
        if again:
            facts = self._lists.ask(view, ids, self._index)
        known = self._lists.of(view, touched, facts, self._index, self._constants)
        self._of_entities(touched, known, regions)
        for quad, alive in touched.quads.items():
            if alive:
                self._of_new_fact(quad, touched, known, regions)
            else:
                self._of_ended_fact(quad, regions)
        return self._evaluated(view, list(regions.jobs), again, regions, touched.nodes)

    def update_all(self, view: MapView) -> list[Difference]:
        """Evaluate all queries again, as after the server was away."""
        for kept in (self._known, self._types, self._resolved, self._type_iris, self._shapes):
            kept.clear()
        self._foreign.clear()
        self._inferred = view.inferred
        found = list(self.queries.values())
        self._compile_again(view, found)
        jobs = [Job(part, ()) for each in found for part in each.parts]
        return self._evaluated(view, jobs, found)

    def _renewed(self, view: MapView, touched: Touched) -> list[StandingQuery]:
        """Compile the queries again whose constants stand for other nodes now."""
        iris = {str(node) for node in touched.changed}
        iris |= {space + name for name in touched.every_name for space in KNOWLEDGE_CORE}
        mine = [iri for iri in iris & self._resolved.keys() if self._may_differ(iri, touched)]
        mine += self._new_foreign(touched)
        stale = {
            part.query for iri in self._resolve(view, mine) for part in self._named.get(iri, ())
        }
        self._compile_again(view, list(stale))
        return list(stale)

    def _new_foreign(self, touched: Touched) -> list[str]:
        """Return IRIs of properties and classes of the map of which statements may be the first."""
        new = {
            str(quad.object if quad.property == rdflib.RDF.type else quad.property)
            for quad in touched.quads
            if quad.graph is None
            and (quad.property == rdflib.RDF.type or is_mapped(str(quad.property)))
        } - self._foreign
        return [iri for iri in self._resolved if new and self._constants.stated_as(iri) in new]

    def _may_differ(self, iri: str, touched: Touched) -> bool:
        """Return whether an IRI may stand for another node than before, which did not just move."""
        node = rdflib.URIRef(iri)
        if not iri.startswith(touched.namespace):
            node = rdflib.URIRef(f"{touched.namespace}{encode(local_name(iri))}")
        return self._resolved[iri][0] != touched.nodes.get(node)

    def _compile_again(self, view: MapView, queries: list[StandingQuery]) -> None:
        for found in queries:
            self._forget(found)
        self._compile(view, queries)

    def _of_entities(self, touched: Touched, known: Triples, regions: Regions) -> None:
        met: set[tuple[QueryPart, str, Term]] = set()
        for (_, side, term), quads in known.items():
            form = touched.changed.get(term)
            if form is None:
                continue
            for quad in quads:
                for part, name, number in self._index.keyed(quad, side, form):
                    if (part, name, term) in met:
                        continue
                    pattern = part.patterns[number]
                    if pattern.match(quad) is None:
                        continue
                    met.add((part, name, term))
                    if has_all(part, name, form, term, known):
                        left = range(len(part.patterns))
                        self._find(part, {name: term}, left, known, touched, regions)
                    elif (part, name) in self._having.get(term, ()):
                        regions.known_as(part, {name: term}, [])
        for node, form in touched.changed.items():
            for part in self._index.fixed.get(node, ()):
                regions.evaluate(part, {})
            for part, name in self._having.get(node, ()):
                if (part, name, node) not in met and (
                    (name, form) in part.keyed or node not in touched.nodes
                ):
                    regions.known_as(part, {name: node}, [])
            if node in touched.nodes and form == "entity":
                for part in self._index.unlisted:
                    for name in part.unlisted:
                        if (name, form) not in part.keyed:
                            regions.evaluate(part, {name: node})

    def _of_new_fact(self, quad: Fact, touched: Touched, known: Triples, regions: Regions) -> None:
        match = cache(partial(PartPattern.match, quad=quad))  # many parts have one pattern
        for part, number in self._index.stated(quad, known, touched.nodes):
            pattern = part.patterns[number]
            solution = match(pattern)
            if solution is None:
                continue
            holds = part.holds(solution) if part.is_fact else None
            if holds is not None:
                regions.single_as(part, _row(part, solution), holds)
            elif len(part.patterns) > 1 and not may_match(part, number, solution, known, touched):
                if self._former(part, solution.items()):
                    regions.known_as(part, solution, [])
            else:
                others = (n for n in range(len(part.patterns)) if n != number)
                self._find(part, solution, others, known, touched, regions)

    def _find(
        self,
        part: QueryPart,
        region: Solution,
        left: Iterable[int],
        known: Triples,
        touched: Touched,
        regions: Regions,
    ) -> None:
        """Find the solutions with some terms; the patterns `left` are not known to match."""
        found = None
        if part.plain:
            found = joined(part, region, left, known, touched, self._index)
        if found is None:
            regions.evaluate(part, region)
        else:
            regions.known_as(part, region, found)

    def _of_ended_fact(self, quad: Fact, regions: Regions) -> None:
        """Find the solutions that there are with a statement that ended."""
        ends = (quad.subject, quad.object)
        parts = {part for term in ends for part, _ in self._having.get(term, ())}
        members = [(part, n) for part in parts for n in range(len(part.patterns))]
        match = cache(partial(PartPattern.match, quad=quad))  # many parts have one pattern
        for part, number in {*members, *self._index.ground(quad)}:
            pattern = part.patterns[number]
            solution = match(pattern) if pattern.stated else None
            if solution is None:
                continue
            if part.is_fact:
                regions.single_as(part, _row(part, solution), False)
            elif not self._former(part, solution.items()):
                continue
            elif pattern.keys or not pattern.exact:
                regions.evaluate(part, solution)  # it may be true by other rows, too
            else:
                regions.known_as(part, solution, [])

    def _evaluated(
        self,
        view: MapView,
        jobs: list[Job],
        again: Iterable[StandingQuery] = (),
        known: Regions | None = None,
        nodes: Mapping[Term, tuple[Form, int]] | None = None,
    ) -> list[Difference]:
        """Return the differences that the solutions of some parts make now.

        The database evaluates jobs, whose terms may be `nodes`; others are known. Of queries that
        are evaluated again, former solutions are forgotten: only their answers are compared.
        """
        known = known or Regions(())
        deltas: defaultdict[StandingQuery, dict[Row, int]] = defaultdict(dict)
        for found in again:
            deltas[found] = {row: -n for row, n in found.counts.items()}
        errors: dict[StandingQuery, Exception] = {}
        answers = self._evaluation.answers(view, jobs, nodes or {}, errors)
        # Fields state no more what these ask, such as a source that ended.
        unknown = {
            found
            for found, error in errors.items()
            if found.text in self.queries and isinstance(error.__cause__, FieldError)
        }
        for found in unknown:
            del errors[found]
        answers |= {job: set() for job in jobs if job.part.query in unknown}
        for (part, row), holds in known.single.items():
            if holds is not (row in part.rows):
                self._change(part, row, holds, deltas[part.query])
        for job, now in {**known.known, **answers}.items():
            part = job.part
            former = self._former(part, job.solution)
            for row in former ^ now:
                self._change(part, row, row in now, deltas[part.query])
        differences = [Difference(found, [], [], error) for found, error in errors.items()]
        for found, delta in deltas.items():
            if found in errors:
                continue
            gone, come = [], []
            for row, n in delta.items():
                before = found.counts.pop(row, 0)
                if before + n:
                    found.counts[row] = before + n
                if before and not before + n:
                    gone.append(row)
                elif n and not before:
                    come.append(row)
            differences.append(Difference(found, gone, come))
        return differences

    def _former(self, part: QueryPart, solution: Iterable[tuple[str, Term]]) -> set[Row]:
        """Return the known solutions of a part with some terms."""
        if not part.rows:
            return set()
        found: Iterable[Row] = part.rows
        wanted = list(solution)
        for name, term in wanted:
            if name in part.ends:
                found = self._having.get(term, {}).get((part, name), ())
                break
        places = [(part.names.index(name), term) for name, term in wanted]
        return {row for row in found if all(row[i] is t or row[i] == t for i, t in places)}

    def _change(self, part: QueryPart, row: Row, holds: bool, delta: dict[Row, int]) -> None:
        """Add or remove a solution of a part, and count it among the answers of its query."""
        shown = part.shown(row)
        if holds:
            delta[shown] = delta.get(shown, 0) + 1
            part.rows.add(row)
            for i, name in part.indexed:
                having, key = self._having[row[i]], (part, name)  # type: ignore[index]
                if key in having:
                    having[key].add(row)
                else:
                    having[key] = {row}
        else:
            delta[shown] = delta.get(shown, 0) - 1
            self._remove(part, row)

    def _remove(self, part: QueryPart, row: Row) -> None:
        part.rows.remove(row)
        for i, name in part.indexed:
            having, key = self._having[row[i]], (part, name)  # type: ignore[index]
            rows = having[key]
            rows.discard(row)
            if not rows:
                del having[key]
                if not having:
                    del self._having[row[i]]  # type: ignore[arg-type]


def _row(part: QueryPart, solution: Solution) -> Row:
    return tuple(map(solution.__getitem__, part.names))


def _query_of(text: str, template: Template, filling: tuple[str, ...]) -> StandingQuery:
    parsed = template.parsed
    if parsed.form not in ("SelectQuery", "AskQuery"):
        form = parsed.form.removesuffix("Query").upper()
        raise ValueError(f"{form} has no answers to follow: use SELECT or ASK")
    names = parsed.names if parsed.form == "SelectQuery" else ()
    return StandingQuery(text, template, filling, tuple(map(str, names)))


def _concerns(changes: Changes, part: QueryPart) -> bool:
    if changes.removed or ((changes.others or changes.entities) and part.of_tables):
        return True
    if changes.fields and part.of_fields:
        return True
    if part.properties is None:
        return bool(changes.facts)
    return any(fact[2] in part.properties for fact in changes.facts)
