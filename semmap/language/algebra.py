"""Checked queries: SPARQL's algebra (1.1, sections 17, 18.2) with properties and kinds resolved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from semmap.language.schema import Function, Property, ValueKind

if TYPE_CHECKING:
    import regex

Variables = frozenset[str]
Side = str | frozenset[str] | float
"""The name of a variable, the entities that a constant stands for, or a number."""


@dataclass(frozen=True, eq=False)
class _Node:
    """A part of a query."""

    @cached_property
    def variables(self) -> Variables:
        """The variables that a pattern may bind or an expression reads: its own, and its parts'."""
        found = frozenset(self._own())
        for value in vars(self).values():
            for part in value if isinstance(value, tuple) else (value,):
                if isinstance(part, _Node):
                    found |= part.variables
        return found

    def _own(self) -> Iterable[str]:
        return ()


@dataclass(frozen=True, eq=False)
class Expression(_Node):
    """A value for each solution. A row whose evaluation fails has none."""

    kind: ValueKind  # the kind of the value
    position: int  # in the text
    range: str | None  # the semantic type of the entities that are its values, if known


@dataclass(frozen=True, eq=False)
class VariableValue(Expression):
    """The value of a variable."""

    name: str

    def _own(self) -> Iterable[str]:
        return (self.name,)


@dataclass(frozen=True, eq=False)
class Constant(Expression):
    """A truth value, a number, a text, or the name of an entity."""

    value: bool | float | str


@dataclass(frozen=True, eq=False)
class Arithmetic(Expression):
    """Numbers with operators between them, evaluated from left to right."""

    operands: tuple[Expression, ...]  # N numbers
    operators: tuple[str, ...]  # N - 1 of "+", "-", "*" and "/"


@dataclass(frozen=True, eq=False)
class Call(Expression):
    """An operator or function of SPARQL, such as "<", "!", "STRLEN", "UnaryMinus"; or "boolean".

    "boolean" is the effective boolean value; "&&", "||" and "COALESCE" take any number of
    arguments.
    """

    function: str
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, eq=False)
class ExtensionCall(Expression):
    """A function that the back end offers (SPARQL 1.1, section 17.6)."""

    function: Function
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, eq=False)
class Membership(Expression):
    """Whether an entity is among those that a constant stands for; or is not, if negated."""

    of: Expression
    entities: frozenset[str]
    negated: bool


@dataclass(frozen=True, eq=False)
class RegexMatch(Expression):
    """Whether a regular expression matches somewhere in a text."""

    of: Expression
    pattern: regex.Pattern[str]


@dataclass(frozen=True, eq=False)
class Bound(Expression):
    """Whether a variable has a value."""

    name: str

    def _own(self) -> Iterable[str]:
        return (self.name,)


@dataclass(frozen=True, eq=False)
class Exists(Expression):
    """Whether a pattern has a solution that is compatible with the row; or has none, if negated."""

    pattern: Pattern  # evaluated on its own
    conditions: tuple[Expression, ...]  # those that read variables from outside of the pattern
    outer: Variables  # the variables that the row may bind
    negated: bool

    @cached_property
    def variables(self) -> Variables:
        """The variables of the row that pattern and conditions read."""
        parts = (self.pattern, *self.conditions)
        return frozenset().union(*(each.variables for each in parts)) & self.outer


@dataclass(frozen=True, eq=False)
class TriplePattern(_Node):
    """Subject, property and object."""

    subject: Side
    property: Property
    object: Side
    position: int  # in the text
    # a variable that gets the object, too; for an object that is a constant
    object_variable: str | None = None

    def _own(self) -> Iterable[str]:
        sides = (self.subject, self.object, self.object_variable)
        return (side for side in sides if isinstance(side, str))


@dataclass(frozen=True, eq=False)
class BasicGraphPattern(_Node):
    """Triple patterns that must all match."""

    patterns: tuple[TriplePattern, ...]


@dataclass(frozen=True, eq=False)
class Join(_Node):
    """Compatible pairs of solutions of two patterns."""

    left: Pattern
    right: Pattern


@dataclass(frozen=True, eq=False)
class LeftJoin(_Node):
    """Solutions of the left pattern, joined with the right one where possible (OPTIONAL)."""

    left: Pattern
    right: Pattern
    conditions: tuple[Expression, ...]  # all must be true for a pair to be joined


@dataclass(frozen=True, eq=False)
class Minus(_Node):
    """Solutions of the left pattern that are compatible with none of the right one."""

    left: Pattern
    right: Pattern

    @cached_property
    def variables(self) -> Variables:
        """The variables of the left side."""
        return self.left.variables


@dataclass(frozen=True, eq=False)
class Union(_Node):
    """Solutions of either pattern."""

    left: Pattern
    right: Pattern


@dataclass(frozen=True, eq=False)
class Filter(_Node):
    """Solutions for which all conditions are true."""

    of: Pattern
    conditions: tuple[Expression, ...]


@dataclass(frozen=True, eq=False)
class Extend(_Node):
    """Solutions with one more variable (BIND, AS)."""

    of: Pattern
    name: str
    value: Expression

    def _own(self) -> Iterable[str]:
        return (self.name,)


@dataclass(frozen=True, eq=False)
class InlineData(_Node):
    """Solutions that are given in the text (VALUES)."""

    count: int  # number of solutions
    # for each variable the values in all solutions; None where it is not bound
    values: Mapping[str, tuple[Any, ...]]
    kinds: Mapping[str, ValueKind]  # for each variable the kind of its values

    def _own(self) -> Iterable[str]:
        return self.values


@dataclass(frozen=True, eq=False)
class Project(_Node):
    """Solutions with some of their variables."""

    of: Pattern
    names: Variables

    @cached_property
    def variables(self) -> Variables:
        """The names."""
        return self.names


@dataclass(frozen=True, eq=False)
class Distinct(_Node):
    """Each solution once."""

    of: Pattern


@dataclass(frozen=True, eq=False)
class SolutionSlice(_Node):
    """Solutions from `start` on, at most `length` (OFFSET, LIMIT)."""

    of: Pattern
    start: int
    length: int | None


@dataclass(frozen=True, eq=False)
class OrderBy(_Node):
    """Solutions in the order of expressions, each with True for descending."""

    of: Pattern
    by: tuple[tuple[Expression, bool], ...]


@dataclass(frozen=True, eq=False)
class Aggregate:
    """One value for each group."""

    name: str  # the variable that gets the value
    function: str  # "Count", "Sum", "Avg", "Min", "Max" or "Sample"
    of: Expression | None  # None for COUNT(*)
    distinct: bool  # whether each value counts once
    kind: ValueKind  # the kind of the result


@dataclass(frozen=True, eq=False)
class GroupPattern(_Node):
    """One solution for each group."""

    of: Pattern
    keys: tuple[str, ...]  # the variables to group by
    aggregates: tuple[Aggregate, ...]
    whole: bool  # True without GROUP BY: all solutions are one group, even where there are none

    @cached_property
    def variables(self) -> Variables:
        """The keys and the aggregates."""
        return frozenset(self.keys).union(each.name for each in self.aggregates)


Pattern = (
    BasicGraphPattern
    | Join
    | LeftJoin
    | Minus
    | Union
    | Filter
    | Extend
    | InlineData
    | Project
    | Distinct
    | SolutionSlice
    | OrderBy
    | GroupPattern
)
