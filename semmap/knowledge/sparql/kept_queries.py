"""Queries that were asked before: one round trip, with a plan that the server keeps.

A translation follows from the text and its basis: the map, what the IRIs stand for, the inferences.
One message reads the basis and runs the statement; the answer counts if the basis is the same.
"""

from __future__ import annotations

import json
import re
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import psycopg
from psycopg.abc import Buffer
from psycopg.adapt import PyFormat, Transformer
from psycopg.pq import ConnStatus, ExecStatus, PipelineStatus, TransactionStatus
from psycopg.pq.abc import PGconn, PGresult

from semmap.knowledge.sparql.constants import Constants, Found, Lookup
from semmap.knowledge.sparql.scope import Inferred
from semmap.knowledge.sparql.stored_terms import NUMBER, READ, PrunedError, Term, term_of, terms_of

if TYPE_CHECKING:
    from semmap.knowledge.sparql.translator import SqlStatement

Session = psycopg.Connection[Any]
Row = tuple[Term | None, ...]

PLANNER = {"join_collapse_limit": "11", "from_collapse_limit": "11"}
"""More tables than by default are joined in the best order, up to where that takes long."""

SHORT = 0.02  # seconds: a statement that takes longer is planned each time, for its values

SLOWER = 3
"""So many times in a row slower than when it was planned for its values, and it is planned again.

The server plans a kept statement once, for any values of its parameters.
"""

STOPPED = 0.25  # seconds after which a kept statement is stopped, and planned for its values

_MOST_QUERIES = 1000
_MOST_STATEMENTS = 100  # of a session; the server keeps the plan of each

_BASIS = (
    "SELECT 'map', m.name, m.id::text, jsonb_build_array(r.properties, r.classes)::text "
    "FROM map m LEFT JOIN reasoning r ON r.map_id = m.id "
    "WHERE m.name = current_setting('semmap.map', true)"
)
_LIMITS = ", ".join(
    ["SELECT set_config('statement_timeout', $1, true)"]
    + [
        f"set_config('{name}', '{value}', true)"
        for name, value in {**PLANNER, "plan_cache_mode": "force_generic_plan"}.items()
    ]
).encode()
"""Is executed first: reading the basis may wait, too."""

_READ = READ.replace("%s", "$1").encode()
_NUMBER = NUMBER.encode()

_PARAMETER = re.compile(r"(LIMIT |OFFSET )?%\((\w+)\)s::([a-z]+(?:\[\])?)")
_PLAIN_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class Basis:
    """What a translation follows from, besides the text."""

    lookup: Lookup  # of the IRIs of the text
    rows: frozenset[Found]  # what it found

    @classmethod
    def read(cls, session: Session, lookup: Lookup, map_id: int) -> Basis:
        """Read the basis of a text in one statement."""
        parameters = {**lookup.parameters, "map": map_id}
        rows = session.execute(_basis(lookup).encode(), parameters).fetchall()
        return cls(lookup, frozenset(rows))

    @cached_property
    def constants(self) -> Constants:
        """What the IRIs of the text stand for."""
        return self.lookup.constants(self.rows)

    @cached_property
    def map(self) -> tuple[str, int, Inferred] | None:
        """Name, number and inferences of the map; None where the session names none."""
        for kind, name, number, inferred in self.rows:
            if kind == "map":
                parts = (frozenset(each or ()) for each in json.loads(inferred or "[]"))
                return str(name), int(number or 0), Inferred(*parts)
        return None


def _basis(lookup: Lookup) -> str:
    return f"{_BASIS} UNION ALL {lookup.sql}"


class Prepared:
    """A statement as the server's protocol has it: numbered parameters, and values as text.

    Values that the plan has to know are in the statement: limits, the number of the map, and types,
    whose names are letters, digits and underscores. Raises psycopg.Error where a value has no text.
    """

    def __init__(
        self, sql: str, parameters: dict[str, Any], types: frozenset[str] = frozenset()
    ) -> None:
        numbers: dict[str, int] = {}

        def placed(found: re.Match[str]) -> str:
            count, name, type_ = found.groups()
            value = parameters[name]
            if isinstance(value, int) and (count or type_ == "int"):
                return f"{count or ''}{value:d}::{type_}"
            if type_ == "text" and value in types and _PLAIN_NAME.fullmatch(value):
                return f"'{value}'::text"
            number = numbers.setdefault(name, len(numbers) + 1)
            return f"{count or ''}${number}::{type_}"

        self.sql = _PARAMETER.sub(placed, sql).replace("%%", "%").encode()
        self.names = tuple(numbers)
        values = [parameters[name] for name in numbers]
        self.values = Transformer().dump_sequence(values, [PyFormat.TEXT] * len(values))


@dataclass
class _KeptQuery:
    """A query, and how to answer it while its basis is the same."""

    basis: Prepared
    expected: frozenset[Found]
    statement: Prepared
    width: int
    answer: Callable[[list[Row]], Any]
    seconds: float
    slower: int = 0

    def has_a_bad_plan(self, seconds: float) -> bool:
        """Return whether the statement should be planned for its values, as it took so long."""
        self.slower = self.slower + 1 if seconds > self.seconds else 0
        return seconds > SHORT or self.slower >= SLOWER


class _State:
    """What is known of a session: the map that it saw last, and what it prepared."""

    def __init__(self) -> None:
        self.map_name = ""
        self.names: OrderedDict[bytes, bytes] = OrderedDict()
        self.made = 0


class KeptQueries:
    """The queries of a process that were translated; the oldest are forgotten."""

    def __init__(self) -> None:
        self._queries: dict[tuple[Any, ...], _KeptQuery] = {}
        self._states: WeakKeyDictionary[Session, _State] = WeakKeyDictionary()

    def keep(
        self,
        session: Session,
        key: tuple[Any, ...],
        basis: Basis,
        statement: SqlStatement,
        answer: Callable[[list[Row]], Any],
        seconds: float,
    ) -> None:
        """Keep a translation, with what makes the answer of its solutions.

        The key is what its meaning follows from besides the basis. The statement took `seconds`,
        planned for its values.
        """
        found = basis.map
        if found is None or seconds > SHORT:
            return
        lookup = basis.lookup
        try:
            kept = _KeptQuery(
                Prepared(_basis(lookup), {**lookup.parameters, "map": found[1]}),
                basis.rows,
                Prepared(statement.sql, statement.parameters, basis.constants.types()),
                len(statement.names),
                answer,
                seconds,
            )
        except (psycopg.Error, UnicodeError):
            return
        if len(self._queries) >= _MOST_QUERIES:
            self._queries.clear()
        self._queries[(*key, found[0])] = kept
        self._states.setdefault(session, _State()).map_name = found[0]

    def ask(self, session: Session, key: tuple[Any, ...], seconds: float) -> Any | None:
        """Return the answer of a query; None if it is not kept, or has to be translated again."""
        state = self._states.get(session)
        if state is None:
            return None
        key = (*key, state.map_name)
        kept = self._queries.get(key)
        if kept is None:
            return None
        limit = str(max(1, int(1e3 * min(seconds, STOPPED)))).encode()
        start = time.perf_counter()
        with session.lock:
            if not _is_idle(session):
                return None
            results = _run(
                session.pgconn,
                state,
                (
                    (_LIMITS, [limit]),
                    (kept.basis.sql, kept.basis.values),
                    (kept.statement.sql, kept.statement.values),
                ),
            )
        if results is None:
            self._queries.pop(key, None)
            return None
        if frozenset(_texts(results[1])) != kept.expected:
            return None
        if kept.has_a_bad_plan(time.perf_counter() - start):
            self._queries.pop(key, None)
        try:
            solutions = _solutions(
                results[2],
                kept.width,
                lambda n: terms_of(session, n, partial(_read, session, state)),
            )
        except PrunedError:
            return None
        return kept.answer(solutions)


def _is_idle(session: Session) -> bool:
    """Return whether a statement would be a transaction of its own, as psycopg begins it."""
    pgconn = session.pgconn
    return (
        pgconn.transaction_status == TransactionStatus.IDLE
        and pgconn.pipeline_status == PipelineStatus.OFF
        and session.isolation_level is None
        and session.read_only is None
        and session.deferrable is None
        and pgconn.parameter_status(b"client_encoding") == b"UTF8"
    )


def _run(
    pgconn: PGconn, state: _State, statements: Iterable[tuple[bytes, Sequence[Buffer | None]]]
) -> list[PGresult] | None:
    """Run statements in one round trip and transaction; None if one of them fails."""
    sent: list[tuple[bytes, bytes] | None] = []
    pgconn.enter_pipeline_mode()
    try:
        for sql, values in statements:
            name = state.names.get(sql)
            if name is None:
                name = f"semmap_{state.made}".encode()
                state.made += 1
                pgconn.send_prepare(name, sql)
                sent.append((sql, name))
            else:
                state.names.move_to_end(sql)
            pgconn.send_query_prepared(name, values)
            sent.append(None)
        pgconn.pipeline_sync()
        results = list(_received(pgconn))
    except BaseException:
        list(_received(pgconn))
        raise
    finally:
        pgconn.exit_pipeline_mode()
    found = []
    for made, result in zip(sent, results, strict=False):
        if made is not None and result.status == ExecStatus.COMMAND_OK:
            state.names[made[0]] = made[1]
        elif made is None and result.status == ExecStatus.TUPLES_OK:
            found.append(result)
    if len(results) < len(sent) or len(found) < sent.count(None):
        state.names.clear()  # something may have removed them
        return None
    while len(state.names) > _MOST_STATEMENTS:
        _, name = state.names.popitem(last=False)
        pgconn.exec_(b"DEALLOCATE " + name)
    return found


def _read(session: Session, state: _State, numbers: list[int]) -> list[tuple[str, ...]] | None:
    """Return the rows of terms; None where the statement fails."""
    listed = f"{{{','.join(map(str, numbers))}}}".encode()
    with session.lock:
        results = _run(session.pgconn, state, ((_READ, [listed]),))
    if results is None:
        return None
    (found,) = results
    return [
        tuple((found.get_value(i, j) or b"").decode() for j in range(3))
        for i in range(found.ntuples)
    ]


def _received(pgconn: PGconn) -> Iterable[PGresult]:
    ended = False
    while pgconn.status == ConnStatus.OK:
        result = pgconn.get_result()
        if result is None:
            if ended:  # there are no more, which only a lost connection has
                return
            ended = True
        elif result.status == ExecStatus.PIPELINE_SYNC:
            return
        else:
            ended = False
            yield result


def _texts(result: PGresult) -> Iterable[Found]:
    for i in range(result.ntuples):
        values = (result.get_value(i, j) for j in range(4))
        yield tuple(None if v is None else v.decode() for v in values)


def _solutions(result: PGresult, width: int, read: Callable[[set[int]], Any]) -> list[Row]:
    value, count = result.get_value, result.ntuples
    columns = [
        [(value(i, 2 * column), value(i, 2 * column + 1)) for i in range(count)]
        for column in range(width)
    ]
    numbers = {int(text) for column in columns for text, tag in column if tag == _NUMBER and text}
    known = read(numbers) if numbers else {}
    terms = [
        [known[int(t)] if tag == _NUMBER and t else _term(t, tag) for t, tag in column]
        for column in columns
    ]
    return list(zip(*terms, strict=True)) if terms else [()] * count


def _term(text: bytes | None, tag: bytes | None) -> Term | None:
    if text is None or tag is None:
        return None
    return term_of(text.decode(), tag.decode())
