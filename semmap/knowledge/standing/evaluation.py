"""The solutions of parts of standing queries, one statement of SQL for all parts of a shape."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import psycopg
import rdflib

from semmap.knowledge.map_view import MapView
from semmap.knowledge.queries import errors_of, limited, query
from semmap.knowledge.sparql.constants import tag_and_text
from semmap.knowledge.sparql.kept_queries import Row
from semmap.knowledge.sparql.stored_terms import Term, term_of
from semmap.knowledge.sparql.translator import GIVEN, SqlStatement
from semmap.knowledge.standing.parts import QueryPart, Solution
from semmap.knowledge.standing.templates import translated
from semmap.knowledge.triple_map import Form
from semmap.limits import QUERY_SECONDS

_SETTINGS = (
    "SELECT set_config('plan_cache_mode', '{}', true), "
    "set_config('statement_timeout', '{}', true), "
    "set_config('join_collapse_limit', '11', true), set_config('from_collapse_limit', '11', true)"
)
_PARAMETER = re.compile(r"%\((\w+)\)s::(double precision|\w+)")


class Job(NamedTuple):
    """The solutions of a part with some terms are to be evaluated."""

    part: QueryPart
    solution: tuple[tuple[str, Term], ...]

    @property
    def given(self) -> list[tuple[str, Term]]:
        """The terms that the database is given: those at the ends of patterns."""
        return [each for each in self.solution if each[0] in self.part.ends]


_Group = list[tuple[Job, SqlStatement]]  # jobs of one shape


class Regions:
    """The solutions that changes concern: parts, with the terms of some variables."""

    def __init__(self, parts: Iterable[QueryPart]) -> None:
        self.jobs: dict[Job, None] = {Job(part, ()): None for part in parts}
        self.known: dict[Job, set[Row]] = {}
        self.single: dict[tuple[QueryPart, Row], bool] = {}

    def evaluate(self, part: QueryPart, solution: Solution) -> None:
        """The solutions with these terms are to be evaluated."""
        if Job(part, ()) not in self.jobs:
            self.jobs[Job(part, tuple(sorted(solution.items())))] = None

    def known_as(self, part: QueryPart, region: Solution, solutions: Iterable[Solution]) -> None:
        """The solutions with these terms are known."""
        if Job(part, ()) not in self.jobs:
            rows: set[Row] = {tuple(each[name] for name in part.names) for each in solutions}
            self.known[Job(part, tuple(sorted(region.items())))] = rows

    def single_as(self, part: QueryPart, row: Row, holds: bool) -> None:
        """The terms of all variables are a solution, or are none."""
        if not self.jobs or Job(part, ()) not in self.jobs:
            self.single[part, row] = holds


class Evaluation:
    """Evaluates jobs."""

    def __init__(self) -> None:
        self._varying: dict[Any, set[str]] = defaultdict(set)

    def answers(
        self,
        view: MapView,
        jobs: list[Job],
        nodes: Mapping[Term, tuple[Form, int]],
        errors: dict[Any, Exception],
    ) -> dict[Job, set[Row]]:
        """Return the solutions of parts; `errors` gets those of queries, `nodes` are entities."""
        same: dict[Any, list[Job]] = defaultdict(list)
        for job in jobs:
            same[id(job.part.statements), job.solution].append(job)
        groups: dict[Any, _Group] = defaultdict(list)
        alone = []
        for some in same.values():
            given = tuple(_given(some[0], nodes))
            statement = _statement(view, some[0].part, given)
            if statement is None:
                alone += some
            else:
                forms = tuple(form for _, form in given)
                groups[statement.sql, forms] += [(job, statement) for job in some]
        found: dict[Job, set[Row]] = {}
        try:
            found = self._run_all(view, groups, nodes)
        except (psycopg.DataError, psycopg.ProgrammingError, psycopg.errors.QueryCanceled):
            alone, found = jobs, {}  # each by itself, to find the one that fails
        for job in alone:
            try:
                found[job] = _alone(view, job, nodes)
            except (ValueError, LookupError, psycopg.DataError) as error:
                errors[job.part.query] = error
        return found

    def _run_all(
        self,
        view: MapView,
        groups: Mapping[Any, _Group],
        nodes: Mapping[Term, tuple[Form, int]],
    ) -> dict[Job, set[Row]]:
        found: dict[Job, set[Row]] = {}
        if not groups:
            return found
        session = view.session
        cursors: list[tuple[_Group, psycopg.Cursor[Any]]] = []
        with session.pipeline(), session.transaction():
            # Plans for a few given terms serve all terms; others may need plans of their own.
            for of_region, mode in ((True, "force_generic_plan"), (False, "auto")):
                mine = {k: g for k, g in groups.items() if bool(g[0][0].solution) == of_region}
                if mine:
                    limit = int(1e3 * QUERY_SECONDS.value)
                    session.execute(_SETTINGS.format(mode, limit).encode())
                for key, group in mine.items():
                    sql, values = _with_values(group, nodes, self._varying[key])
                    cursors.append((group, session.execute(sql, values, prepare=True)))
        for group, cursor in cursors:  # after the end of the message: it takes no other one
            found |= _solutions(group, cursor.fetchall())
        return found


def _with_values(
    group: _Group, nodes: Mapping[Term, tuple[Form, int]], varying: set[str]
) -> tuple[bytes, dict[str, Any]]:
    """Return the statement of jobs of one shape, with their values as columns.

    The varying parameters are columns; only more come, so that the statement stays the same.
    """
    statement = group[0][1]
    columns: dict[str, tuple[str, list[Any]]] = {"n": ("int", list(range(len(group))))}
    given = [job.given for job, _ in group] if group[0][0].solution else []
    for i in range(len(given[0]) if given else 0):
        terms = [each[i][1] for each in given]
        ends = [nodes.get(term) for term in terms]
        if ends[0] is not None:
            columns[f"s{i}"] = ("bigint", [node[1] for node in ends if node])
        else:
            texts = [tag_and_text(term) for term in terms]
            columns[f"s{i}"] = ("text", [text for text, _ in texts])
            if _form(terms[0]) == "term":
                columns[f"t{i}"] = ("text", [tag for _, tag in texts])
    types = dict(_PARAMETER.findall(statement.sql))
    for name, kind in types.items():
        column = [_value(job.part, other, name) for job, other in group]
        if name in varying or len({repr(value) for value in column}) > 1:  # NaN differs from NaN
            varying.add(name)
            columns[name] = kind, column
    sql = _PARAMETER.sub(
        lambda found: f"p.{found[1]}" if found[1] in varying else found[0], statement.sql
    )
    arrays = ", ".join(f"%(given_{name})s::{kind}[]" for name, (kind, _) in columns.items())
    sql = sql.replace(GIVEN, f"unnest({arrays}) AS p ({', '.join(columns)})")
    parameters = {name: _value(group[0][0].part, statement, name) for name in statement.parameters}
    values = parameters | {f"given_{n}": each for n, (_, each) in columns.items()}
    return sql.encode(), values


def _solutions(group: _Group, rows: Iterable[tuple[Any, ...]]) -> dict[Job, set[Row]]:
    found: dict[Job, set[Row]] = {job: set() for job, _ in group}
    width = range(len(group[0][1].names))
    # One object for each term: rdflib compares two that are equal slowly.
    given = {id(term): term for job, _ in group for _, term in job.solution}
    terms: dict[Any, Term | None] = {
        (str(term), "I"): term for term in given.values() if isinstance(term, rdflib.URIRef)
    }
    places: dict[int, list[int]] = {}
    for n, *row in rows:
        job = group[n][0]
        part = job.part
        if id(part.statements) not in places:
            places[id(part.statements)] = [part.names.index(name) for name, _ in job.solution]
        solution: list[Term | None] = []
        for i in width:
            key = row[2 * i], row[2 * i + 1]
            if key not in terms:
                terms[key] = term_of(*key)
            solution.append(terms[key])
        for i, (_, term) in zip(places[id(part.statements)], job.solution, strict=True):
            if solution[i] is not term and solution[i] != term:
                break
        else:
            found[job].add(tuple(solution))
    return found


def _statement(
    view: MapView, part: QueryPart, given: tuple[tuple[str, Form], ...]
) -> SqlStatement | None:
    if given not in part.statements:
        part.statements[given] = translated(view, part, part.constants, dict(given))
    found: SqlStatement | None = part.statements[given]
    return found


def _alone(view: MapView, job: Job, nodes: Mapping[Term, tuple[Form, int]]) -> set[Row]:
    text = job.part.query.text
    statement = _statement(view, job.part, tuple(_given(job, nodes)))
    if statement is None:
        answer = query(view.session, text)
        return {()} if answer.truth else set(answer.rows)
    with limited(view.session, None), errors_of(view.parsed(text)):
        group = [(job, statement)]
        sql, values = _with_values(group, nodes, set())
        return _solutions(group, view.session.execute(sql, values).fetchall())[job]


def _value(part: QueryPart, statement: SqlStatement, name: str) -> Any:
    """Return a parameter of a statement; that of the part's own where it has one."""
    value = statement.parameters[name]
    return part.values.get(value, value) if isinstance(value, (str, int)) else value


def _given(job: Job, nodes: Mapping[Term, tuple[Form, int]]) -> list[tuple[str, Form]]:
    return [(name, nodes.get(term, (_form(term), 0))[0]) for name, term in job.given]


def _form(term: Term) -> Form:
    """Return the form in which the database is given a term that is not a node of an entity."""
    return "iri" if isinstance(term, rdflib.URIRef) else "term"
