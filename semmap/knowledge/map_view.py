"""The map that a session sees: its namespace, and statements of SQL on it."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import psycopg
import rdflib
from psycopg import ClientCursor
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.database.maps import pick_map
from semmap.knowledge.answer import Explained
from semmap.knowledge.fields.rows import FieldRows
from semmap.knowledge.mapping import COMPUTED
from semmap.knowledge.sparql.constants import Constants, Lookup, iris_in, literals_in, resolve
from semmap.knowledge.sparql.kept_queries import Basis, Row, Session
from semmap.knowledge.sparql.scope import NOTHING_INFERRED, Chosen, Inferred, MapGraph
from semmap.knowledge.sparql.stored_terms import NUMBER, READ, PrunedError, term_of, terms_of
from semmap.knowledge.sparql.translator import SqlStatement, translate
from semmap.knowledge.vocabulary import map_namespace, prefixes
from semmap.language.grammar import Form
from semmap.language.parser import ParsedText, parse_sparql

_TRIES = 3  # where terms of an answer are pruned before they are read
_KEPT = 16  # how many translations of one text are kept
_MAP = (
    "SELECT m.name, m.id, r.properties, r.classes "
    "FROM map m LEFT JOIN reasoning r ON r.map_id = m.id WHERE m.name = "
)
_CHOSEN = f"{_MAP}current_setting('semmap.map', true)"
_NAMED = f"{_MAP}%s"


class RelationsToKeep(Exception):
    """Relations of which a statement reads all pairs are to be kept before it, to be fast."""

    def __init__(self, of_map: int, relations: Iterable[str]) -> None:
        super().__init__(of_map, relations)
        self.of_map, self.relations = of_map, sorted(relations)


@dataclass
class MapView:
    """The map that a session sees, as namespace and number."""

    session: Session
    name: str
    number: int
    inferred: Inferred = NOTHING_INFERRED  # what queries see of its inferences
    deadline: float = float("inf")  # when queries are stopped, of `time.monotonic`
    # what was asked, of SQL and of fields
    statements: list[Explained] = field(default_factory=list)
    chosen: Chosen | None = None  # the graphs that a text chooses to read
    tbox: bool = True  # whether triples of variables alone match the T-Box
    notes: list[str] = field(default_factory=list)  # what the answers say nothing of
    may_keep: bool = False  # whether relations may be kept first: the transaction is its own
    unkept: frozenset[str] = frozenset()  # relations that could not be kept
    pairs: frozenset[str] = frozenset()  # the kept relations of which statements read all pairs
    plans: bool = False  # whether the plan of each statement is read, too
    # subjects and objects of facts that were changed
    touched: set[Any] = field(default_factory=set)

    @classmethod
    def of(cls, session: Session) -> MapView:
        """Return the current map; LookupError where there are several and none is chosen."""
        row = session.execute(_CHOSEN).fetchone()
        if row is None:  # none is chosen: the only one, or an error that lists them
            name = pick_map(session)
            row = session.execute(_NAMED, (name,)).fetchone()
        assert row is not None
        inferred = Inferred()
        if row[2] is not None:
            inferred = Inferred(*(frozenset(each or ()) for each in row[2:]))
        return cls(session, str(row[0]), int(row[1]), inferred)

    def value(self, sql: str, *parameters: Any) -> Any:
        """Return the first value of the first row of a statement; None without a row."""
        row = self.session.execute(sql.encode(), parameters or None).fetchone()
        return row and row[0]

    def parsed(self, text: str, form: Form = "query") -> ParsedText:
        """Parse a query or an update, with the prefixes of the map."""
        return parse_sparql(text, form, tuple(prefixes(self.name).items()))

    @property
    def namespace(self) -> str:
        """The namespace of the map's entities."""
        return map_namespace(self.name)

    def graph(self, constants: Constants) -> MapGraph:
        """Return what patterns are matched with, apart from chosen graphs and fields."""
        return MapGraph(constants, self.namespace, self.number, self.inferred, tbox=self.tbox)

    def constants(self, *trees: Any) -> Constants:
        """Return what the IRIs of parts of the algebra stand for."""
        return resolve(self.session, iris_in(trees), self.namespace, self.number)

    def basis(self, algebra: Any, kept: dict[Any, Any]) -> Basis:
        """Read what a translation follows from besides the text, of which `kept` was made."""
        if ("lookup", self.name) not in kept:
            kept["lookup", self.name] = Lookup(
                iris_in(algebra), self.namespace, literals_in(algebra)
            )
        return Basis.read(self.session, kept["lookup", self.name], self.number)

    def statement(
        self,
        algebra: Any,
        names: Iterable[str],
        limit: int | None = None,
        kept: dict[Any, Any] | None = None,
        basis: Basis | None = None,
    ) -> SqlStatement:
        """Translate a pattern, for at most `limit` rows; `kept` has translations to use again."""
        kept = {} if kept is None else kept
        basis = basis or self.basis(algebra, kept)
        constants = basis.constants
        columns = tuple(names)
        seen = (self.chosen, self.inferred, self.tbox, self.pairs)
        key = (columns, limit, self.number, self.name, *seen, constants.key)
        if key not in kept:
            if len(kept) > _KEPT:
                kept.clear()
            read = len(self.statements) + len(self.notes)
            source = replace(
                self.graph(constants),
                chosen=self.chosen,
                fields=FieldRows(self),
                pairs=self.pairs,
            )
            made = translate(algebra, columns, source, limit)
            if read < len(self.statements) + len(self.notes):
                return made  # it has rows of fields, which change
            kept[key] = made
        found: SqlStatement = kept[key]
        return found

    def pairs_worth_reading(self, statement: SqlStatement) -> frozenset[str]:
        """Return the relations of which a statement is faster with all pairs, as the planner says.

        Raises RelationsToKeep where some of them can be kept first.
        """
        shares = dict(
            self.session.execute(
                "SELECT r.name, share_to_decide(%s, r.name) FROM unnest(%s::text[]) r (name)",
                (self.number, sorted(statement.relations)),
            ).fetchall()
        )
        stale = {name for name, share in shares.items() if share > 0}
        if stale:
            cost = self._cost(statement.sql, statement.parameters)
            every = {each.kept: each.converse for each in COMPUTED}  # as a pattern of two variables
            for name in sorted(stale):
                others = str(every[name]).format(a="e.id")
                listed = f"SELECT FROM entity e, LATERAL {others} m WHERE e.map_id = %(map)s"
                if cost < shares[name] * self._cost(listed, {"map": self.number}) / 2:
                    stale.discard(name)
                    shares.pop(name)
        if stale and self.may_keep:
            raise RelationsToKeep(self.number, stale)
        return frozenset(shares) - self.unkept

    def _cost(self, sql: str, parameters: Mapping[str, Any]) -> float:
        """Return what the planner thinks that a statement costs."""
        explained = f"EXPLAIN (FORMAT JSON) {sql}".encode()
        row = self.session.execute(explained, parameters, prepare=False).fetchone()
        assert row is not None
        return float(row[0][0]["Plan"]["Total Cost"])

    def run(self, statement: SqlStatement, about: str = "") -> list[Row]:
        """Return the solutions of a statement, which answers a pattern of rdflib's or the query."""
        asked = ClientCursor(self.session).mogrify(statement.sql.encode(), statement.parameters)
        self.statements.append(Explained("sql", f"{about}{asked}"))
        if self.plans:
            sql = f"EXPLAIN (ANALYZE, BUFFERS, SETTINGS) {statement.sql}"
            plan = self.session.execute(sql.encode(), statement.parameters, prepare=False)
            self.statements.append(Explained("plan", "\n".join(line for (line,) in plan)))
        for _ in range(_TRIES):
            self.check_time()
            with self.session.cursor() as cursor:
                cursor.execute(statement.sql.encode(), statement.parameters, prepare=False)
                rows = cursor.fetchall()
            with suppress(PrunedError):
                return self._terms(rows, len(statement.names))
        raise psycopg.errors.SerializationFailure("terms were pruned meanwhile: ask again")

    def _terms(self, rows: list[tuple[Any, ...]], width: int) -> list[Row]:
        columns = [[(row[2 * i], row[2 * i + 1]) for row in rows] for i in range(width)]
        numbers = {int(text) for column in columns for text, tag in column if tag == NUMBER}
        known = terms_of(
            self.session,
            numbers,
            lambda missing: self.session.execute(READ, [missing], prepare=True),
        )
        terms = [
            [known[int(text)] if tag == NUMBER else term_of(text, tag) for text, tag in column]
            for column in columns
        ]
        return list(zip(*terms, strict=True)) if terms else [()] * len(rows)

    def check_time(self) -> None:
        """Stop a query or an update, as the server does, after its deadline."""
        if time.monotonic() > self.deadline:
            raise psycopg.errors.QueryCanceled("the query took too long")

    def triples(
        self, pattern: tuple[Any, Any, Any], graph: Any = None
    ) -> Iterator[tuple[Any, Any, Any]]:
        """Yield the triples of a graph, or the default graph, that match terms, None for any."""
        names = ("s", "p", "o")
        terms = tuple(
            rdflib.Variable(n) if t is None else t for n, t in zip(names, pattern, strict=True)
        )
        free = [n for n, t in zip(names, pattern, strict=True) if t is None]
        node: Any = CompValue("BGP", triples=[terms])
        if graph is not None:
            node = CompValue("Graph", term=graph, p=node)
        shown = " ".join(" ".join(term.n3() for term in terms).split())  # on one line
        for row in self.run(self.statement(node, free), f"-- {shown}\n"):
            known = dict(zip(free, row, strict=True))
            s, p, o = (known.get(n, t) for n, t in zip(names, pattern, strict=True))
            yield s, p, o
