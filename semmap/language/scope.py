"""What is known while a text is checked: its variables, and the names of a schema."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from semmap.language.algebra import Expression
from semmap.language.error import QueryError
from semmap.language.expression_checker import Scope
from semmap.language.parser import ParsedText
from semmap.language.schema import Function, Property, Schema, ValueKind, with_article
from semmap.language.terms import PAPER_NAMESPACE, name_of, namespace_of

Declaration = tuple[ValueKind, str | None, int]
"""The kind of a variable, the semantic type of its values, and where it was declared."""


class TextScope(Scope):
    """The variables of a text and the names of a schema."""

    def __init__(self, parsed: ParsedText, schema: Schema) -> None:
        self.parsed = parsed
        self.schema = schema
        self.kinds: dict[str, Declaration] = {}
        self.visible: frozenset[str] = frozenset()
        self._namespaces: frozenset[str] | None = None

    def error(self, reason: str, at: object) -> QueryError:
        """Return an error at a term, a part of the tree, or a position."""
        return self.parsed.error(reason, at)

    def variable(self, term: Any) -> tuple[ValueKind, str | None]:
        """Return kind and semantic type of a variable that is visible here."""
        name = str(term)
        if name not in self.visible:
            where = "in this group" if name in self.kinds else "by any pattern"
            raise self.error(f"?{name} is not bound {where}", term)
        kind, range_, _ = self.kinds[name]
        return kind, range_

    def declare(self, name: str, kind: ValueKind, range_: str | None, position: int) -> None:
        """Set the kind of a variable. Raises QueryError: it has another kind already."""
        known, _, declared = self.kinds.setdefault(name, (kind, range_, position))
        if known != kind:
            line = self.error("", declared).line
            raise self.error(
                f"?{name} is {with_article(kind)} here, but {with_article(known)} in line {line}",
                position,
            )

    def seeing(
        self,
        variables: frozenset[str],
        check: Callable[[Any, Scope], Expression],
        *trees: Any,
    ) -> tuple[Expression, ...]:
        """Check expressions where the given variables are visible."""
        before, self.visible = self.visible, variables
        try:
            return tuple(check(tree, self) for tree in trees)
        finally:
            self.visible = before

    @contextmanager
    def own_kinds(self) -> Iterator[dict[str, Declaration]]:
        """Check a subquery: its variables are not those of the text around it."""
        outside, self.kinds = self.kinds, {}
        try:
            yield self.kinds
        finally:
            self.kinds = outside

    def find_property(self, iri: Any) -> Property:
        """Return the property of an IRI in the text."""
        try:
            return self.schema.find_property(str(iri))
        except LookupError as error:
            raise self.error(_message(error), iri) from error

    def entities(self, term: Any, range_: str | None) -> frozenset[str]:
        """Return the entities that a constant stands for."""
        name = name_of(term)
        if name is None:
            raise self.error("this is not the name of an entity", term)
        try:
            return self.schema.find_entities(name, range_)
        except (LookupError, TypeError) as error:
            raise self.error(_message(error), term) from error

    def function(self, term: Any) -> Function:
        """Return the function of an IRI in the paper's namespace or in that of a property."""
        name, functions = str(name_of(term)), self.schema.functions
        if name not in functions or namespace_of(str(term)) not in self._function_namespaces():
            known = ", ".join(f":{each}" for each in functions) or "none"
            raise self.error(f"there is no function {name}; known functions: {known}", term)
        return functions[name]

    def _function_namespaces(self) -> frozenset[str]:
        if self._namespaces is None:
            self._namespaces = frozenset({PAPER_NAMESPACE}).union(
                namespace_of(iri)
                for each in self.schema.properties()
                for iri in (each.iri, *each.same_as)
            )
        return self._namespaces


def _message(error: Exception) -> str:
    """Return the message of an error, without the quotes that a KeyError adds."""
    return str(error.args[0]) if error.args else type(error).__name__
