"""Evaluates checked queries, whole columns at a time (docs/decisions/one_evaluator.md).

Patterns with constants and few solutions are read first; the voxels found so far limit what is read
next, so that a chain of lazy maps is computed for these alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semmap.fields.queries.columns import (
    Demand,
    Entities,
    Numbers,
    StatementColumn,
    VoxelColumn,
)
from semmap.fields.queries.expressions import Context, evaluate_expression, is_true
from semmap.fields.queries.table import (
    EMPTY,
    UNIT,
    Table,
    TermColumn,
    codes_of,
    compatible_pairs,
    join,
    merge,
    minus,
    unbound,
    union,
)
from semmap.geometry.voxel_keys import sorted_unique
from semmap.language.algebra import (
    Aggregate,
    BasicGraphPattern,
    Distinct,
    Exists,
    Expression,
    Extend,
    Filter,
    GroupPattern,
    InlineData,
    Join,
    LeftJoin,
    Minus,
    OrderBy,
    Pattern,
    Project,
    SolutionSlice,
    TriplePattern,
    Union,
    VariableValue,
)
from semmap.language.schema import ValueKind

Limits = Mapping[str, NDArray[np.int64]]
"""For variables the ascending keys of voxels beyond which solutions are not needed."""

MOST_NAMES = 256
"""A relation is limited to the bound entities where these are at most so many."""

MOST_PAIRS = 1 << 22
"""So many pairs of solutions are compared at a time in EXISTS."""


def evaluate(pattern: Pattern, context: Context, limits: Limits | None = None) -> Table:
    """Return the solutions of a checked pattern within `limits`, or raise LimitError."""
    context.check_time()
    with np.errstate(over="ignore", invalid="ignore"):  # INF and NaN are numbers of SPARQL
        return _evaluate(pattern, context, limits or {})


def _evaluate(pattern: Pattern, context: Context, limits: Limits) -> Table:
    match pattern:
        case BasicGraphPattern():
            return _basic(pattern, context, limits, ())
        case Filter(of=BasicGraphPattern() as of):
            return _basic(of, context, limits, pattern.conditions)
        case Filter():
            return _filtered(pattern.conditions, context, evaluate(pattern.of, context, limits))
        case Union():
            sides = (pattern.left, pattern.right)
            return union([evaluate(side, context, limits) for side in sides])
        case Join() | LeftJoin() | Minus():
            return _combined(pattern, context, limits)
        case Extend():
            inside = {name: keys for name, keys in limits.items() if name != pattern.name}
            table = evaluate(pattern.of, context, inside)
            column = evaluate_expression(pattern.value, context, table)
            return Table(table.rows, {**table.columns, pattern.name: column})
        case InlineData():
            columns = {
                name: _inline_column(pattern.kinds[name], values, context)
                for name, values in pattern.values.items()
            }
            return Table(pattern.count, columns)
        case Project():
            inside = {name: keys for name, keys in limits.items() if name in pattern.variables}
            return evaluate(pattern.of, context, inside).only(pattern.variables)
        case Distinct():
            return evaluate(pattern.of, context, limits).distinct()
        case SolutionSlice():
            table = evaluate(pattern.of, context)
            stop = table.rows
            if pattern.length is not None:
                stop = min(stop, pattern.start + pattern.length)
            return table.take(np.arange(min(pattern.start, stop), stop))
        case OrderBy():
            return _ordered(pattern, evaluate(pattern.of, context, limits), context)
        case GroupPattern():
            return _grouped(pattern, context)


def _basic(
    pattern: BasicGraphPattern,
    context: Context,
    limits: Limits,
    conditions: tuple[Expression, ...],
) -> Table:
    """Join triple patterns, and filter as soon as the variables of a condition are bound."""
    table, left, waiting = UNIT, list(pattern.patterns), list(conditions)
    while left:
        triple = min(left, key=lambda each: _cost(each, table))
        left.remove(triple)
        table = join(table, _read(triple, table, context, limits))
        context.check_time()
        ready = [each for each in waiting if each.variables <= table.columns.keys()]
        waiting = [each for each in waiting if each not in ready]
        table = _filtered(tuple(ready), context, table)
        if table.rows == 0:
            return EMPTY
    return _filtered(tuple(waiting), context, table)


def _filtered(conditions: tuple[Expression, ...], context: Context, table: Table) -> Table:
    for condition in conditions:
        if table.rows:
            found = is_true(condition, context, table)
            table = table if found.all() else table.take(found)
    return table


def _cost(triple: TriplePattern, table: Table) -> tuple[bool, int, bool, int]:
    """Return what is read first: connected to the table, few variables, no numbers, first."""
    free = sum(isinstance(side, str) for side in (triple.subject, triple.object))
    new = triple.variables - table.columns.keys()
    connected = not table.columns or bool(triple.variables & table.columns.keys())
    numeric = triple.property.object == "number"
    return not connected, min(free, len(new)), numeric, triple.position


def _read(triple: TriplePattern, table: Table, context: Context, limits: Limits) -> Table:
    """Return the solutions of a triple pattern, limited to those that can join a table."""
    about = triple.property
    within = None
    if about.subject == "voxel" and isinstance(triple.subject, str):
        within = table.keys(triple.subject)
        within = limits.get(triple.subject) if within is None else within
    subjects = _wanted_names(triple.subject, about.subject, table, context)
    objects = _wanted_names(triple.object, about.object, table, context)
    if subjects == [] or objects == [] or (within is not None and not len(within)):
        return EMPTY
    relation = context.relation(about)
    statements = relation.statements(Demand(subjects, objects, within))
    subject, object_ = (_column(each, context) for each in statements)
    columns: dict[str, TermColumn] = {}
    kept: NDArray[np.bool_] | None = None
    for side, column in ((triple.subject, subject), (triple.object, object_)):
        if isinstance(side, float):
            kept = column.values == side
        elif isinstance(side, str) and side in columns:
            kept = column.values == columns[side].values
        elif isinstance(side, str):
            columns[side] = column
    if triple.object_variable is not None:
        columns[triple.object_variable] = object_
    found = Table(len(subject), columns)
    found = found if kept is None else found.take(kept)
    several = any(
        isinstance(side, frozenset) and len(side) > 1 for side in (triple.subject, triple.object)
    )
    return found.distinct() if several or not columns else found


def _wanted_names(side: object, kind: str, table: Table, context: Context) -> list[str] | None:
    """Return the entities to which a side is limited; None for all."""
    if isinstance(side, frozenset):
        return sorted(side)
    column = table.columns.get(side) if isinstance(side, str) and kind == "entity" else None
    if column is None or column.bound is not None:
        return None
    codes = sorted_unique(column.values)
    return [context.names.names[c] for c in codes.tolist()] if len(codes) <= MOST_NAMES else None


def _column(stated: StatementColumn, context: Context) -> TermColumn:
    match stated:
        case VoxelColumn(keys):
            return TermColumn("voxel", keys)
        case Entities(codes, names):
            return TermColumn("entity", context.names.codes(names)[codes])
        case Numbers(values):
            return TermColumn("number", values)


def _narrowed(pattern: Pattern, table: Table, limits: Limits) -> Limits:
    """Return limits for a pattern whose solutions are joined with a table."""
    found = dict(limits)
    for name in pattern.variables:
        keys = table.keys(name)
        if keys is not None:
            found[name] = keys
    return found


def _combined(pattern: Join | LeftJoin | Minus, context: Context, limits: Limits) -> Table:
    left = evaluate(pattern.left, context, limits)
    if left.rows == 0:
        return EMPTY
    joined = isinstance(pattern, Join)
    inside = _narrowed(pattern.right, left, limits if joined else {})
    right = evaluate(pattern.right, context, inside)
    if isinstance(pattern, LeftJoin):
        return _left_join(pattern, left, right, context)
    return join(left, right) if joined else minus(left, right)


def _left_join(pattern: LeftJoin, left: Table, right: Table, context: Context) -> Table:
    if right.rows == 0:
        return left
    rows = compatible_pairs(left, right)
    found = merge(left, right, rows)
    passed = np.ones(found.rows, np.bool_)
    for condition in pattern.conditions:
        passed &= is_true(condition, context, found)
    alone = np.ones(left.rows, np.bool_)
    alone[rows.left[passed]] = False
    found = found if passed.all() else found.take(passed)
    return union([found, left.take(alone)]) if alone.any() else found


def _inline_column(kind: ValueKind, values: tuple[Any, ...], context: Context) -> TermColumn:
    bound = np.array([value is not None for value in values], np.bool_)
    if kind == "entity":
        codes = [0 if name is None else context.names.code(name) for name in values]
        column = np.array(codes, np.int64)
    else:
        plain = [0 if value is None else value for value in values]
        column = np.array(plain, np.bool_ if kind == "boolean" else np.float64)
    return TermColumn(kind, column, bound)


def _ordered(pattern: OrderBy, table: Table, context: Context) -> Table:
    if table.rows < 2:
        return table
    ranks = []
    for by, descending in pattern.by:
        rank = _ranks(evaluate_expression(by, context, table), context)
        ranks.append(-rank if descending else rank)
    return table.take(np.lexsort(ranks[::-1]))


def _ranks(column: TermColumn, context: Context) -> NDArray[np.int64]:
    """Return the rank of each value in ascending order; unbound ones come first."""
    values = column.values
    if column.kind in ("entity", "text"):
        ranks = context.names.ranks()
        values = ranks[values] if len(ranks) else values
    places = np.unique(values, return_inverse=True)[1].astype(np.int64)
    return np.where(column.is_bound, places, -1)


def _grouped(pattern: GroupPattern, context: Context) -> Table:
    counted = _counted(pattern, context)
    if counted is not None:
        return counted
    table = evaluate(pattern.of, context)
    if pattern.whole:
        group = np.zeros(table.rows, np.intp)
        count, columns = 1, {}
    elif table.rows == 0:
        return EMPTY
    else:
        keys = [name for name in pattern.keys if name in table.columns]
        codes = codes_of(table, keys) if keys else np.zeros(table.rows, np.int64)
        _, first, group = np.unique(codes, return_index=True, return_inverse=True)
        count = len(first)
        columns = {name: table.columns[name].take(first) for name in keys}
    for each in pattern.aggregates:
        columns[each.name] = _aggregated(each, context, table, group, count)
    return Table(count, columns)


def _counted(pattern: GroupPattern, context: Context) -> Table | None:
    """Return counts of the voxels of entities where the relation knows them without reading them.

    That is for a group that only counts one pattern `?voxel property entity`.
    """
    of = pattern.of
    if not isinstance(of, BasicGraphPattern) or len(of.patterns) != 1:
        return None
    (triple,) = of.patterns
    voxel, entity = triple.subject, triple.object
    keys = (entity,) if isinstance(entity, str) else ()
    if (
        not isinstance(voxel, str)
        or (triple.property.subject, triple.property.object) != ("voxel", "entity")
        or triple.object_variable is not None
        or not (isinstance(entity, str) or (isinstance(entity, frozenset) and len(entity) == 1))
        or pattern.keys != keys
        or not all(
            _counts_voxels(each, voxel) or _is_key(each, keys) for each in pattern.aggregates
        )
    ):
        return None
    counts = getattr(context.relation(triple.property), "counts", lambda _: None)
    found = counts(None if keys else entity)
    if found is None:
        return None
    if pattern.whole:
        found = {name: n for name, n in found.items() if name in entity} or {"": 0}
    else:
        found = {name: n for name, n in found.items() if n}
    named = TermColumn("entity", context.names.codes(tuple(found)))
    numbers = TermColumn("number", np.array([*found.values()], np.int64))
    columns = {a.name: named if _is_key(a, keys) else numbers for a in pattern.aggregates}
    return Table(len(found), columns | dict.fromkeys(keys, named))


def _counts_voxels(each: Aggregate, voxel: str) -> bool:
    """Whether an aggregate is COUNT(*) or COUNT of a variable that is different in each row."""
    named = isinstance(each.of, VariableValue) and each.of.name == voxel
    return each.function == "Count" and (each.of is None or named)


def _is_key(each: Aggregate, keys: tuple[str, ...]) -> bool:
    """Whether an aggregate is the key of its group: rdflib samples keys that are projected."""
    return each.function == "Sample" and isinstance(each.of, VariableValue) and each.of.name in keys


def _aggregated(
    each: Aggregate, context: Context, table: Table, group: NDArray[np.intp], count: int
) -> TermColumn:
    """Return one value for each group; rows without a value do not count, as in rdflib."""
    if each.of is None:
        if each.distinct:
            rows = Table(table.rows, {**table.columns, "*group": TermColumn("number", group)})
            group = rows.distinct().columns["*group"].values
        return TermColumn("number", np.bincount(group, minlength=count))
    column = evaluate_expression(each.of, context, table)
    there = np.flatnonzero(column.is_bound)
    of, values = group[there], column.values[there]
    if each.distinct and len(there):
        both = {"*group": TermColumn("number", of), "*value": TermColumn(column.kind, values)}
        once = Table(len(there), both).distinct()
        of, values = once.columns["*group"].values, once.columns["*value"].values
    counts = np.bincount(of, minlength=count)
    match each.function:
        case "Count":
            return TermColumn("number", counts)
        case "Sum":
            return TermColumn("number", np.bincount(of, values, count))
        case "Avg":
            return TermColumn("number", np.bincount(of, values, count) / np.maximum(counts, 1))
    if len(of) == 0:
        return unbound(column.kind, count)
    # Sort so that the row sought is the first of its group.
    rank = np.arange(len(of))
    if each.function != "Sample":
        rank = _ranks(TermColumn(column.kind, values), context)
    order = np.lexsort((-rank if each.function == "Max" else rank, of))
    starts = np.flatnonzero(np.diff(of[order], prepend=-1))
    result = np.zeros(count, values.dtype)
    result[of[order][starts]] = values[order][starts]
    return TermColumn(column.kind, result, counts > 0)


@evaluate_expression.register
def _(expression: Exists, context: Context, table: Table) -> TermColumn:
    found = _exists(expression, context, table)
    return TermColumn("boolean", ~found if expression.negated else found)


def _exists(expression: Exists, context: Context, table: Table) -> NDArray[np.bool_]:
    """Return for which rows there is a compatible solution that meets all conditions."""
    found = np.zeros(table.rows, np.bool_)
    if table.rows == 0:
        return found
    other = evaluate(expression.pattern, context, _narrowed(expression.pattern, table, {}))
    if other.rows == 0:
        return found
    shared = [name for name in table.columns if name in other.columns]
    if not expression.conditions:
        if not shared:
            return ~found
        other = other.only(shared).distinct()
    step = table.rows if shared else max(1, MOST_PAIRS // other.rows)
    for begin in range(0, table.rows, step):
        some = table.take(np.arange(begin, min(begin + step, table.rows)))
        rows = compatible_pairs(some, other)
        both = merge(some, other, rows)
        passed = np.ones(both.rows, np.bool_)
        context.check_time()
        for condition in expression.conditions:
            passed &= is_true(condition, context, both)
        found[begin + rows.left[passed]] = True
    return found
