"""Standing queries on a map: what begins and ceases to be an answer when the map changes.

An index of triple patterns finds the parts of queries that a change concerns; only their solutions
with the changed entity or statement are evaluated again. Parts of the same shape are evaluated by
one statement of SQL. The method is that of Rete's alpha memories, with the database as the memory
of all joins.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import psycopg
import rdflib
from rdflib.paths import MulPath, NegatedPath, Path
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.constants import Constants, iris_in, resolve, tag_and_text
from semmap.knowledge.expressions import UntranslatedError
from semmap.knowledge.map_view import MapView, Row, Term, term_of
from semmap.knowledge.mapping import COMPUTED, NODES, STATEMENTS, TOPOLOGICAL
from semmap.knowledge.queries import Answer, KnowledgeError, errors_of, limited, plain, query
from semmap.knowledge.standing_parts import (
    Part,
    Pattern,
    Quad,
    Solution,
    is_variable,
    name_of_variable,
    split,
)
from semmap.knowledge.translator import GIVEN, Statement, translate_each
from semmap.knowledge.triple_map import Form
from semmap.knowledge.triples import TriplePatterns
from semmap.knowledge.vocabulary import GEO, KNOWLEDGE_CORE, SEMMAP, encode, prefixes
from semmap.language.parser import ParsedText, parse_sparql
from semmap.language.terms import local_name

__all__ = ["Changes", "Difference", "StandingQueries", "StandingQuery"]

MANY = 200
"""More changed entities or statements than this, and all queries are evaluated again."""

_PARAMETER = re.compile(r"%\((\w+)\)s::(\w+)")
_COSTLY = frozenset(c.property for c in COMPUTED) | {f"{GEO}{name}" for name in TOPOLOGICAL}
"""Properties that are computed: they are listed for changed entities only."""
_OF_MAP = {form: node.prefix for form, node in NODES.items() if node.of_map}


class Changes(NamedTuple):
    """What changed.

    Attributes
    ----------
    entities : ids of the entities of which rows of tables changed
    facts : the statements that were added, removed, or ended, as the table `change` has them
    others : something else changed that only queries as a whole can depend on, such as a belief
    all : anything may have changed
    """

    entities: frozenset[int] = frozenset()
    facts: tuple[tuple[Any, ...], ...] = ()
    others: bool = False
    all: bool = False


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
    parsed: ParsedText
    names: tuple[str, ...]
    parts: list[Part] = field(default_factory=list)
    counts: Counter[Row] = field(default_factory=Counter)

    @property
    def rows(self) -> frozenset[Row]:
        """The answers."""
        return frozenset(self.counts)


class _Job(NamedTuple):
    """The solutions of a part with some terms are to be evaluated."""

    part: Part
    solution: tuple[tuple[str, Term], ...]

    @property
    def given(self) -> list[tuple[str, Term]]:
        """The terms that the database is given: those at the ends of patterns."""
        return [each for each in self.solution if each[0] in self.part.ends]


_Triples = defaultdict[tuple[str, int, Term], list[Quad]]
"""Triples by property, and side and term of their key."""


class StandingQueries:
    """The standing queries on one map."""

    def __init__(self) -> None:
        self.queries: dict[str, StandingQuery] = {}
        self._constants = Constants({})
        self._known: dict[str, tuple[Any, ...]] = {}
        self._type_iris: dict[str, str] = {}
        self._patterns: dict[tuple[Any, ...], dict[tuple[Part, int], Pattern]] = defaultdict(dict)
        self._unlisted: set[Part] = set()
        self._fixed: dict[Term, set[Part]] = defaultdict(set)
        self._named: dict[str, set[Part]] = defaultdict(set)
        self._whole: set[Part] = set()
        self._having: dict[Term, dict[tuple[Part, str], int]] = defaultdict(dict)
        self._listed: Counter[tuple[str, int, Form]] = Counter()
        self._statements: dict[tuple[Part, Any], Statement | None] = {}
        self._lists: tuple[Any, str, dict[str, Any]] = ((), "", {})
        self._names: dict[int, str] = {}  # of entities that had another name
        self._nodes: Mapping[Term, tuple[Form, int]] = {}

    # Queries come and go

    def add(self, view: MapView, text: str) -> StandingQuery:
        """Evaluate a query, and keep it.

        Raises
        ------
        QueryError, KnowledgeError
            As of `semmap.knowledge.query`.
        ValueError
            It is neither SELECT nor ASK.
        """
        if text in self.queries:
            return self.queries[text]
        parsed = parse_sparql(text, "query", tuple(prefixes(view.name).items()))
        if parsed.form not in ("SelectQuery", "AskQuery"):
            form = parsed.form.removesuffix("Query").upper()
            raise ValueError(f"{form} has no answers to follow: use SELECT or ASK")
        names = tuple(map(str, parsed.names)) if parsed.form == "SelectQuery" else ()
        found = StandingQuery(text, parsed, names)
        self._compile(view, found)
        try:
            (difference,) = self._evaluated(view, [_Job(part, ()) for part in found.parts], [found])
        except BaseException:
            self._forget(found)
            raise
        if difference.error is not None:
            self._forget(found)
            raise difference.error
        self.queries[text] = found
        return found

    def remove(self, found: StandingQuery) -> None:
        """Forget a query."""
        if self.queries.pop(found.text, None) is not None:
            self._forget(found)

    def _compile(self, view: MapView, found: StandingQuery) -> None:
        """Split a query into parts, and put their patterns into the index."""
        iris = frozenset(iris_in(found.parsed.algebra))
        self._resolve(view, iris - self._known.keys())
        translator = TriplePatterns(self._constants, view.namespace, view.number)
        try:
            parts = (
                None
                if found.parsed.dataset
                else split(
                    found.parsed.algebra,
                    found.names,
                    translator.sources,
                    lambda term, role: self._canonical(view, term, role),
                )
            )
        except UntranslatedError:
            parts = None
        if parts is None:
            parts = [
                Part(
                    found.parsed.algebra,
                    found.names,
                    [],
                    projected=tuple(range(len(found.names))),
                    properties=_properties(found.parsed.algebra, self._constants),
                    of_tables=_has_tables(found.parsed.algebra, translator),
                )
            ]
        found.parts = parts
        for part in parts:
            part.query, part.iris = found, iris
            self._insert(part)

    def _insert(self, part: Part) -> None:
        for iri in part.iris:
            self._named[iri].add(part)
        if not part.patterns:
            self._whole.add(part)
        for number, pattern in enumerate(part.patterns):
            self._patterns[pattern.index_key][part, number] = pattern
            verb = str(pattern.terms[1])
            if pattern.listed:
                self._listed.update((verb, side, form) for side, form in pattern.keys)
            for side, _ in pattern.keys:
                if not is_variable(pattern.terms[side]):
                    self._fixed[pattern.terms[side]].add(part)
        if part.unlisted:
            self._unlisted.add(part)

    def _forget(self, found: StandingQuery) -> None:
        for part in found.parts:
            for row in list(part.rows):
                self._remove(part, row)
            self._whole.discard(part)
            self._unlisted.discard(part)
            fixed: set[Term] = set()
            for number, pattern in enumerate(part.patterns):
                self._patterns[pattern.index_key].pop((part, number), None)
                if not self._patterns[pattern.index_key]:
                    del self._patterns[pattern.index_key]
                fixed |= {term for term in pattern.terms if not is_variable(term)}
                if pattern.listed:
                    verb = str(pattern.terms[1])
                    self._listed -= Counter((verb, side, form) for side, form in pattern.keys)
            for term in fixed:
                self._fixed[term].discard(part)
            for iri in part.iris:
                self._named[iri].discard(part)
            self._statements = {k: s for k, s in self._statements.items() if k[0] is not part}
        found.parts = []

    # Terms

    def _resolve(self, view: MapView, iris: Iterable[str]) -> list[str]:
        """Look up IRIs; return those that stand for another node than before."""
        wanted = set(iris)
        if not wanted:
            return []
        found = resolve(view.session, wanted, view.namespace)
        changed = []
        for iri in wanted:
            nodes = (found.node(iri), found.node(iri, as_type=True))
            if self._known.get(iri, nodes) != nodes:
                changed.append(iri)
            self._known[iri] = nodes
        known = {iri: node for iri, (node, _) in self._known.items() if node[0] != "iri"}
        types = {
            iri: str(of_type[1])
            for iri, (_, of_type) in self._known.items()
            if of_type[0] == "type"
        }
        self._constants = Constants(known, types)
        names = [name for name in types.values() if name not in self._type_iris]
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

    # Changes

    def update(self, view: MapView, changes: Changes) -> list[Difference]:
        """Return what begins and ceases to be an answer, by query."""
        if changes.all or max(len(changes.entities), len(changes.facts)) > MANY:
            return self.update_all(view)
        touched = _Touched(view, changes)
        renamed = {n: touched.names[n] for n in touched.renamed}
        if not renamed.items() <= self._names.items():
            self._names |= renamed
            return self.update_all(view)
        again = self._renewed(view, touched)
        regions = _Regions(part for found in again for part in found.parts)
        for part in self._whole:
            if _concerns(part, changes):
                regions.evaluate(part, {})
        known = self._listed_triples(view, touched)
        self._of_entities(touched, known, regions)
        self._of_facts(touched, known, regions)
        self._nodes = touched.nodes
        return self._evaluated(view, list(regions.jobs), again, regions.known)

    def update_all(self, view: MapView) -> list[Difference]:
        """Evaluate all queries again, as after the server was away."""
        self._known.clear()
        self._type_iris.clear()
        found = list(self.queries.values())
        for each in found:
            self._compile_again(view, each)
        jobs = [_Job(part, ()) for each in found for part in each.parts]
        return self._evaluated(view, jobs, found)

    def _renewed(self, view: MapView, touched: _Touched) -> list[StandingQuery]:
        """Compile the queries again whose constants stand for other nodes now."""
        iris = {str(node) for node in touched.changed}
        iris |= {space + name for name in touched.every_name for space in KNOWLEDGE_CORE}
        mine = [iri for iri in iris if iri in self._known]
        stale = {
            part.query for iri in self._resolve(view, mine) for part in self._named.get(iri, ())
        }
        for found in stale:
            self._compile_again(view, found)
        return list(stale)

    def _compile_again(self, view: MapView, found: StandingQuery) -> None:
        self._forget(found)
        self._compile(view, found)

    def _listed_triples(self, view: MapView, touched: _Touched) -> _Triples:
        """Return what is true of the touched entities, of all properties that patterns have."""
        known: _Triples = defaultdict(list)
        keys = tuple(sorted(self._listed))
        if not keys or not touched.names:
            return known
        if self._lists[0] != keys:
            self._lists = keys, *self._list(view, keys)
        _, sql, values = self._lists
        changed = [number for number in touched.names if number in touched.ids]
        rows = view.session.execute(
            sql.encode(), {**values, "ids": list(touched.names), "changed": changed}
        ).fetchall()
        for k, number, text, tag in rows:
            verb, side, form = keys[k]
            term, other = touched.node(number, form), term_of(text, tag)
            if other is not None:
                ends = (term, other) if side == 0 else (other, term)
                known[verb, side, term].append(Quad(ends[0], rdflib.URIRef(verb), ends[1]))
        return known

    def _list(
        self, view: MapView, keys: tuple[tuple[str, int, Form], ...]
    ) -> tuple[str, dict[str, Any]]:
        """Return the statement that lists the triples of entities, and its parameters."""
        parts: list[str] = []
        values: dict[str, Any] = {}
        for i, (verb, side, form) in enumerate(keys):
            ends = ("key", "other") if side == 0 else ("other", "key")
            triple = (rdflib.Variable(ends[0]), rdflib.URIRef(verb), rdflib.Variable(ends[1]))
            statement = translate_each(
                CompValue("BGP", triples=[triple]),
                ("other",),
                Constants({}),
                view.namespace,
                view.number,
                {"key": form},
            )
            ids = f"%({'changed' if verb in _COSTLY else 'ids'})s::bigint[]"
            sql = statement.sql.replace("%(", f"%(k{i}")
            sql = sql.replace(GIVEN, f"unnest({ids}, {ids}) AS p (n, s0)")
            parts.append(f"SELECT {i}, q.* FROM ({sql}) q")
            values |= {f"k{i}{name}": value for name, value in statement.parameters.items()}
        return " UNION ALL ".join(parts), values

    # Which solutions changes concern

    def _of_entities(self, touched: _Touched, known: _Triples, regions: _Regions) -> None:
        """Find the solutions with nodes of changed entities."""
        hits: dict[tuple[Part, str, Term], dict[int, list[Solution]]] = defaultdict(dict)
        for (_, side, term), quads in known.items():
            form = touched.changed.get(term)
            if form is None:
                continue
            for quad in quads:
                for part, number, pattern in self._matching(quad):
                    end = pattern.terms[side]
                    if (side, form) in pattern.keys and is_variable(end):
                        solution = pattern.match(quad)
                        if solution is not None:
                            found = hits[part, name_of_variable(end), term]
                            found.setdefault(number, []).append(solution)
        for node, form in touched.changed.items():
            for part in self._fixed.get(node, ()):
                regions.evaluate(part, {})
            for part, name in self._having.get(node, ()):
                if (name, form) in part.keyed or node not in touched.nodes:
                    hits.setdefault((part, name, node), {})
            if node in touched.nodes and form == "entity":
                for part in self._unlisted:
                    for name in part.unlisted:
                        hits.setdefault((part, name, node), {})
        for (part, name, term), found in hits.items():
            needed = part.keyed.get((name, touched.changed[term]), ())
            if len(found) < len(needed):
                regions.known_as(part, {name: term}, [])
            elif part.direct and found:
                solutions = [each for some in found.values() for each in some]
                regions.known_as(part, {name: term}, solutions)
            else:
                regions.evaluate(part, {name: term})

    def _of_facts(self, touched: _Touched, known: _Triples, regions: _Regions) -> None:
        """Find the solutions with changed statements."""
        for quad, alive in touched.quads.items():
            for part, number, pattern in self._matching(quad):
                solution = pattern.match(quad) if pattern.stated else None
                if solution is None:
                    continue
                if pattern.keys or not pattern.exact:
                    regions.evaluate(part, solution)  # it may be true by other rows, too
                elif not alive or not _may_match(part, number, solution, known, touched):
                    regions.known_as(part, solution, [])
                elif part.direct:
                    regions.known_as(part, solution, [solution])
                else:
                    regions.evaluate(part, solution)

    def _matching(self, quad: Quad) -> Iterator[tuple[Part, int, Pattern]]:
        for verb in (quad.property, None):
            for subject in (quad.subject, None):
                for object_ in (quad.object, None):
                    found = self._patterns.get((verb, subject, object_))
                    if found:
                        for (part, number), pattern in list(found.items()):
                            yield part, number, pattern

    # Evaluation

    def _evaluated(
        self,
        view: MapView,
        jobs: list[_Job],
        again: Iterable[StandingQuery] = (),
        known: Mapping[_Job, set[Row]] | None = None,
    ) -> list[Difference]:
        """Return the differences that the solutions of some parts make now.

        Parameters
        ----------
        jobs : evaluated by the database
        again : queries whose former solutions are forgotten: only their answers are compared
        known : solutions that are known already
        """
        deltas: dict[StandingQuery, Counter[Row]] = {}
        for found in again:
            deltas[found] = Counter({row: -n for row, n in found.counts.items()})
        errors: dict[StandingQuery, Exception] = {}
        results = {**(known or {}), **self._answers(view, jobs, errors)}
        for job, now in results.items():
            delta = deltas.setdefault(job.part.query, Counter())
            former = job.part.having(dict(job.solution))
            for row in former - now:
                self._remove(job.part, row)
                delta[job.part.shown(row)] -= 1
            for row in now - former:
                self._add(job.part, row)
                delta[job.part.shown(row)] += 1
        differences = [Difference(found, [], [], error) for found, error in errors.items()]
        for found, delta in deltas.items():
            if found in errors:
                continue
            gone, come = [], []
            for row, n in delta.items():
                before = found.counts[row]
                found.counts[row] = before + n
                if not found.counts[row]:
                    del found.counts[row]
                if before and not before + n:
                    gone.append(row)
                elif n and not before:
                    come.append(row)
            differences.append(Difference(found, gone, come))
        return differences

    def _answers(
        self, view: MapView, jobs: list[_Job], errors: dict[StandingQuery, Exception]
    ) -> dict[_Job, set[Row]]:
        """Return the solutions of parts; those of one shape by one statement."""
        groups: dict[Any, list[tuple[_Job, Statement]]] = defaultdict(list)
        alone = []
        for job in jobs:
            statement = self._statement(view, job)
            if statement is None:
                alone.append(job)
            else:
                forms = tuple(form for _, form in self._given(job))
                groups[statement.sql, forms].append((job, statement))
        found: dict[_Job, set[Row]] = {}
        try:
            if groups:
                with limited(view.session, None):
                    for group in groups.values():
                        found |= self._run(view, group)
        except (psycopg.DataError, psycopg.ProgrammingError, KnowledgeError):
            alone, found = jobs, {}  # each by itself, to find the one that fails
        for job in alone:
            try:
                found[job] = self._alone(view, job)
            except (ValueError, LookupError, psycopg.DataError) as error:
                errors[job.part.query] = error
        return found

    def _alone(self, view: MapView, job: _Job) -> set[Row]:
        statement = self._statement(view, job)
        if statement is None:
            return _rows(query(view.session, job.part.query.text))
        with limited(view.session, None), errors_of(job.part.query.parsed):
            return self._run(view, [(job, statement)])[job]

    def _statement(self, view: MapView, job: _Job) -> Statement | None:
        """Return the statement of a job without its values; None if it has no translation."""
        if job.part.query.parsed.dataset:
            return None
        given = dict(self._given(job))
        key = (job.part, tuple(given.items()))
        if key not in self._statements:
            try:
                self._statements[key] = translate_each(
                    job.part.tree,
                    job.part.names,
                    self._constants,
                    view.namespace,
                    view.number,
                    given,
                )
            except UntranslatedError:
                self._statements[key] = None
        return self._statements[key]

    def _given(self, job: _Job) -> list[tuple[str, Form]]:
        return [(name, self._nodes.get(t, (_form(t), 0))[0]) for name, t in job.given]

    def _run(self, view: MapView, group: list[tuple[_Job, Statement]]) -> dict[_Job, set[Row]]:
        """Run the statement of jobs of one shape, with their values as columns."""
        statement = group[0][1]
        columns: dict[str, tuple[str, list[Any]]] = {"n": ("int", list(range(len(group))))}
        for i, (_, term) in enumerate(group[0][0].given):
            nodes = [self._nodes.get(job.given[i][1]) for job, _ in group]
            if nodes[0] is not None:
                columns[f"s{i}"] = ("bigint", [node[1] for node in nodes if node])
            else:
                terms = [tag_and_text(job.given[i][1]) for job, _ in group]
                columns[f"s{i}"] = ("text", [text for text, _ in terms])
                if _form(term) == "term":
                    columns[f"t{i}"] = ("text", [tag for _, tag in terms])
        values: dict[str, Any] = {}
        varying: set[str] = set()
        types = dict(_PARAMETER.findall(statement.sql))
        for name, value in statement.parameters.items():
            each = [other.parameters[name] for _, other in group]
            if all(type(other) is type(value) and other == value for other in each):
                values[name] = value
            elif name in types:
                varying.add(name)
                columns[name] = (types[name], each)
        sql = _PARAMETER.sub(
            lambda found: f"p.{found[1]}" if found[1] in varying else found[0], statement.sql
        )
        arrays = ", ".join(f"%(given_{name})s::{kind}[]" for name, (kind, _) in columns.items())
        sql = sql.replace(GIVEN, f"unnest({arrays}) AS p ({', '.join(columns)})")
        values |= {f"given_{name}": each for name, (_, each) in columns.items()}
        found: dict[_Job, set[Row]] = {job: set() for job, _ in group}
        width = range(len(statement.names))
        for n, *row in view.session.execute(sql.encode(), values).fetchall():
            job = group[n][0]
            solution: Row = tuple(term_of(row[2 * i], row[2 * i + 1]) for i in width)
            if all(solution[job.part.names.index(name)] == t for name, t in job.solution):
                found[job].add(solution)
        return found

    def _add(self, part: Part, row: Row) -> None:
        part.add(row)
        for name, term in part.terms(row):
            counts = self._having[term]
            counts[part, name] = counts.get((part, name), 0) + 1

    def _remove(self, part: Part, row: Row) -> None:
        part.remove(row)
        for name, term in part.terms(row):
            counts = self._having[term]
            counts[part, name] -= 1
            if not counts[part, name]:
                del counts[part, name]
                if not counts:
                    del self._having[term]


class _Touched:
    """The entities and statements that changes are about.

    Attributes
    ----------
    ids : of the changed entities
    names : of the entities that there are, by id: the changed ones, and those of statements
    every_name : names that changed entities have or had
    renamed : ids of changed entities that had another name
    changed : the nodes of changed entities, with their forms; under former names, too
    nodes : the nodes that there are, with form and id
    quads : the statements, and whether they hold now
    """

    def __init__(self, view: MapView, changes: Changes) -> None:
        self._namespace = view.namespace
        self.ids = changes.entities
        numbers = {n for f in changes.facts for n in (f[1], f[3] if f[4] is None else None)}
        every = sorted(self.ids | {n for n in numbers if isinstance(n, int)})
        rows = view.session.execute(
            "SELECT id, name, true FROM entity WHERE id = ANY (%(ids)s) AND map_id = %(map)s "
            "UNION ALL SELECT DISTINCT entity_id, name, false FROM entity_history "
            "WHERE entity_id = ANY (%(ids)s) AND map_id = %(map)s",
            {"ids": every, "map": view.number},
        ).fetchall()
        self.names: dict[int, str] = {number: name for number, name, now in rows if now}
        former = {(number, name) for number, name, now in rows if not now}
        former -= set(self.names.items())
        self.every_name = {name for number, name, _ in rows if number in self.ids}
        self.renamed = {n for n, _ in former if n in self.names and n in self.ids}
        self.changed: dict[Term, Form] = {}
        self.nodes: dict[Term, tuple[Form, int]] = {}
        for number, name in {*former, *self.names.items()}:
            for form in _OF_MAP:
                node = self._iri(name, form)
                if number in self.ids:
                    self.changed[node] = form
                if self.names.get(number) == name:
                    self.nodes[node] = (form, number)
        last = {**dict(former), **self.names}
        self.quads: dict[Quad, bool] = {}
        for fact, alive in zip(changes.facts, _alive(view, changes.facts), strict=True):
            quad = self._quad(fact, last)
            if quad is not None:
                self.quads[quad] = alive or self.quads.get(quad, False)

    def node(self, number: int, form: Form) -> Term:
        """Return the IRI of a node of an entity."""
        return self._iri(self.names[number], form)

    def _iri(self, name: str, form: Form) -> Term:
        return rdflib.URIRef(f"{self._namespace}{_OF_MAP[form]}{encode(name)}")

    def _quad(self, fact: tuple[Any, ...], names: Mapping[int, str]) -> Quad | None:
        graph, subject, verb, object_, tag = fact
        ends: list[Any] = []
        for end, kind in ((subject, "I"), (object_, tag)):
            if isinstance(end, int):
                if end not in names:
                    return None  # neither the entity nor its history is kept
                ends.append(self._iri(names[end], "entity"))
            else:
                ends.append(term_of(end, kind))
        named = rdflib.URIRef(graph) if graph else None
        return Quad(ends[0], rdflib.URIRef(verb), ends[1], named)


def _alive(view: MapView, facts: Iterable[tuple[Any, ...]]) -> list[bool]:
    """Return which statements hold now."""
    columns: list[list[Any]] = [[], [], [], [], [], [], []]
    for graph, subject, verb, object_, tag in facts:
        ids = [end if isinstance(end, int) else None for end in (subject, object_)]
        texts = [None if isinstance(end, int) else end for end in (subject, object_)]
        for column, value in zip(
            columns, (graph, verb, ids[0], texts[0], ids[1], texts[1], tag), strict=True
        ):
            column.append(value)
    if not columns[0]:
        return []
    rows = view.session.execute(
        "SELECT EXISTS (SELECT FROM statement s WHERE s.map_id = %s AND s.predicate = f.verb "
        "AND s.graph = f.graph AND coalesce(s.subject_id, 0) = coalesce(f.subject_id, 0) "
        "AND coalesce(s.subject, '') = coalesce(f.subject, '') "
        "AND coalesce(s.object_id, 0) = coalesce(f.object_id, 0) "
        "AND md5(coalesce(s.object, '')) = md5(coalesce(f.object, '')) "
        "AND coalesce(s.tag, '') = coalesce(f.tag, '') "
        "AND (s.until IS NULL OR s.until > statement_timestamp())) "
        "FROM unnest(%s::text[], %s::text[], %s::bigint[], %s::text[], %s::bigint[], %s::text[], "
        "%s::text[]) WITH ORDINALITY "
        "f (graph, verb, subject_id, subject, object_id, object, tag, n) ORDER BY f.n",
        (view.number, *columns),
    ).fetchall()
    return [bool(row[0]) for row in rows]


class _Regions:
    """The solutions that changes concern: parts, with the terms of some variables.

    Attributes
    ----------
    jobs : those to evaluate
    known : those that are known
    """

    def __init__(self, parts: Iterable[Part]) -> None:
        self.jobs: dict[_Job, None] = {_Job(part, ()): None for part in parts}
        self.known: dict[_Job, set[Row]] = {}

    def evaluate(self, part: Part, solution: Solution) -> None:
        """The solutions with these terms are to be evaluated."""
        if _Job(part, ()) not in self.jobs:
            self.jobs[_Job(part, tuple(sorted(solution.items())))] = None

    def known_as(self, part: Part, region: Solution, solutions: Iterable[Solution]) -> None:
        """The solutions with these terms are known."""
        if _Job(part, ()) not in self.jobs:
            rows: set[Row] = {tuple(each[name] for name in part.names) for each in solutions}
            self.known[_Job(part, tuple(sorted(region.items())))] = rows


def _may_match(
    part: Part, number: int, solution: Solution, known: _Triples, touched: _Touched
) -> bool:
    """Return whether the other patterns may match, by what is known of the touched entities."""
    for other, pattern in enumerate(part.patterns):
        verb = str(pattern.terms[1])
        if other == number or not pattern.listed or verb in _COSTLY:
            continue
        for side, form in pattern.keys:
            end = pattern.terms[side]
            term = solution.get(name_of_variable(end)) if is_variable(end) else None
            if term is None or touched.nodes.get(term, ("", 0))[0] != form:
                continue
            found = (pattern.match(quad) for quad in known.get((verb, side, term), ()))
            if not any(
                match is not None and all(solution.get(n, t) == t for n, t in match.items())
                for match in found
            ):
                return False
    return True


def _form(term: Term) -> Form:
    """Return the form in which the database is given a term that is not a node of an entity."""
    return "iri" if isinstance(term, rdflib.URIRef) else "term"


def _concerns(part: Part, changes: Changes) -> bool:
    """Return whether changes can concern a whole query."""
    if (changes.others or changes.entities) and part.of_tables:
        return True
    if part.properties is None:
        return bool(changes.facts)
    return any(fact[2] in part.properties for fact in changes.facts)


def _properties(tree: Any, constants: Constants) -> frozenset[str] | None:
    """Return a set that has the properties of a query; None if it may have any."""
    if _has_any_property(tree):
        return None
    return frozenset(constants.property(iri) for iri in iris_in(tree))


def _has_any_property(tree: Any) -> bool:
    if isinstance(tree, CompValue):
        if tree.name == "TriplesBlock":
            return True
        triples = tree.get("triples") if tree.name == "BGP" else None
        if any(_is_open(triple[1]) for triple in triples or ()):
            return True
        return any(_has_any_property(each) for each in tree.values())
    return isinstance(tree, (list, tuple)) and any(map(_has_any_property, tree))


def _has_tables(tree: Any, translator: TriplePatterns) -> bool:
    """Return whether anything but statements may match a pattern of a query."""
    if isinstance(tree, CompValue):
        if tree.name == "TriplesBlock":
            return True
        if tree.name == "Function" and str(tree.iri).startswith(SEMMAP):
            return True
        for triple in (tree.get("triples") if tree.name == "BGP" else None) or ():
            try:
                found = None if isinstance(triple[1], Path) else translator.sources(triple, None)
            except UntranslatedError:
                return True
            if not isinstance(found, list) or any(each not in STATEMENTS for each in found):
                return True
        return any(_has_tables(each, translator) for each in tree.values())
    return isinstance(tree, (list, tuple)) and any(_has_tables(t, translator) for t in tree)


def _is_open(verb: Any) -> bool:
    """Return whether a property or path can be any property, or none."""
    if isinstance(verb, (rdflib.Variable, NegatedPath)):
        return True
    if isinstance(verb, MulPath) and verb.mod in ("*", "?"):
        return True
    inner = getattr(verb, "args", None) or [getattr(verb, "arg", None), getattr(verb, "path", None)]
    return any(_is_open(each) for each in inner if isinstance(each, Path))


def _rows(answer: Answer) -> set[Row]:
    if answer.form == "ASK":
        return {()} if answer.truth else set()
    return set(answer.rows)
