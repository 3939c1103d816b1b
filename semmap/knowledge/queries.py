"""Queries of SPARQL 1.1 on a map: one statement of SQL where that is possible."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any

import psycopg
import rdflib
from rdflib.plugins.sparql import prepareQuery
from rdflib.plugins.sparql.evaluate import evalQuery
from rdflib.plugins.sparql.parserutils import CompValue
from rdflib.store import Store

from semmap.database.configuration import READER
from semmap.error import Error
from semmap.knowledge.answer import Answer, Explained
from semmap.knowledge.fields.properties import FieldError
from semmap.knowledge.map_view import MapView, RelationsToKeep
from semmap.knowledge.rdflib_algebra import correct
from semmap.knowledge.sparql.expressions import UnitError, UntranslatedError
from semmap.knowledge.sparql.kept_queries import PLANNER, KeptQueries, Row, Session
from semmap.knowledge.sparql.scope import NOTHING_INFERRED, Chosen
from semmap.knowledge.sparql.stored_terms import Term
from semmap.knowledge.unknown_names import unknown_names
from semmap.knowledge.vocabulary import prefixes
from semmap.knowledge.whole_graph import with_prefixes, without_warnings
from semmap.language.parser import ParsedText
from semmap.language.syntax_tree import nodes_in
from semmap.limits import QUERY_ROWS, QUERY_SECONDS

KEPT = KeptQueries()  # the queries of this process that were translated

COLUMNS = 10
"""An answer of more columns may have fewer rows, so that the limit bounds the memory it takes."""

_SETTINGS = "; ".join(
    f"SET LOCAL {name} = {value}" for name, value in (*PLANNER.items(), ("statement_timeout", "{}"))
)


_Key = tuple[str, int, bool, Chosen | None, bool]
"""A text, the most rows, and whether and which inferences, graphs and T-Box it sees."""


class KnowledgeError(Error, ValueError):
    """A query or update that was stopped: it took too long, or has too many rows."""


def query(
    session: Session,
    text: str,
    *,
    seconds: float | None = None,
    rows: int | None = None,
    inferred: bool = True,
    dataset: Chosen | None = None,
    tbox: bool = True,
    plan: bool = False,
) -> Answer:
    """Answer a query on the map that a session sees, in SPARQL 1.1 or the notation of reMap.

    Limits are by default those of `semmap.limits`. Without `inferred`, inferences are not seen.
    With `plan`, the explanation has the server's plan after each statement, which runs twice.
    `dataset` has the graphs to read in place of those of FROM and FROM NAMED. Without `tbox`,
    triples of variables, and of types of variables, do not match the T-Box. Raises QueryError, with
    line and column; KnowledgeError beyond a limit; LookupError where no map is chosen.
    """
    most = int(QUERY_ROWS.value if rows is None else rows)
    if most < 1:
        raise ValueError(f"rows is {rows}: give a number of at least 1")
    stop = _checked(seconds)
    key = (text, most, inferred, dataset, tbox)
    known: Answer | None = None if plan else KEPT.ask(session, key, stop)
    if known is not None:
        return known
    begin = time.monotonic()
    try:
        return _asked(session, key, stop, plan, may_keep=_is_idle(session))
    except RelationsToKeep as stale:
        unkept = _keep(session, stale, stop / 2)
    left = max(stop - (time.monotonic() - begin), 0.001)
    return _asked(session, key, left, plan, may_keep=False, unkept=unkept)


def _is_idle(session: Session) -> bool:
    return session.info.transaction_status == psycopg.pq.TransactionStatus.IDLE


def _keep(session: Session, stale: RelationsToKeep, seconds: float) -> frozenset[str]:
    """Keep relations, and return those that could not be kept: the query does without.

    Each is kept in a transaction that may write where the login only reads by default.
    """
    end, unkept = time.monotonic() + seconds, set()
    for relation in stale.relations:
        try:
            with limited(session, max(end - time.monotonic(), 0.001)):
                if session.info.user == READER:
                    session.execute("SET TRANSACTION READ WRITE")
                session.execute("SELECT keep_relation(%s, %s)", (stale.of_map, relation))
        except (psycopg.DatabaseError, KnowledgeError):  # on a standby, or too slow
            if session.closed:
                raise
            unkept.add(relation)
    return frozenset(unkept)


def _asked(
    session: Session,
    key: _Key,
    seconds: float,
    plan: bool,
    *,
    may_keep: bool,
    unkept: frozenset[str] = frozenset(),
) -> Answer:
    """Translate a query and answer it."""
    text, most, inferred, dataset, tbox = key
    with limited_view(session, seconds) as view:
        view.plans, view.may_keep, view.unkept = plan, may_keep, unkept
        view.tbox = tbox
        if not inferred:
            view.inferred = NOTHING_INFERRED
        parsed = view.parsed(text)
        view.chosen = dataset or Chosen.by(parsed.dataset)
        if parsed.form == "SelectQuery" and len(parsed.names) > COLUMNS:
            most = max(1, COLUMNS * most // len(parsed.names))
        with errors_of(parsed):
            try:
                if parsed.form == "DescribeQuery":
                    answer = _described(view, parsed, most)
                else:
                    answer = _answer(view, parsed, most, key)
            except UntranslatedError as error:
                view.statements.clear()
                view.notes += unknown_names(view, view.constants(parsed.algebra), parsed.algebra)
                answer = _by_rdflib(view, parsed, error, most)
    return replace(answer, notes=tuple(dict.fromkeys(view.notes)), map_name=view.name)


def _answer(view: MapView, parsed: ParsedText, most: int, key: tuple[Any, ...]) -> Answer:
    """Answer a query by one statement, and keep its translation if that does not take long."""
    names, limit = _wanted(parsed, most)
    basis = view.basis(parsed.algebra.p, parsed.kept)
    if view.inferred is not NOTHING_INFERRED and basis.map is not None:
        view.inferred = basis.map[2]
    statement = view.statement(parsed.algebra.p, names, limit, parsed.kept, basis)
    if statement.relations:
        view.pairs = view.pairs_worth_reading(statement)
        statement = view.statement(parsed.algebra.p, names, limit, parsed.kept, basis)
    # What they are told of follows from the basis, so that the answer may be kept with it.
    unknown = unknown_names(view, basis.constants, parsed.algebra.p)
    start = time.monotonic()
    found = view.run(statement)
    seconds = time.monotonic() - start
    explanation = tuple(view.statements)
    answer = partial(_made, parsed, view.name, tuple(names), most, explanation, tuple(unknown))
    if len(explanation) == 1 and not view.notes:
        KEPT.keep(view.session, key, basis, statement, answer, seconds)
    view.notes += unknown
    return answer(found)


def _wanted(parsed: ParsedText, most: int) -> tuple[list[str], int]:
    """Return the variables whose values a form of query needs, and how many solutions."""
    if parsed.form == "SelectQuery":
        return [str(name) for name in parsed.names], most + 1
    if parsed.form == "AskQuery":
        return [], 1
    terms = {t for triple in _template(parsed) for t in triple if isinstance(t, rdflib.Variable)}
    return sorted(str(t) for t in terms), most + 1


def _made(
    parsed: ParsedText,
    map_name: str,
    names: tuple[str, ...],
    most: int,
    explanation: tuple[Explained, ...],
    notes: tuple[str, ...],
    found: list[Row],
) -> Answer:
    _refuse_too_many(len(found), most)
    about: dict[str, Any] = {"explanation": explanation, "notes": notes, "map_name": map_name}
    if parsed.form == "SelectQuery":
        return Answer("SELECT", names, tuple(found), **about)
    if parsed.form == "AskQuery":
        return Answer("ASK", truth=bool(found), **about)
    graph = with_prefixes(rdflib.Graph(), map_name)
    for row in found:
        graph += filled(_template(parsed), dict(zip(names, row, strict=True)))
    return Answer("CONSTRUCT", graph=graph, **about)


def _refuse_too_many(rows: int, most: int) -> None:
    if rows > most:
        raise KnowledgeError(
            f"the answer has more than {most:,} rows: add LIMIT, or raise {QUERY_ROWS.variable}"
        )


def _template(parsed: ParsedText) -> list[Any]:
    """Return the template of CONSTRUCT; that of CONSTRUCT WHERE is the pattern."""
    tree = parsed.algebra
    if tree.template is not None:
        return list(tree.template)
    return [t for n in nodes_in(tree.p) if getattr(n, "name", "") == "BGP" for t in n.triples]


def filled(template: Iterable[Any], solution: dict[str, Term | None]) -> Iterator[Any]:
    """Yield the triples of a template for a solution; those that are no triples are left out."""
    blank: dict[str, rdflib.BNode] = {}

    def term(part: Any) -> Any:
        if isinstance(part, rdflib.Variable):
            return solution.get(str(part))
        if isinstance(part, rdflib.BNode):
            return blank.setdefault(str(part), rdflib.BNode())
        return plain(part)

    for triple in template:
        terms = tuple(term(part) for part in triple)
        subject, verb, object_ = terms
        if (
            isinstance(subject, (rdflib.URIRef, rdflib.BNode))
            and isinstance(verb, rdflib.URIRef)
            and object_ is not None
        ):
            yield terms


def plain(term: Any) -> Any:
    """Return a term of rdflib's own classes: terms of a text are not equal to these."""
    if isinstance(term, rdflib.Literal):
        return rdflib.Literal(str(term), datatype=term.datatype, lang=term.language)
    if isinstance(term, rdflib.URIRef):
        return rdflib.URIRef(str(term))
    return rdflib.BNode(str(term))


def _described(view: MapView, parsed: ParsedText, most: int) -> Answer:
    tree = parsed.algebra
    found: dict[Term, None] = {}
    for term in tree.PV:
        if not isinstance(term, rdflib.Variable):
            found[plain(term)] = None
    names = [str(term) for term in tree.PV if isinstance(term, rdflib.Variable)]
    if names:
        rows = view.run(view.statement(tree.p, names, most + 1, parsed.kept))
        _refuse_too_many(len(rows), most)
        for row in rows:
            found |= dict.fromkeys(t for t in row if isinstance(t, rdflib.URIRef))
    graph = with_prefixes(rdflib.Graph(), view.name)
    for resource in found:
        graph += view.triples((resource, None, None))
    return Answer("DESCRIBE", graph=graph, explanation=tuple(view.statements))


def _by_rdflib(view: MapView, parsed: ParsedText, error: UntranslatedError, most: int) -> Answer:
    """Let rdflib evaluate what has no translation; it reads each triple pattern by SQL."""
    prepared = prepareQuery(parsed.text.sparql, initNs=prefixes(view.name))
    correct(prepared.algebra, partial(_called, view))
    prepared.algebra.pop("datasetClause", None)  # the view knows it; rdflib would read files
    dataset = rdflib.Dataset(store=MapStore(view))
    try:
        with without_warnings():
            found = evalQuery(dataset, prepared, {})
            bindings = list(islice(found.get("bindings") or (), most + 1))
    except (psycopg.Error, KnowledgeError, RecursionError, UnitError):
        raise
    except Exception as problem:  # rdflib raises anything on what it cannot evaluate
        raise KnowledgeError(
            f"neither SQL ({error}) nor rdflib ({str(problem)[:200]}) can evaluate this"
        ) from problem
    reason = f"evaluated by rdflib, because {error}; it read these patterns:"
    forms = {"SelectQuery": "SELECT", "AskQuery": "ASK", "ConstructQuery": "CONSTRUCT"}
    form = forms.get(parsed.form, "DESCRIBE")
    names = tuple(str(name) for name in found.get("vars_") or ())
    rows = []
    for binding in bindings:
        rows.append(tuple(binding.get(rdflib.Variable(n)) for n in names))
    _refuse_too_many(len(rows), most)
    return Answer(
        form,
        names,
        tuple(rows),
        found.get("askAnswer"),
        found.get("graph"),
        (Explained("rdflib", reason), *view.statements),
    )


def _called(view: MapView, call: CompValue) -> Any:
    """Return the value of a function of constants, as SQL has it."""
    value = rdflib.Variable("value")
    pattern = CompValue("Extend", p=CompValue("BGP", triples=[]), expr=call, var=value)
    asked = len(view.statements)
    ((found,),) = view.run(view.statement(pattern, [str(value)], limit=1))
    del view.statements[asked:]
    return found


@contextmanager
def limited(session: Session, seconds: float | None) -> Iterator[float]:
    """Run statements in a transaction that the server stops after some seconds; yield the end."""
    most = _checked(seconds)
    idle = _is_idle(session)
    try:
        with session.transaction():
            session.execute(_SETTINGS.format(min(max(1, int(1e3 * most)), 2**31 - 1)).encode())
            yield time.monotonic() + most
            if not idle:  # the transaction goes on
                session.execute("SET LOCAL statement_timeout = 0")
    except psycopg.errors.QueryCanceled as error:
        raise KnowledgeError(
            f"it took more than {most:g} s and was stopped: make it more selective, or raise "
            f"{QUERY_SECONDS.variable}"
        ) from error


@contextmanager
def limited_view(session: Session, seconds: float | None) -> Iterator[MapView]:
    """Yield the map that a session sees, in a transaction that is stopped after some seconds."""
    with limited(session, seconds) as deadline:
        view = MapView.of(session)
        view.deadline = deadline
        yield view


def _checked(seconds: float | None) -> float:
    """Return after how many seconds a query is stopped."""
    found = float(QUERY_SECONDS.value if seconds is None else seconds)
    if not 0 < found < float("inf"):
        raise ValueError(f"seconds is {seconds}: give a number above 0")
    return found


@contextmanager
def errors_of(parsed: ParsedText) -> Iterator[None]:
    """Report errors that only the server finds as those of a text."""
    try:
        yield
    except FieldError as error:
        raise parsed.error(error.reason, error.place) from error
    except UnitError as error:
        raise parsed.error(str(error), 0) from error
    except psycopg.errors.InvalidRegularExpression as error:
        raise parsed.error(f"this has an invalid regular expression: {_first(error)}", 0) from error
    except (psycopg.DataError, psycopg.errors.InternalError_) as error:
        raise parsed.error(f"a value cannot be computed: {_first(error)}", 0) from error
    except (psycopg.errors.StatementTooComplex, psycopg.errors.ProgramLimitExceeded) as error:
        raise parsed.error(f"this is too large: {_first(error)}", 0) from error
    except RecursionError as error:
        raise parsed.error("this is nested too deeply: use fewer parts", 0) from error


def _first(error: psycopg.Error) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__


class MapStore(Store):
    """A store for `rdflib.Dataset`."""

    context_aware = True
    graph_aware = True

    def __init__(self, view: MapView) -> None:
        super().__init__()
        self._view = view

    def triples(self, triple_pattern: tuple[Any, Any, Any], context: Any = None) -> Iterator[Any]:
        """Yield the triples that match a pattern, None for any."""
        for triple in self._view.triples(triple_pattern, _graph_name(context)):
            yield triple, iter([context])

    def contexts(self, triple: Any = None) -> Generator[Any, None, None]:
        """Yield the named graphs."""
        rows = self._view.session.execute(
            "SELECT text FROM term WHERE id IN "
            "(SELECT graph FROM triple WHERE map_id = %s AND graph <> 0)",
            (self._view.number,),
        ).fetchall()
        chosen = self._view.chosen
        yield from (rdflib.URIRef(g) for (g,) in rows if chosen is None or g in chosen.named)

    def add_graph(self, graph: Any) -> None:
        """Do nothing: rdflib adds the default graph to those that it lists."""

    def __len__(self, context: Any = None) -> int:
        return sum(1 for _ in self.triples((None, None, None), context))


def _graph_name(context: Any) -> rdflib.URIRef | None:
    """Return the IRI of a named graph; None for the default graph."""
    name = getattr(context, "identifier", context)
    if not isinstance(name, rdflib.URIRef) or name == rdflib.graph.DATASET_DEFAULT_GRAPH_ID:
        return None
    return name
