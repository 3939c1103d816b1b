"""The part of a query that fields answer, as rows of the SQL that answers the rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import rdflib

from semmap.knowledge.answer import Explained
from semmap.knowledge.fields.properties import (
    FieldAnswer,
    FieldQuery,
    FieldTriple,
    components,
    field_properties,
)
from semmap.knowledge.sparql.constants import Constants
from semmap.knowledge.sparql.relation import Rows
from semmap.knowledge.sparql.values import Parameters
from semmap.knowledge.triple_map import Value
from semmap.knowledge.vocabulary import TYPE, decode, encode
from semmap.snake_case import local_name, snake_case

if TYPE_CHECKING:
    from semmap.knowledge.map_view import MapView

_ENTITIES = (
    "SELECT name, id FROM entity WHERE map_id = (SELECT current_map()) AND name = ANY (%(n)s)"
)
_TYPES = "SELECT name, iri FROM semantic_type WHERE name = ANY (%(n)s)"
_WORDS = "SELECT name, label FROM semantic_type"


@dataclass(eq=False)
class FieldRows:
    """Asks fields, and states their answers as rows."""

    view: MapView  # gets the text of each question, and what an answer says nothing of

    def rows(
        self,
        triples: Iterable[tuple[str | Value, Any, str | Value]],
        constants: Constants,
        parameters: Parameters,
        is_needed: Callable[[str, int], bool],
        conditions: Collection[tuple[str, str, str]],
    ) -> tuple[list[Rows], dict[str, Value]]:
        """Return rows for each group of triples that variables join, and constants of some.

        `is_needed` says whether a variable that occurs so often in a group is needed elsewhere; all
        solutions will meet the conditions. The constants are those that variables of rows must
        have.
        """
        equal: dict[str, Value] = {}

        def side(part: str | Value) -> str | tuple[str, ...]:
            if isinstance(part, str):
                return part
            text = self._constant(part)
            if text is not None:
                return (text,)
            name = parameters.alias("*c")
            equal[name] = part
            return name

        stated = []
        for subject, predicate, object_ in triples:
            property_ = field_properties()[constants.property(str(predicate))]
            stated.append(FieldTriple(side(subject), property_, side(object_), predicate))
        found = []
        for group in components(stated):
            counts: dict[str, int] = {}
            for triple in group:
                for name, _ in triple.variables():
                    counts[name] = counts.get(name, 0) + 1
            kept = {name for name, count in counts.items() if is_needed(name, count)}
            query = FieldQuery.of(group, kept, conditions)
            found.append(self._solutions(query, parameters))
        return found, equal

    def _constant(self, value: Value) -> str | None:
        """Return a constant as fields write it; None where it names an entity and a type."""
        text, tag = value.constant or ("", "I")
        if tag != "I":
            number = rdflib.Literal(text, datatype=rdflib.URIRef(tag)).value
            is_number = isinstance(number, (int, float)) and not isinstance(number, bool)
            return str(rdflib.Literal(number if is_number else text).n3())
        if value.form == "voxel":
            return None
        if text.startswith(self.view.namespace):
            name = decode(text[len(self.view.namespace) :]) or text
            if value.form == "entity" and snake_case(name) in self._words:
                return None
        else:
            name = local_name(text)
        return str(rdflib.Literal(name).n3())

    @cached_property
    def _words(self) -> frozenset[str]:
        rows = self.view.session.execute(_WORDS)
        return frozenset(snake_case(word) for row in rows for word in row if word)

    def _solutions(self, query: FieldQuery, parameters: Parameters) -> Rows:
        from semmap.knowledge.fields.map_fields import ask_fields  # slow to import

        answer = ask_fields(self.view, query)
        self.view.statements.append(
            Explained("fields", f"fields: {query.text}\n-- {len(answer.rows)} rows, by {answer.by}")
        )
        if answer.left_out:
            shown = ", ".join(answer.left_out[:5]) + (", ..." if len(answer.left_out) > 5 else "")
            self.view.notes.append(
                f"unknown, as they have no voxels: {len(answer.left_out)} entities: {shown}"
            )
        alias = parameters.alias("f")
        arrays, rows = [], Rows()
        for number, (name, kind) in enumerate(zip(query.names, query.kinds, strict=True)):
            values, form, type_ = self._column(answer, number, kind)
            arrays.append(parameters.bind(values, f"{type_}[]"))
            tag = "'I'::text" if form == "term" else None
            rows.variables[name] = Value(form, f"{alias}.c{number}", tag)
        if query.counts:
            arrays.append(parameters.bind([row[-1] for row in answer.rows], "bigint[]"))
        columns = ", ".join(f"c{i}" for i in range(len(arrays)))
        rows.froms.append(f"unnest({', '.join(arrays)}) {alias} ({columns})")
        if query.counts:  # a solution as often as fields have it
            again = parameters.alias("n")
            rows.froms.append(f"LATERAL generate_series(1, {alias}.c{len(arrays) - 1}) {again}")
        return rows

    def _column(self, answer: FieldAnswer, number: int, kind: str) -> tuple[list[Any], str, str]:
        """Return the values of a column, their form, and the type of SQL."""
        values = [row[number] for row in answer.rows]
        if kind == "number":
            return values, "double", "double precision"
        if kind == "voxel":
            size = answer.voxel_size
            keys = [",".join(str(math.floor(x / size)) for x in centre) for centre in values]
            return keys, "voxel", "text"
        names = sorted(set(values))
        entities: dict[str, int] = dict(self.view.session.execute(_ENTITIES, {"n": names}))
        if len(entities) == len(names):
            return [entities[name] for name in values], "entity", "bigint"
        # What sources name, and the map does not have: types of detectors, agents.
        types: dict[str, str | None] = dict(self.view.session.execute(_TYPES, {"n": names}))
        iris = {
            name: types[name] or f"{TYPE}{encode(name)}"
            if name in types and name not in entities
            else f"{self.view.namespace}{encode(name)}"
            for name in names
        }
        return [iris[name] for name in values], "term", "text"
