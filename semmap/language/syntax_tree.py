"""The nodes of rdflib's syntax trees and of its algebra."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pyparsing import ParseResults
from rdflib.paths import Path
from rdflib.plugins.sparql.parserutils import CompValue


def nodes_in(tree: Any) -> Iterator[Any]:
    """Yield each node and term of a tree, from the outside in; paths are nodes, too."""
    stack = [tree]
    while stack:
        part = stack.pop()
        below: Iterable[Any] = ()
        if isinstance(part, CompValue):
            below = [each for _, each in parts_of(part)]
        elif isinstance(part, Path):
            below = vars(part).values()
        elif isinstance(part, Mapping) and not isinstance(part, ParseResults):
            stack += [each for pair in part.items() for each in pair]
            continue
        elif isinstance(part, Iterable) and not isinstance(part, str | bytes):
            stack += reversed(list(part))
            continue
        yield part
        stack += reversed(list(below))


def parts_of(tree: CompValue) -> Iterator[tuple[str, Any]]:
    """Yield the parts of a node by name; rdflib keeps the algebra of EXISTS as an attribute."""
    for name, part in tree.items():
        if name != "_vars":
            yield name, vars(tree).get(name, part)
