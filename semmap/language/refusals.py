"""What the grammar can read, but no back end supports yet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pyparsing
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.language.normalise import NormalisedText
from semmap.language.syntax_tree import nodes_in
from semmap.language.terms import position_of

_PATHS = "property paths are not supported"
_ONE_CATALOGUE = "there is one catalogue"

_REASONS = {
    "ConstructQuery": "CONSTRUCT is not supported: use SELECT, with STORE for a new map",
    "DescribeQuery": "DESCRIBE is not supported: use SELECT",
    "DatasetClause": f"FROM is not supported: {_ONE_CATALOGUE}",
    "UsingClause": f"USING is not supported: {_ONE_CATALOGUE}",
    "GraphGraphPattern": f"GRAPH is not supported: {_ONE_CATALOGUE}",
    "QuadsNotTriples": f"GRAPH is not supported: {_ONE_CATALOGUE}",
    "ServiceGraphPattern": "SERVICE is not supported: put the other answer into VALUES",
    "Collection": "lists are not supported: write a pattern for each item",
    "PathEltOrInverse": f"{_PATHS}: exchange subject and object",
    "PathNegatedPropertySet": f"{_PATHS}: use FILTER NOT EXISTS",
    "Aggregate_GroupConcat": "GROUP_CONCAT is not supported",
} | {
    name: f"{name.upper()} is not supported: use INSERT and DELETE"
    for name in ("Load", "Clear", "Drop", "Create", "Add", "Move", "Copy")
}


_UNSAFE = {
    "ServiceGraphPattern": "SERVICE is not supported: put the other answer into VALUES",
    "Load": "LOAD is not supported: semmap rdf import FILE reads a file",
}
"""What would read from other servers; with SILENT it has no effect."""


def refuse_unsafe(text: NormalisedText, tree: Any) -> None:
    """Raise QueryError for the first part of a syntax tree that leads outside of the database."""
    unsafe = [part for part in _parts(tree) if part.name in _UNSAFE]
    _refuse(text, [(_UNSAFE[p.name], p) for p in unsafe if p.name != "Load" or not p.silent])
    _refuse(text, [(reason, part) for part in _parts(tree) for reason in _uneven(part)])


def refuse_unsupported(text: NormalisedText, tree: Any) -> None:
    """Raise QueryError for the first part of a syntax tree that no back end supports."""
    _refuse(text, [(reason, part) for part in _parts(tree) for reason in _reasons(part)])


def _refuse(text: NormalisedText, refused: list[tuple[str, Any]]) -> None:
    for reason, part in sorted(refused, key=lambda one: position_of(one[1]) or 0):
        raise text.error(reason, position_of(part) or 0)


def _parts(tree: Any) -> Iterator[CompValue]:
    return (part for part in nodes_in(tree) if isinstance(part, CompValue))


def _reasons(part: CompValue) -> Iterator[str]:
    if part.name in _REASONS:
        yield _REASONS[part.name]
    if part.name == "Modify" and part.withClause is not None:
        yield f"WITH is not supported: {_ONE_CATALOGUE}"
    if part.name == "PathElt" and part.mod:
        yield f"{_PATHS}: write a pattern for each step"
    if part.name == "PathSequence" and len(part.part) > 1:
        yield f"{_PATHS}: write a pattern for each step"
    if part.name == "PathAlternative" and len(part.part) > 1:
        yield f"{_PATHS}: write UNION"
    yield from _uneven(part)


def _uneven(part: CompValue) -> Iterator[str]:
    if part.name in ("InlineData", "ValuesClause"):
        width = len(part.var or ())
        for row in part.value or ():
            if isinstance(row, (list, pyparsing.ParseResults)) and len(row) != width:
                yield f"VALUES has {width} variables, but a row has {len(row)} values"
