"""A plan, evaluated over whole columns.

What is bound already limits what is read next: constants and small tables go first, and the voxels
found so far go down as `within`, so that a chain of lazy maps is worked out there alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from semmap.language.expressions import Expression
from semmap.language.plan import (
    Aggregate,
    Basic,
    Context,
    Distinct,
    Extend,
    Filter,
    Group,
    Inline,
    Join,
    Left,
    Minus,
    Order,
    Pattern,
    Plan,
    Project,
    Slice,
    Union,
)
from semmap.fields.queries.table import (
    NOTHING,
    UNIT,
    Column,
    Table,
    codes_of,
    join,
    merge,
    minus,
    pairs,
    unbound,
    union,
)
from semmap.fields.queries.statements import Column as Stated
from semmap.fields.queries.statements import Numbers, Things, Voxels

__all__ = ["evaluate", "exists", "holds"]

Limits = Mapping[str, NDArray[np.int64]]
"""Ascending keys to which voxels may be limited: solutions elsewhere are not asked for."""

MOST_NAMES = 256
"""How many things are named to a relation at most; of more, all is read."""

MOST_PAIRS = 1 << 22
"""How many pairs of solutions are compared at a time in EXISTS."""


def holds(context: Context, condition: Expression, table: Table) -> NDArray[np.bool_]:
    """(N,) where a condition is true; an error is not."""
    column = condition.run(context, table)
    found: NDArray[np.bool_] = (
        column.values & column.there if column.bound is not None else (column.values)
    )
    return found


def _filtered(context: Context, conditions: tuple[Expression, ...], table: Table) -> Table:
    for condition in conditions:
        if table.rows:
            found = holds(context, condition, table)
            table = table if found.all() else table.take(found)
    return table


def evaluate(plan: Plan, context: Context, limits: Limits | None = None) -> Table:
    """The solutions of a plan."""
    context.expect_time()
    return _evaluate(plan, context, limits or {})


@singledispatch
def _evaluate(plan: Plan, context: Context, limits: Limits) -> Table:
    raise TypeError(plan)


@_evaluate.register
def _(plan: Basic, context: Context, limits: Limits) -> Table:
    return _basic(plan, context, limits, ())


def _basic(
    plan: Basic, context: Context, limits: Limits, conditions: tuple[Expression, ...]
) -> Table:
    table, left, waiting = UNIT, list(plan.patterns), list(conditions)
    while left:
        pattern = min(left, key=lambda each: _cost(each, table))
        left.remove(pattern)
        table = join(table, _stated(pattern, table, context, limits))
        context.expect_time()
        ready = [each for each in waiting if each.variables <= table.columns.keys()]
        waiting = [each for each in waiting if each not in ready]
        table = _filtered(context, tuple(ready), table)
        if table.rows == 0:
            return NOTHING
    return _filtered(context, tuple(waiting), table)


def _cost(pattern: Pattern, table: Table) -> tuple[bool, int, bool, int]:
    """What comes first: what is connected, has constants, has no numbers, stands first."""
    free = sum(isinstance(side, str) for side in (pattern.subject, pattern.object))
    new = pattern.variables - table.columns.keys()
    connected = not table.columns or bool(pattern.variables & table.columns.keys())
    return not connected, min(free, len(new)), _is_number(pattern), pattern.at


def _is_number(pattern: Pattern) -> bool:
    return pattern.relation.property.object == "number"


def _stated(pattern: Pattern, table: Table, context: Context, limits: Limits) -> Table:
    """What a relation states, as far as it can go with a table."""
    about = pattern.relation.property
    within = None
    if about.subject == "voxel" and isinstance(pattern.subject, str):
        within = table.keys(pattern.subject)
        within = limits.get(pattern.subject) if within is None else within
    subjects = _names(pattern.subject, about.subject, table, context)
    objects = _names(pattern.object, about.object, table, context)
    if (within is not None and not len(within)) or not all((subjects != [], objects != [])):
        return NOTHING
    stated = pattern.relation.statements(subjects=subjects, objects=objects, within=within)
    subject, object_ = _column(stated.subject, context), _column(stated.object, context)
    columns: dict[str, Column] = {}
    kept: NDArray[np.bool_] | None = None
    for side, column in ((pattern.subject, subject), (pattern.object, object_)):
        if isinstance(side, float):
            kept = column.values == side
        elif isinstance(side, str) and side in columns:
            kept = column.values == columns[side].values
        elif isinstance(side, str):
            columns[side] = column
    if pattern.taken is not None:
        columns[pattern.taken] = object_
    found = Table(len(subject), columns)
    found = found if kept is None else found.take(kept)
    several = any(
        isinstance(s, frozenset) and len(s) > 1 for s in (pattern.subject, pattern.object)
    )
    return found.distinct() if several or not columns else found


def _names(side: object, kind: str, table: Table, context: Context) -> list[str] | None:
    """The things to which a side is limited; None is all."""
    if isinstance(side, frozenset):
        return sorted(side)
    column = table.columns.get(side) if isinstance(side, str) and kind == "thing" else None
    if column is None or column.bound is not None:
        return None
    codes = np.unique(column.values)
    return [context.names.names[c] for c in codes.tolist()] if len(codes) <= MOST_NAMES else None


def _column(stated: Stated, context: Context) -> Column:
    match stated:
        case Voxels(keys):
            return Column("voxel", keys)
        case Things(codes, names):
            return Column("thing", context.names.codes(names)[codes])
        case Numbers(values):
            return Column("number", values)


def _narrowed(plan: Plan, table: Table, limits: Limits) -> Limits:
    """Limits for what is joined with a table."""
    found = dict(limits)
    for name in plan.variables:
        keys = table.keys(name)
        if keys is not None:
            found[name] = keys
    return found


def _certain(plan: Plan, table: Table) -> Limits:
    """Limits for what extends or reduces a table: only what it binds in each row."""
    return _narrowed(plan, table, {})


@_evaluate.register
def _(plan: Join, context: Context, limits: Limits) -> Table:
    left = evaluate(plan.left, context, limits)
    if left.rows == 0:
        return NOTHING
    return join(left, evaluate(plan.right, context, _narrowed(plan.right, left, limits)))


@_evaluate.register
def _(plan: Left, context: Context, limits: Limits) -> Table:
    left = evaluate(plan.left, context, limits)
    if left.rows == 0:
        return NOTHING
    right = evaluate(plan.right, context, _certain(plan.right, left))
    if right.rows == 0:
        return left
    rows = pairs(left, right)
    found = merge(left, right, rows)
    passed = np.ones(found.rows, np.bool_)
    for condition in plan.conditions:
        passed &= holds(context, condition, found)
    alone = np.ones(left.rows, np.bool_)
    alone[rows.left[passed]] = False
    found = found if passed.all() else found.take(passed)
    return union([found, left.take(alone)]) if alone.any() else found


@_evaluate.register
def _(plan: Minus, context: Context, limits: Limits) -> Table:
    left = evaluate(plan.left, context, limits)
    if left.rows == 0:
        return NOTHING
    return minus(left, evaluate(plan.right, context, _certain(plan.right, left)))


@_evaluate.register
def _(plan: Union, context: Context, limits: Limits) -> Table:
    return union([evaluate(each, context, limits) for each in (plan.left, plan.right)])


@_evaluate.register
def _(plan: Filter, context: Context, limits: Limits) -> Table:
    if isinstance(plan.of, Basic):
        return _basic(plan.of, context, limits, plan.conditions)
    return _filtered(context, plan.conditions, evaluate(plan.of, context, limits))


@_evaluate.register
def _(plan: Extend, context: Context, limits: Limits) -> Table:
    table = evaluate(plan.of, context, {n: k for n, k in limits.items() if n != plan.name})
    column = plan.value.run(context, table)
    return Table(table.rows, {**table.columns, plan.name: column})


@_evaluate.register
def _(plan: Inline, context: Context, limits: Limits) -> Table:
    return plan.make(context)


@_evaluate.register
def _(plan: Project, context: Context, limits: Limits) -> Table:
    inside = {name: keys for name, keys in limits.items() if name in plan.variables}
    return evaluate(plan.of, context, inside).only(plan.variables)


@_evaluate.register
def _(plan: Distinct, context: Context, limits: Limits) -> Table:
    return evaluate(plan.of, context, limits).distinct()


@_evaluate.register
def _(plan: Slice, context: Context, limits: Limits) -> Table:
    table = evaluate(plan.of, context)
    stop = table.rows if plan.length is None else min(table.rows, plan.start + plan.length)
    return table.take(np.arange(min(plan.start, stop), stop))


@_evaluate.register
def _(plan: Order, context: Context, limits: Limits) -> Table:
    table = evaluate(plan.of, context, limits)
    if table.rows < 2:
        return table
    ranks = []
    for by, descending in plan.by:
        rank = _ranks(by.run(context, table), context)
        ranks.append(-rank if descending else rank)
    return table.take(np.lexsort(ranks[::-1]))


def _ranks(column: Column, context: Context) -> NDArray[np.int64]:
    """The place of each value in ascending order; nothing comes first."""
    values = column.values
    if column.kind in ("thing", "text"):
        ranks = context.names.ranks()
        values = ranks[values] if len(ranks) else values
    places = np.unique(values, return_inverse=True)[1].astype(np.int64)
    return np.where(column.there, places, -1)


@_evaluate.register
def _(plan: Group, context: Context, limits: Limits) -> Table:
    table = evaluate(plan.of, context)
    if plan.whole:
        first, group = np.zeros(0, np.intp), np.zeros(table.rows, np.intp)
        count, columns = 1, {}
    elif table.rows == 0:
        return NOTHING
    else:
        keys = [name for name in plan.keys if name in table.columns]
        codes = codes_of(table, keys) if keys else np.zeros(table.rows, np.int64)
        _, first, group = np.unique(codes, return_index=True, return_inverse=True)
        count = len(first)
        columns = {name: table.columns[name].take(first) for name in keys}
    for each in plan.aggregates:
        columns[each.name] = _aggregated(each, context, table, group, count)
    return Table(count, columns)


def _aggregated(
    each: Aggregate, context: Context, table: Table, group: NDArray[np.intp], count: int
) -> Column:
    """One value a group; what has no value does not count (as rdflib has it for sums, too)."""
    if each.of is None:
        if each.distinct:
            rows = Table(table.rows, {**table.columns, "*group": Column("number", group)})
            group = rows.distinct().columns["*group"].values
        return Column("number", np.bincount(group, minlength=count))
    column = each.of.run(context, table)
    there = np.flatnonzero(column.there)
    of, values = group[there], column.values[there]
    if each.distinct and len(there):
        both = {"*group": Column("number", of), "*value": Column(column.kind, values)}
        once = Table(len(there), both).distinct()
        of, values = once.columns["*group"].values, once.columns["*value"].values
    counts = np.bincount(of, minlength=count)
    match each.function:
        case "Count":
            return Column("number", counts)
        case "Sum":
            return Column("number", np.bincount(of, values, count))
        case "Avg":
            return Column("number", np.bincount(of, values, count) / np.maximum(counts, 1))
    if len(of) == 0:
        return unbound(column.kind, count)
    # The first of each group, in an order in which that is the one sought.
    rank = np.arange(len(of))
    if each.function != "Sample":
        rank = _ranks(Column(column.kind, values), context)
    order = np.lexsort((-rank if each.function == "Max" else rank, of))
    starts = np.flatnonzero(np.diff(of[order], prepend=-1))
    result = np.zeros(count, values.dtype)
    result[of[order][starts]] = values[order][starts]
    return Column(column.kind, result, None if counts.all() else counts > 0)


def exists(
    plan: Plan, correlated: tuple[Expression, ...]
) -> Callable[[Context, Table], NDArray[np.bool_]]:
    """Where a table has a compatible solution of a plan of which conditions hold that need both."""

    def run(context: Context, table: Table) -> NDArray[np.bool_]:
        found = np.zeros(table.rows, np.bool_)
        if table.rows == 0:
            return found
        other = evaluate(plan, context, _certain(plan, table))
        if other.rows == 0:
            return found
        if not correlated:
            shared = [name for name in table.columns if name in other.columns]
            if not shared:
                return ~found
            other = other.only(shared).distinct()
        step = max(1, MOST_PAIRS // other.rows)
        if not correlated or any(name in other.columns for name in table.columns):
            step = table.rows
        for begin in range(0, table.rows, step):
            some = table.take(np.arange(begin, min(begin + step, table.rows)))
            rows = pairs(some, other)
            both = merge(some, other, rows)
            passed = np.ones(both.rows, np.bool_)
            context.expect_time()
            for condition in correlated:
                passed &= holds(context, condition, both)
            found[begin + rows.left[passed]] = True
        return found

    return run
