"""Standing queries that are evaluated as a whole, and which changes can concern them."""

from __future__ import annotations

from typing import Any

import rdflib
from rdflib.paths import MulPath, NegatedPath, Path
from rdflib.plugins.sparql.parserutils import CompValue

from semmap.knowledge.fields.properties import field_property, is_of_fields
from semmap.knowledge.mapping import FACTS
from semmap.knowledge.sparql.constants import Constants, iris_in
from semmap.knowledge.sparql.expressions import UntranslatedError
from semmap.knowledge.sparql.triples import TriplePatterns
from semmap.knowledge.standing.changes import Changes
from semmap.knowledge.standing.parts import QueryPart
from semmap.knowledge.vocabulary import SEMMAP


def whole_part(
    tree: Any, names: tuple[str, ...], constants: Constants, translator: TriplePatterns
) -> QueryPart:
    """Return the part that is a whole query."""
    return QueryPart(
        tree,
        names,
        [],
        projected=tuple(range(len(names))),
        properties=_properties(tree, constants),
        of_tables=_has_tables(tree, translator),
        of_fields=any(_may_be_of_fields(constants.property(iri)) for iri in iris_in(tree)),
    )


def concerns(part: QueryPart, changes: Changes) -> bool:
    """Return whether changes can concern a whole query."""
    if changes.removed or ((changes.others or changes.entities) and part.of_tables):
        return True
    if changes.fields and part.of_fields:
        return True
    if part.properties is None:
        return bool(changes.facts)
    return any(fact[2] in part.properties for fact in changes.facts)


def _properties(tree: Any, constants: Constants) -> frozenset[str] | None:
    """Return a set that has the properties of a query; None if it may have any."""
    if _has_any_property(tree):
        return None
    return frozenset(constants.property(iri) for iri in iris_in(tree))


def _may_be_of_fields(iri: str) -> bool:
    found = field_property(iri)
    return found is not None and (found.subject == "voxel" or is_of_fields(iri))


def _has_any_property(tree: Any) -> bool:
    if isinstance(tree, CompValue):
        if tree.name == "TriplesBlock":
            return True
        triples = tree.get("triples") if tree.name == "BGP" else None
        if any(_is_open(triple[1]) for triple in triples or ()):
            return True
        return any(_has_any_property(each) for each in tree.values())
    return isinstance(tree, (list, tuple)) and any(map(_has_any_property, tree))


def _has_tables(tree: Any, translator: TriplePatterns) -> bool:
    """Return whether anything but single facts may match a pattern of a query."""
    if isinstance(tree, CompValue):
        if tree.name == "TriplesBlock":
            return True
        if tree.name == "Function" and str(tree.iri).startswith(SEMMAP):
            return True
        for triple in (tree.get("triples") if tree.name == "BGP" else None) or ():
            try:
                found = None if isinstance(triple[1], Path) else translator.sources(triple, None)
            except UntranslatedError:
                return True
            if not isinstance(found, list) or any(each not in FACTS for each in found):
                return True
        return any(_has_tables(each, translator) for each in tree.values())
    return isinstance(tree, (list, tuple)) and any(_has_tables(t, translator) for t in tree)


def _is_open(verb: Any) -> bool:
    """Return whether a property or path can be any property, or none."""
    if isinstance(verb, (rdflib.Variable, NegatedPath)):
        return True
    if isinstance(verb, MulPath) and verb.mod in ("*", "?"):
        return True
    inner = getattr(verb, "args", None) or [getattr(verb, "arg", None), getattr(verb, "path", None)]
    return any(_is_open(each) for each in inner if isinstance(each, Path))
