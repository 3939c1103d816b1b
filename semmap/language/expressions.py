"""What FILTER, BIND and the like work out, a column at a time.

An error in a row, such as a division by 0, leaves it without a value, as in SPARQL 1.1, section 17.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import rdflib
import regex
from numpy.typing import NDArray
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.language.error import QueryError
from semmap.language.grammar import place
from semmap.language.plan import Context
from semmap.fields.queries.table import Column, ColumnKind, LimitError, Table, unbound
from semmap.fields.queries.statements import voxels_of_keys
from semmap.limits import REGEX_SECONDS

__all__ = [
    "Expression",
    "Scope",
    "centres",
    "condition",
    "expression",
    "number_of",
    "thing_named",
    "word",
]

Run = Callable[[Context, Table], Column]


@dataclass(frozen=True, eq=False)
class Expression:
    """What gives a column for a table.

    Attributes
    ----------
    kind : what it gives
    variables : those that it needs
    run : works it out
    at : its place in the text
    range : the semantic type of the things that it gives, if known
    """

    kind: ColumnKind
    variables: frozenset[str]
    run: Run
    at: int
    range: str | None = None


@dataclass(frozen=True, eq=False)
class _Constant:
    """A name in the text: what it names depends on what it is compared with."""

    term: Any
    at: int


class Scope(Protocol):
    """What is known where an expression stands."""

    def error(self, reason: str, at: object) -> QueryError: ...

    def variable(self, term: Any) -> tuple[ColumnKind, str | None]:
        """Kind and range of a variable; raises where it is not bound."""
        ...

    def things(self, term: Any, range_: str | None) -> frozenset[str]: ...

    def is_function(self, iri: str) -> bool: ...

    def exists(self, tree: Any) -> Expression: ...


def word(kind: ColumnKind) -> str:
    """A kind in a sentence."""
    return {"boolean": "a truth value", "text": "text"}.get(kind, f"a {kind}")


def thing_named(term: Any) -> str | None:
    """The local name of an IRI, the text of a plain literal; None for other terms."""
    if isinstance(term, rdflib.URIRef):
        return re.split(r"[#/:]", str(term))[-1]
    if isinstance(term, rdflib.Literal) and term.datatype in (None, rdflib.XSD.string):
        return str(term)
    return None


def number_of(term: Any) -> float | None:
    """The number that a literal is; None for other terms."""
    if not isinstance(term, rdflib.Literal) or term.datatype in (None, rdflib.XSD.boolean):
        return None
    try:
        return float(term.value) if term.value is not None else None
    except (TypeError, ValueError):
        return None


def expression(tree: Any, scope: Scope) -> Expression:
    """An expression with a kind.

    Raises
    ------
    QueryError
        Kinds that do not go together, variables that are not bound, functions that are not there.
    """
    found = _operand(tree, scope)
    if not isinstance(found, _Constant):
        return found
    return (_thing if isinstance(found.term, rdflib.URIRef) else _text)(found, scope)


def condition(tree: Any, scope: Scope) -> Expression:
    """An expression as a truth value (SPARQL 1.1, section 17.2.2)."""
    found = expression(tree, scope)
    if found.kind == "boolean":
        return found
    if found.kind == "number":
        return _mapped("boolean", lambda x: (x != 0) & ~np.isnan(x), found)
    if found.kind == "text":
        return _of_names("boolean", lambda name: name != "", found)
    raise scope.error(f"{word(found.kind)} is neither true nor false: compare it", tree)


def _operand(tree: Any, scope: Scope) -> Expression | _Constant:
    at = place(tree) or 0
    if isinstance(tree, rdflib.Variable):
        kind, range_ = scope.variable(tree)
        return _variable(str(tree), kind, at, range_)
    if isinstance(tree, rdflib.Literal):
        if tree.datatype == rdflib.XSD.boolean and tree.value is not None:
            return _fixed("boolean", bool(tree.value), at)
        number = number_of(tree)
        if number is not None:
            return _fixed("number", number, at)
        if thing_named(tree) is None:
            raise scope.error("this is neither a number nor a name", tree)
    if isinstance(tree, rdflib.term.Identifier):
        return _Constant(tree, at)
    if isinstance(tree, CompValue):
        if tree.name.startswith("Aggregate_"):
            raise scope.error(
                "an aggregate stands in SELECT, HAVING or ORDER BY, and in no other aggregate", tree
            )
        make = _MAKERS.get(tree.name)
        if make is not None:
            return make(tree, scope)
        name = tree.name.removeprefix("Builtin_")
        raise scope.error(f"{name} is not supported", tree)
    raise scope.error("this is not supported here", at)


def _variable(name: str, kind: ColumnKind, at: int, range_: str | None) -> Expression:
    def run(_: Context, table: Table) -> Column:
        return table.columns.get(name) or unbound(kind, table.rows)

    return Expression(kind, frozenset({name}), run, at, range_)


def _fixed(kind: ColumnKind, value: float, at: int) -> Expression:
    def run(_: Context, table: Table) -> Column:
        return Column(kind, np.broadcast_to(np.asarray(value), (table.rows,)))

    return Expression(kind, frozenset(), run, at)


def _thing(constant: _Constant, scope: Scope) -> Expression:
    """An IRI on its own stands for the one thing that it names."""
    things = scope.things(constant.term, None)
    own = thing_named(constant.term)
    if len(things) == 1:
        (own,) = things
    elif own not in things:
        raise scope.error(f"this names {len(things)} things: take one of them", constant.term)
    name = str(own)

    def run(context: Context, table: Table) -> Column:
        return Column("thing", np.full(table.rows, context.names.code(name), np.int64))

    return Expression("thing", frozenset(), run, constant.at)


def _text(operand: Expression | _Constant, scope: Scope) -> Expression:
    if isinstance(operand, Expression):
        if operand.kind == "text":
            return operand
        mend = ": write STR(...)" if operand.kind == "thing" else ""
        raise scope.error(f"{word(operand.kind)} is no text{mend}", operand.at)
    if isinstance(operand.term, rdflib.URIRef):
        raise scope.error('an IRI is no text: write "..."', operand.term)
    content = str(operand.term)

    def run(context: Context, table: Table) -> Column:
        return Column("text", np.full(table.rows, context.names.code(content), np.int64))

    return Expression("text", frozenset(), run, operand.at)


def _together(columns: Iterable[Column]) -> NDArray[np.bool_] | None:
    """Where all of them have a value."""
    bound: NDArray[np.bool_] | None = None
    for column in columns:
        if column.bound is not None:
            bound = column.bound if bound is None else bound & column.bound
    return bound


def _mapped(kind: ColumnKind, function: Callable[..., NDArray[Any]], *of: Expression) -> Expression:
    """A function of values, row by row; what comes out as NaN is an error only of `_arithmetic`."""

    def run(context: Context, table: Table) -> Column:
        columns = [each.run(context, table) for each in of]
        return Column(kind, function(*(c.values for c in columns)), _together(columns))

    return Expression(kind, frozenset().union(*(e.variables for e in of)), run, of[0].at)


def _of_names(kind: ColumnKind, function: Callable[[str], Any], of: Expression) -> Expression:
    """A function of names, worked out once for each."""

    def run(context: Context, table: Table) -> Column:
        context.expect_time()
        column = of.run(context, table)
        codes, places = np.unique(column.values, return_inverse=True)
        names = context.names.names
        each = [function(names[code]) if code < len(names) else function("") for code in codes]
        if kind == "text":
            each = [context.names.code(text) for text in each]
        values = np.array(each, np.int64 if kind == "text" else None)
        return Column(kind, values[places] if len(codes) else values.astype(bool), column.bound)

    return Expression(kind, of.variables, run, of.at)


def _numbers(trees: Iterable[Any], scope: Scope) -> list[Expression]:
    found = []
    for tree in trees:
        one = _operand(tree, scope)
        if isinstance(one, _Constant):
            raise scope.error("this is no number", tree)
        if one.kind != "number":
            raise scope.error(f"{word(one.kind)} is no number", tree)
        found.append(one)
    return found


def _arithmetic(tree: Any, scope: Scope) -> Expression:
    first, *others = _numbers([tree.expr, *tree.other], scope)
    operations = [str(each) for each in tree.op]

    def run(context: Context, table: Table) -> Column:
        columns = [each.run(context, table) for each in (first, *others)]
        bound = _together(columns)
        value = columns[0].values
        for operation, column in zip(operations, columns[1:], strict=True):
            other = column.values
            if operation == "/":
                zero = other == 0
                if zero.any():
                    bound = ~zero if bound is None else bound & ~zero
                value = np.divide(value, np.where(zero, 1, other))
            else:
                value = {"+": np.add, "-": np.subtract, "*": np.multiply}[operation](value, other)
        return Column("number", value, bound)

    variables = frozenset().union(first.variables, *(each.variables for each in others))
    return Expression("number", variables, run, first.at)


def _unary(function: Callable[[NDArray[Any]], NDArray[Any]], key: str) -> Any:
    def make(tree: Any, scope: Scope) -> Expression:
        return _mapped("number", function, *_numbers([tree[key]], scope))

    return make


def _half_up(x: NDArray[Any]) -> NDArray[Any]:
    return np.floor(x + 0.5)


_COMPARISONS: Mapping[str, Callable[..., NDArray[Any]]] = {
    "=": np.equal, "!=": np.not_equal, "<": np.less, ">": np.greater,
    "<=": np.less_equal, ">=": np.greater_equal,
}  # fmt: skip


def _relational(tree: Any, scope: Scope) -> Expression:
    if tree.op in ("IN", "NOT IN"):
        return _in(tree, scope)
    return _compared(_operand(tree.expr, scope), tree.op, _operand(tree.other, scope), tree, scope)


def _compared(
    a: Expression | _Constant, operation: str, b: Expression | _Constant, tree: Any, scope: Scope
) -> Expression:
    if isinstance(a, _Constant) and isinstance(b, _Constant):
        raise scope.error("both sides are constants: one has to be a variable", tree)
    if isinstance(a, _Constant):
        turned = {"<": ">", ">": "<", "<=": ">=", ">=": "<="}.get(operation, operation)
        return _compared(b, turned, a, tree, scope)
    if isinstance(b, _Constant):
        if a.kind == "thing":
            return _is_one_of(a, operation, b, tree, scope)
        if a.kind != "text":
            raise scope.error(f"{word(a.kind)} is compared with a name", tree)
        b = _text(b, scope)
    if a.kind != b.kind:
        raise scope.error(f"{word(a.kind)} is compared with {word(b.kind)}", tree)
    if a.kind in ("voxel", "thing") and operation not in ("=", "!="):
        mend = "STR(...)" if a.kind == "thing" else ":x(...), :y(...) or :z(...)"
        raise scope.error(f"a {a.kind} has no order: compare {mend}", tree)
    compare = _COMPARISONS[operation]
    if a.kind != "text" or operation in ("=", "!="):
        return _mapped("boolean", compare, a, b)

    def run(context: Context, table: Table) -> Column:
        columns = [each.run(context, table) for each in (a, b)]
        ranks = context.names.ranks()
        values = compare(*(ranks[c.values] for c in columns))
        return Column("boolean", values, _together(columns))

    return Expression("boolean", a.variables | b.variables, run, a.at)


def _is_one_of(a: Expression, operation: str, b: _Constant, tree: Any, scope: Scope) -> Expression:
    if operation not in ("=", "!="):
        raise scope.error("a thing has no order: compare STR(...)", tree)
    return _among(a, scope.things(b.term, a.range), operation == "!=")


def _among(of: Expression, things: frozenset[str], negated: bool) -> Expression:
    def run(context: Context, table: Table) -> Column:
        column = of.run(context, table)
        found = np.isin(column.values, context.names.codes(sorted(things)))
        return Column("boolean", ~found if negated else found, column.bound)

    return Expression("boolean", of.variables, run, of.at)


def _in(tree: Any, scope: Scope) -> Expression:
    items = [] if tree.other == rdflib.RDF.nil else list(tree.other)
    a = _operand(tree.expr, scope)
    each = [_compared(a, "=", _operand(item, scope), item, scope) for item in items]
    found = _any(each) if each else _fixed("boolean", False, place(tree) or 0)
    return _mapped("boolean", np.logical_not, found) if tree.op == "NOT IN" else found


def _any(of: list[Expression]) -> Expression:
    """True where one is; an error where one is and none is true."""

    def run(context: Context, table: Table) -> Column:
        columns = [each.run(context, table) for each in of]
        value = np.zeros(table.rows, np.bool_)
        for column in columns:
            value |= column.there & column.values
        bound = _together(columns)
        return Column("boolean", value, None if bound is None else bound | value)

    return Expression("boolean", frozenset().union(*(e.variables for e in of)), run, of[0].at)


def _all(of: list[Expression]) -> Expression:
    """False where one is; an error where one is and none is false."""

    def run(context: Context, table: Table) -> Column:
        columns = [each.run(context, table) for each in of]
        value = np.ones(table.rows, np.bool_)
        for column in columns:
            value &= ~column.there | column.values
        bound = _together(columns)
        return Column("boolean", value, None if bound is None else bound | ~value)

    return Expression("boolean", frozenset().union(*(e.variables for e in of)), run, of[0].at)


def _logical(combine: Callable[[list[Expression]], Expression]) -> Any:
    def make(tree: Any, scope: Scope) -> Expression:
        return combine([condition(each, scope) for each in (tree.expr, *tree.other)])

    return make


def _not(tree: Any, scope: Scope) -> Expression:
    return _mapped("boolean", np.logical_not, condition(tree.expr, scope))


def _bound(tree: Any, scope: Scope) -> Expression:
    scope.variable(tree.arg)
    name = str(tree.arg)

    def run(_: Context, table: Table) -> Column:
        column = table.columns.get(name)
        there = np.zeros(table.rows, np.bool_) if column is None else column.there
        return Column("boolean", there)

    return Expression("boolean", frozenset({name}), run, place(tree) or 0)


def _same_kind(trees: Iterable[Any], scope: Scope) -> list[Expression]:
    of = [expression(each, scope) for each in trees]
    for each in of:
        if each.kind != of[0].kind:
            raise scope.error(f"{word(of[0].kind)} here and {word(each.kind)} there", each.at)
    return of


def _if(tree: Any, scope: Scope) -> Expression:
    test = condition(tree.arg1, scope)
    yes, no = _same_kind((tree.arg2, tree.arg3), scope)

    def run(context: Context, table: Table) -> Column:
        which, a, b = (each.run(context, table) for each in (test, yes, no))
        there = which.there & np.where(which.values, a.there, b.there)
        return Column(yes.kind, np.where(which.values, a.values, b.values), there)

    return Expression(yes.kind, test.variables | yes.variables | no.variables, run, test.at)


def _coalesce(tree: Any, scope: Scope) -> Expression:
    of = _same_kind(tree.arg, scope)

    def run(context: Context, table: Table) -> Column:
        first, *others = (each.run(context, table) for each in of)
        value, there = first.values, first.there
        for column in others:
            value = np.where(there, value, column.values)
            there = there | column.there
        return Column(of[0].kind, value, there)

    return Expression(of[0].kind, frozenset().union(*(e.variables for e in of)), run, of[0].at)


def _same_term(tree: Any, scope: Scope) -> Expression:
    return _compared(_operand(tree.arg1, scope), "=", _operand(tree.arg2, scope), tree, scope)


def _str(tree: Any, scope: Scope) -> Expression:
    of = _operand(tree.arg, scope)
    if isinstance(of, _Constant) or of.kind == "text":
        return _text(of, scope)
    if of.kind != "thing":
        raise scope.error(f"{word(of.kind)} has no name", tree)
    return _mapped("text", lambda codes: codes, of)


def _text_to(kind: ColumnKind, function: Callable[[str], Any]) -> Any:
    def make(tree: Any, scope: Scope) -> Expression:
        return _of_names(kind, function, _text(_operand(tree.arg, scope), scope))

    return make


def _constant_text(tree: Any, scope: Scope) -> str:
    if not (isinstance(tree, rdflib.Literal) and thing_named(tree) is not None):
        raise scope.error('this has to be a constant: write "..."', tree)
    return str(tree)


def _text_and(function: Callable[[str, str], bool]) -> Any:
    def make(tree: Any, scope: Scope) -> Expression:
        part = _constant_text(tree.arg2, scope)
        of = _text(_operand(tree.arg1, scope), scope)
        return _of_names("boolean", lambda name: function(name, part), of)

    return make


def _regex(tree: Any, scope: Scope) -> Expression:
    letters = _constant_text(tree.flags, scope) if tree.flags is not None else ""
    flags = regex.V0
    for letter in letters:
        if letter not in "imsx":
            raise scope.error(f"the flag {letter} is not one of i, m, s, x", tree.flags)
        flags |= {"i": regex.I, "m": regex.M, "s": regex.S, "x": regex.X}[letter]
    written = _constant_text(tree.pattern, scope)
    try:
        pattern = regex.compile(written, flags)
    except (regex.error, ValueError, OverflowError, RecursionError) as error:
        raise scope.error(f"no regular expression: {error}", tree.pattern) from None
    of = _text(_operand(tree.text, scope), scope)
    return _of_names("boolean", lambda name: _found(pattern, name), of)


def _found(pattern: regex.Pattern[str], name: str) -> bool:
    """Whether a pattern occurs in a name; some patterns take exponential time."""
    try:
        return pattern.search(name, timeout=REGEX_SECONDS.value) is not None
    except TimeoutError:
        raise LimitError(
            f"the regular expression {pattern.pattern[:40]!r} takes longer than "
            f"{REGEX_SECONDS.value:g} s for one name: nest no repetitions, or set "
            f"{REGEX_SECONDS.variable}"
        ) from None


def centres(keys: NDArray[np.int64], voxel_size: float) -> NDArray[Any]:
    """(N, 3) the centres of (N,) voxels, metres."""
    points: NDArray[Any] = (voxels_of_keys(keys) + 0.5) * voxel_size
    return points


def _function(tree: Any, scope: Scope) -> Expression:
    name = thing_named(tree.iri)
    given = list(tree.expr or ())
    takes = {"x": 1, "y": 1, "z": 1, "distance": 2}.get(str(name))
    if takes is None or not scope.is_function(str(tree.iri)):
        raise scope.error(f"there is no function {name}: :x, :y, :z and :distance are", tree)
    if len(given) != takes:
        raise scope.error(f"{name} takes {takes} voxel{'s' * (takes > 1)}, not {len(given)}", tree)
    of = [expression(each, scope) for each in given]
    for each in of:
        if each.kind != "voxel":
            raise scope.error(f"{name} takes voxels, and this is {word(each.kind)}", each.at)

    def run(context: Context, table: Table) -> Column:
        columns = [each.run(context, table) for each in of]
        if name == "distance":
            a, b = (voxels_of_keys(column.values).astype(float) for column in columns)
            value: NDArray[Any] = np.linalg.norm(a - b, axis=1) * context.voxel_size
        else:
            value = centres(columns[0].values, context.voxel_size)[:, "xyz".index(str(name))]
        return Column("number", value, _together(columns))

    variables = frozenset().union(*(each.variables for each in of))
    return Expression("number", variables, run, place(tree) or 0)


_MAKERS: Mapping[str, Callable[[Any, Scope], Expression]] = {
    "RelationalExpression": _relational,
    "ConditionalAndExpression": _logical(_all),
    "ConditionalOrExpression": _logical(_any),
    "AdditiveExpression": _arithmetic,
    "MultiplicativeExpression": _arithmetic,
    "UnaryNot": _not,
    "UnaryMinus": _unary(np.negative, "expr"),
    "UnaryPlus": _unary(np.positive, "expr"),
    "Builtin_ABS": _unary(np.abs, "arg"),
    "Builtin_CEIL": _unary(np.ceil, "arg"),
    "Builtin_FLOOR": _unary(np.floor, "arg"),
    "Builtin_ROUND": _unary(_half_up, "arg"),
    "Builtin_BOUND": _bound,
    "Builtin_IF": _if,
    "Builtin_COALESCE": _coalesce,
    "Builtin_sameTerm": _same_term,
    "Builtin_STR": _str,
    "Builtin_STRLEN": _text_to("number", len),
    "Builtin_UCASE": _text_to("text", str.upper),
    "Builtin_LCASE": _text_to("text", str.lower),
    "Builtin_STRSTARTS": _text_and(str.startswith),
    "Builtin_STRENDS": _text_and(str.endswith),
    "Builtin_CONTAINS": _text_and(str.__contains__),
    "Builtin_REGEX": _regex,
    "Builtin_EXISTS": lambda tree, scope: scope.exists(tree),
    "Builtin_NOTEXISTS": lambda tree, scope: scope.exists(tree),
    "Function": _function,
}
