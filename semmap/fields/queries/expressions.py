"""Evaluates expressions, a column at a time (SPARQL 1.1, section 17); an error is no value."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from semmap.fields.queries.columns import Catalogue, StatementRelation
from semmap.fields.queries.table import LimitError, NameCodes, Table, TermColumn, unbound
from semmap.fields.queries.voxel_functions import evaluate_function
from semmap.language.algebra import (
    Arithmetic,
    Bound,
    Call,
    Constant,
    Expression,
    ExtensionCall,
    Membership,
    RegexMatch,
    VariableValue,
)
from semmap.language.schema import Property, ValueKind
from semmap.limits import QUERY_SECONDS, REGEX_SECONDS

if TYPE_CHECKING:
    import regex

Values = NDArray[Any]


class Context:
    """The context of one evaluation: voxels of `voxel_size` metres, and `names` by code."""

    def __init__(self, catalogue: Catalogue) -> None:
        self.voxel_size = catalogue.voxel_size
        self.names = NameCodes()
        self._catalogue = catalogue
        self._relations: dict[Property, StatementRelation] = {}
        self._began = time.monotonic()

    def relation(self, property: Property) -> StatementRelation:
        """Return the relation of a property, the same one for the whole query."""
        if property not in self._relations:
            self._relations[property] = self._catalogue.relation(property)
        return self._relations[property]

    def check_time(self) -> None:
        """Raise LimitError if the query has taken too long."""
        if QUERY_SECONDS.exceeded_by(time.monotonic() - self._began):
            raise LimitError(
                f"this takes longer than {QUERY_SECONDS.value:g} s: add narrower patterns, or set "
                f"{QUERY_SECONDS.variable}"
            )


@singledispatch
def evaluate_expression(expression: Expression, context: Context, table: Table) -> TermColumn:
    """Return the values of an expression for the rows of a table, or raise LimitError."""
    raise TypeError(f"{type(expression).__name__} cannot be evaluated")


def is_true(condition: Expression, context: Context, table: Table) -> NDArray[np.bool_]:
    """Return where a condition is true: (rows,). An error is not true."""
    column = evaluate_expression(condition, context, table)
    found: NDArray[np.bool_] = column.values
    return found if column.bound is None else found & column.bound


@evaluate_expression.register
def _(expression: VariableValue, context: Context, table: Table) -> TermColumn:
    return table.columns.get(expression.name) or unbound(expression.kind, table.rows)


@evaluate_expression.register
def _(expression: Constant, context: Context, table: Table) -> TermColumn:
    value = expression.value
    if isinstance(value, str):
        return TermColumn(expression.kind, np.full(table.rows, context.names.code(value), np.int64))
    return TermColumn(expression.kind, np.broadcast_to(np.asarray(value), (table.rows,)))


@evaluate_expression.register
def _(expression: Bound, context: Context, table: Table) -> TermColumn:
    column = table.columns.get(expression.name)
    bound = np.zeros(table.rows, np.bool_) if column is None else column.is_bound
    return TermColumn("boolean", bound)


@evaluate_expression.register
def _(expression: Membership, context: Context, table: Table) -> TermColumn:
    column = evaluate_expression(expression.of, context, table)
    found = np.isin(column.values, context.names.codes(sorted(expression.entities)))
    return TermColumn("boolean", ~found if expression.negated else found, column.bound)


@evaluate_expression.register
def _(expression: RegexMatch, context: Context, table: Table) -> TermColumn:
    column = evaluate_expression(expression.of, context, table)
    return _of_names("boolean", lambda name: _matches(expression.pattern, name), column, context)


@evaluate_expression.register
def _(expression: Arithmetic, context: Context, table: Table) -> TermColumn:
    columns = [evaluate_expression(each, context, table) for each in expression.operands]
    bound = _all_bound(columns)
    value = columns[0].values
    for operator, column in zip(expression.operators, columns[1:], strict=True):
        other = column.values
        if operator == "/":
            zero = other == 0
            if zero.any():
                bound = ~zero if bound is None else bound & ~zero
            value = np.divide(value, np.where(zero, 1, other))
        else:
            value = _OPERATORS[operator](value, other)
    return TermColumn("number", value, bound)


@evaluate_expression.register
def _(expression: ExtensionCall, context: Context, table: Table) -> TermColumn:
    columns = [evaluate_expression(each, context, table) for each in expression.arguments]
    arguments = [column.values for column in columns]
    values = evaluate_function(expression.function.name, arguments, context.voxel_size)
    return TermColumn("number", values, _all_bound(columns))


@evaluate_expression.register
def _(expression: Call, context: Context, table: Table) -> TermColumn:
    function, arguments = expression.function, expression.arguments
    of_text = OF_TEXT.get(function)
    if of_text is not None and arguments[0].kind == "text":
        column = evaluate_expression(arguments[0], context, table)
        constants = [str(each.value) for each in arguments[1:] if isinstance(each, Constant)]
        return _of_names(expression.kind, lambda name: of_text(name, *constants), column, context)
    columns = [evaluate_expression(each, context, table) for each in arguments]
    if function in _CHOICES:
        return _CHOICES[function](columns)
    values = [column.values for column in columns]
    if arguments[0].kind == "text" and function in _ORDERS:
        ranks = context.names.ranks()
        values = [ranks[each] for each in values]
    return TermColumn(expression.kind, ELEMENTWISE[function](*values), _all_bound(columns))


def _all_bound(columns: Iterable[TermColumn]) -> NDArray[np.bool_] | None:
    """Return where all columns have a value; None for everywhere."""
    bound: NDArray[np.bool_] | None = None
    for column in columns:
        if column.bound is not None:
            bound = column.bound if bound is None else bound & column.bound
    return bound


def _any(columns: list[TermColumn]) -> TermColumn:
    """Return true where one is; an error where none is true and one is an error."""
    value = np.zeros(len(columns[0]), np.bool_)
    for column in columns:
        value |= column.is_bound & column.values
    bound = _all_bound(columns)
    return TermColumn("boolean", value, None if bound is None else bound | value)


def _all(columns: list[TermColumn]) -> TermColumn:
    """Return false where one is; an error where none is false and one is an error."""
    value = np.ones(len(columns[0]), np.bool_)
    for column in columns:
        value &= ~column.is_bound | column.values
    bound = _all_bound(columns)
    return TermColumn("boolean", value, None if bound is None else bound | ~value)


def _if(columns: list[TermColumn]) -> TermColumn:
    which, yes, no = columns
    bound = which.is_bound & np.where(which.values, yes.is_bound, no.is_bound)
    return TermColumn(yes.kind, np.where(which.values, yes.values, no.values), bound)


def _coalesce(columns: list[TermColumn]) -> TermColumn:
    value, bound = columns[0].values, columns[0].is_bound
    for column in columns[1:]:
        value = np.where(bound, value, column.values)
        bound = bound | column.is_bound
    return TermColumn(columns[0].kind, value, bound)


def _of_names(
    kind: ValueKind, function: Callable[[str], Any], column: TermColumn, context: Context
) -> TermColumn:
    """Return a function of texts, evaluated once for each different text."""
    context.check_time()
    codes, places = np.unique(column.values, return_inverse=True)
    names = context.names.names
    each = [function(names[code]) if code < len(names) else function("") for code in codes]
    if kind == "text":
        each = [context.names.code(text) for text in each]
    values = np.array(each, np.int64 if kind == "text" else None)
    return TermColumn(kind, values[places] if len(codes) else values.astype(bool), column.bound)


def _matches(pattern: regex.Pattern[str], name: str) -> bool:
    """Whether a pattern occurs in a name; LimitError as some take exponential time."""
    try:
        return pattern.search(name, timeout=REGEX_SECONDS.value) is not None
    except TimeoutError:
        raise LimitError(
            f"the regular expression {pattern.pattern[:40]!r} takes longer than "
            f"{REGEX_SECONDS.value:g} s for one name: do not nest repetitions, or set "
            f"{REGEX_SECONDS.variable}"
        ) from None


def _is_not_zero(numbers: Values) -> Values:
    not_zero: Values = (numbers != 0) & ~np.isnan(numbers)
    return not_zero


def _round_half_up(numbers: Values) -> Values:
    whole = np.floor(numbers)
    rounded: Values = whole + (numbers - whole >= 0.5)  # a sum with 0.5 would be rounded
    return rounded


def _same(values: Values) -> Values:
    return values


_OPERATORS: Mapping[str, Callable[..., Values]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
}
_ORDERS: Mapping[str, Callable[..., Values]] = {
    "<": np.less,
    ">": np.greater,
    "<=": np.less_equal,
    ">=": np.greater_equal,
}
ELEMENTWISE: Mapping[str, Callable[..., Values]] = {
    **_ORDERS,
    "=": np.equal,
    "!=": np.not_equal,
    "!": np.logical_not,
    "boolean": _is_not_zero,
    "UnaryMinus": np.negative,
    "UnaryPlus": np.positive,
    "ABS": np.abs,
    "CEIL": np.ceil,
    "FLOOR": np.floor,
    "ROUND": _round_half_up,
    "STR": _same,  # entities and texts have the same codes
}
OF_TEXT: Mapping[str, Callable[..., Any]] = {
    "STRLEN": len,
    "UCASE": str.upper,
    "LCASE": str.lower,
    "STRSTARTS": str.startswith,
    "STRENDS": str.endswith,
    "CONTAINS": str.__contains__,
    "boolean": bool,
}
_CHOICES: Mapping[str, Callable[[list[TermColumn]], TermColumn]] = {
    "&&": _all,
    "||": _any,
    "IF": _if,
    "COALESCE": _coalesce,
}
