"""Where a triple pattern stands, and which graphs and inferences it reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from semmap.knowledge.triple_map import Value

if TYPE_CHECKING:
    from semmap.knowledge.fields.rows import FieldRows
    from semmap.knowledge.sparql.constants import Constants

Part = str | Value  # a variable by its name, or a constant


@dataclass(frozen=True)
class Chosen:
    """The graphs that FROM or USING choose (SPARQL 1.1, section 13.2): the map is not in them."""

    default: tuple[str, ...] = ()  # IRIs; the default graph is the union of these graphs
    named: tuple[str, ...] = ()  # IRIs of the graphs that GRAPH finds

    @classmethod
    def by(cls, clauses: Iterable[Any] | None) -> Chosen | None:
        """Return what the clauses of a text choose; None where there are none."""
        clauses = list(clauses or ())
        if not clauses:
            return None
        return cls(
            tuple(str(each.default) for each in clauses if each.default is not None),
            tuple(str(each.named) for each in clauses if each.named is not None),
        )


@dataclass(frozen=True)
class Inferred:
    """What inferences a map has, so that patterns look for no others."""

    properties: frozenset[str] = frozenset()  # of inferences
    classes: frozenset[str] = frozenset()  # that are inferred


NOTHING_INFERRED = Inferred()


@dataclass(frozen=True)
class MapGraph:
    """What patterns of a text are matched with."""

    constants: Constants  # what the IRIs of the text stand for
    namespace: str  # of the map's entities
    map_id: int
    inferred: Inferred = NOTHING_INFERRED  # the inferences that patterns match, too
    chosen: Chosen | None = None  # the graphs to read; None for the map and all graphs
    fields: FieldRows | None = None  # answers what fields state
    tbox: bool = True  # whether triples of variables alone match the T-Box
    pairs: frozenset[str] = frozenset()  # the kept relations of which all pairs are read


@dataclass(frozen=True)
class PatternScope:
    """Where a pattern stands."""

    # the graph that GRAPH names, a constant or a variable; None for the default graph
    graph: Part | None = None
    # values that the solutions will be joined with: a pattern need not have others, and may refer
    # to them
    bindings: Mapping[str, Value] = field(default_factory=dict)
    # for EXISTS, the values that expressions see besides those of the pattern
    outer: Mapping[str, Value] = field(default_factory=dict)
    # variable, operator and number of comparisons that all solutions will meet
    conditions: tuple[tuple[str, str, str], ...] = ()
    # bindings of few rows: each table is limited to them by its index
    given: Mapping[str, Value] = field(default_factory=dict)

    def joined(self, bindings: Mapping[str, Value]) -> PatternScope:
        """Return the scope of a pattern that is joined with more values."""
        return replace(self, bindings={**self.bindings, **bindings})
