"""What a checked query does, step by step: SPARQL's algebra with kinds, relations and constants."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from semmap.fields.queries.table import ColumnKind, LimitError, Names, Table
from semmap.fields.queries.statements import Relation
from semmap.limits import QUERY_SECONDS

if TYPE_CHECKING:
    from semmap.language.expressions import Expression

__all__ = [
    "Aggregate", "Basic", "Context", "Distinct", "Extend", "Filter", "Group", "Inline", "Join",
    "Left", "Minus", "Order", "Pattern", "Plan", "Project", "Side", "Slice", "Union",
]  # fmt: skip

Side = str | frozenset[str] | float
"""A variable by name, the things that a constant names, or a number."""


@dataclass
class Context:
    """What evaluation needs besides the plan."""

    voxel_size: float
    names: Names = field(default_factory=Names)
    began: float = field(default_factory=time.monotonic)

    def expect_time(self) -> None:
        """Raise a LimitError where the query has taken too long."""
        if QUERY_SECONDS.exceeded_by(time.monotonic() - self.began):
            raise LimitError(
                f"this takes longer than {QUERY_SECONDS.value:g} s: ask for less, or set "
                f"{QUERY_SECONDS.variable}"
            )


@dataclass(frozen=True, eq=False)
class Pattern:
    """Subject, property, object; `taken` is a name for the object of a constant."""

    subject: Side
    relation: Relation
    object: Side
    at: int
    taken: str | None = None

    @property
    def variables(self) -> frozenset[str]:
        """All names it binds."""
        sides = (self.subject, self.object, self.taken)
        return frozenset(side for side in sides if isinstance(side, str))


@dataclass(frozen=True, eq=False)
class Basic:
    """Patterns that hold together."""

    patterns: tuple[Pattern, ...]
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Join:
    """Both."""

    left: Plan
    right: Plan
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Left:
    """The left, with the right where there is one (OPTIONAL)."""

    left: Plan
    right: Plan
    conditions: tuple[Expression, ...]
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Minus:
    """The left without what is compatible with the right."""

    left: Plan
    right: Plan
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Union:
    """Either."""

    left: Plan
    right: Plan
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Filter:
    """What all conditions hold of."""

    of: Plan
    conditions: tuple[Expression, ...]
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Extend:
    """A variable more (BIND, AS)."""

    of: Plan
    name: str
    value: Expression
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Inline:
    """Rows of the text (VALUES)."""

    make: Callable[[Context], Table]
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Project:
    """Some of the variables."""

    of: Plan
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Distinct:
    """Each solution once."""

    of: Plan
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Slice:
    """Some of the solutions (OFFSET, LIMIT)."""

    of: Plan
    start: int
    length: int | None
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Order:
    """In an order: expressions, and True for the greatest first."""

    of: Plan
    by: tuple[tuple[Expression, bool], ...]
    variables: frozenset[str]


@dataclass(frozen=True, eq=False)
class Aggregate:
    """One number of a group; `of` is None for COUNT(*)."""

    name: str
    function: str
    of: Expression | None
    distinct: bool
    kind: ColumnKind


@dataclass(frozen=True, eq=False)
class Group:
    """A solution a group."""

    of: Plan
    keys: tuple[str, ...]
    aggregates: tuple[Aggregate, ...]
    whole: bool
    """True without GROUP BY: all is one group, even if there is nothing."""
    variables: frozenset[str]


Plan = (
    Basic | Join | Left | Minus | Union | Filter | Extend | Inline | Project | Distinct | Slice
    | Order | Group
)  # fmt: skip
