"""What the grammar can read, but no back end supports yet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pyparsing
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.language.normalise import NormalisedText
from semmap.language.terms import position_of

__all__ = ["refuse_unsupported"]

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


def refuse_unsupported(text: NormalisedText, tree: Any) -> None:
    """Raise an error for the first part of a syntax tree that no back end supports.

    Raises
    ------
    QueryError
        With the position of that part, and what to write instead.
    """
    refused = sorted(_unsupported(tree), key=lambda one: position_of(one[1]) or 0)
    for reason, part in refused:
        raise text.error(reason, position_of(part) or 0)


def _unsupported(tree: Any) -> Iterator[tuple[str, Any]]:
    """Yield a reason and a part of the tree."""
    if isinstance(tree, CompValue):
        yield from ((reason, tree) for reason in _reasons(tree))
        for part in tree.values():
            yield from _unsupported(part)
    elif isinstance(tree, (list, tuple, pyparsing.ParseResults)):
        for part in tree:
            yield from _unsupported(part)


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
    if part.name in ("InlineData", "ValuesClause"):
        width = len(part.var or ())
        for row in part.value or ():
            if isinstance(row, (list, pyparsing.ParseResults)) and len(row) != width:
                yield f"VALUES has {width} variables, but a row has {len(row)} values"
