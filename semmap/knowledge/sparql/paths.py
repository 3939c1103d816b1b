"""Property paths (SPARQL 1.1, sections 9 and 18.4)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import rdflib
from rdflib.paths import InvPath, MulPath, NegatedPath

from semmap.knowledge.sparql.relation import Rows, in_form, union_form
from semmap.knowledge.sparql.scope import Part, PatternScope
from semmap.knowledge.sparql.triple_match import TripleMatch
from semmap.knowledge.sparql.values import NUMBERED, as_term, number_of, same
from semmap.knowledge.triple_map import Form, Value


class PropertyPaths(TripleMatch, ABC):
    """Translates paths; each step is a triple pattern."""

    @abstractmethod
    def triples(self, triples: Iterable[tuple[Any, Any, Any]], scope: PatternScope) -> Rows:
        """Return the solutions of triple patterns that must all match."""

    def _one(self, subject: Part, predicate: Any, object_: Part, scope: PatternScope) -> Rows:
        """Return the solutions of one pattern whose sides are parts already."""
        ends = rdflib.Variable("*s"), rdflib.Variable("*o")
        rows = self.triples([(ends[0], predicate, ends[1])], replace(scope, bindings={}))
        return self._renamed(rows, {"*s": subject, "*o": object_})

    def _renamed(self, rows: Rows, names: Mapping[str, Part]) -> Rows:
        """Return rows with other names for some variables, or a constant for them."""
        found = Rows(rows.froms, list(rows.where))
        for name, value in rows.variables.items():
            part = names.get(name, name)
            if isinstance(part, Value):
                found.where.append(self._equals(value, part))
            else:
                found.bind(part, value, self.namespace)
        return found

    def _negated(
        self, subject: Part, path: NegatedPath, object_: Part, scope: PatternScope
    ) -> Iterable[Rows]:
        """Yield the rows of a negated property set, for each direction."""
        forward = [a for a in path.args if not isinstance(a, InvPath)]
        backward = [a.arg for a in path.args if isinstance(a, InvPath)]
        for excluded, start, end in ((forward, subject, object_), (backward, object_, subject)):
            if not excluded:
                continue
            verb = rdflib.Variable(self.fresh())
            rows = self._one(start, verb, end, scope)
            value = rows.variables.pop(str(verb))
            for iri in excluded:
                text = self.constants.property(str(iri))
                known = Value("iri", self._bind(text), None, (text, "I"))
                rows.where.append(f"NOT {same(value, known, self.namespace)}")
            yield rows

    def _walk(self, rows: Rows, start: Part, path: MulPath, end: Part, scope: PatternScope) -> None:
        """Join a path of any length: a recursive query, from the side that is known."""
        given = {}
        for side, part in (("a", start), ("b", end)):
            if isinstance(part, Value):
                given[side] = part
            elif part in rows.variables and part not in rows.nullable:
                given[side] = rows.variables[part]
            elif part in scope.bindings and part not in rows.variables:
                given[side] = scope.bindings[part]
        scope = replace(scope, bindings={})
        step = self._one("*a", path.path, "*b", scope)
        step_forms = [step.variables["*a"], step.variables["*b"]]
        zero = path.mod in ("*", "?")
        constant = "b" if isinstance(end, Value) and not isinstance(start, Value) else "a"
        from_side = constant if constant in given else next(iter(given), None)
        if from_side is None:
            found = self._all_paths(step, path.mod, scope)
        else:
            start_value = self._seed(given[from_side], union_form(step_forms), zero=zero)
            form = union_form([*step_forms, start_value])
            one = self._pairs(step, form, reverse=from_side == "b")
            seed = in_form(start_value, form, self.namespace)
            found = self._reached(one, seed, form, path.mod, zero)
            reached = "b" if from_side == "a" else "a"
            found.variables = {f"*{reached}": found.variables["*"]}
            found.variables[f"*{from_side}"] = given[from_side]
        rows.join(self._renamed(found, {"*a": start, "*b": end}), self.namespace)

    def _seed(self, given: Value, form: Form, *, zero: bool) -> Value:
        """Return where a path begins: a number, where its steps have numbers."""
        if form not in ("resource", "stored") or given.form in NUMBERED:
            return given
        if given.constant is not None:
            return self._as_number(given, form) or given
        return given if zero else Value(form, number_of(given, self.namespace))

    def _pairs(self, step: Rows, form: Form, *, reverse: bool) -> str:
        """Return a SELECT of both ends of a step in one form."""
        a, b = (in_form(step.variables[n], form, self.namespace) for n in ("*a", "*b"))
        return step.select((b, a) if reverse else (a, b))

    def _reached(self, one: str, seed: Value, form: Form, mod: str, zero: bool) -> Rows:
        wide = form == "term"
        columns = "x, xt" if wide else "x"
        begin = ", ".join(seed.columns())
        s, r, q = (self.parameters.alias(letter) for letter in "srq")
        match_seed = f"{s}.c0 = {seed.sql}" + (f" AND {s}.c1 = {seed.tag}" if wide else "")
        match_step = f"{s}.c0 = {r}.x" + (f" AND {s}.c1 = {r}.xt" if wide else "")
        next_columns = f"{s}.c2, {s}.c3" if wide else f"{s}.c1"
        first = f"SELECT {next_columns} FROM ({one}) {s} WHERE {match_seed}"
        if mod == "?":
            base = f"SELECT {begin} UNION {first}"
        else:
            base = f"SELECT {begin}" if zero else first
        step = f"SELECT {next_columns} FROM {r}, LATERAL ({one}) {s} WHERE {match_step}"
        value = Value(form, f"{q}.x", f"{q}.xt" if wide else None)
        return Rows([_closure(base, step, mod, columns, r, q)], variables={"*": value})

    def _all_paths(self, step: Rows, mod: str, scope: PatternScope) -> Rows:
        zero = mod in ("*", "?")
        form = "term" if zero else union_form([step.variables["*a"], step.variables["*b"]])
        one = self._pairs(step, form, reverse=False)
        wide = form == "term"
        columns = "a, at, b, bt" if wide else "a, b"
        s, r, q = (self.parameters.alias(letter) for letter in "srq")
        base = f"{one} UNION {self._every_node(scope)}" if zero else one
        match = f"{s}.c0 = {r}.b" + (f" AND {s}.c1 = {r}.bt" if wide else "")
        ends = f"{r}.a, {r}.at, {s}.c2, {s}.c3" if wide else f"{r}.a, {s}.c1"
        further = f"SELECT {ends} FROM {r}, LATERAL ({one}) {s} WHERE {match}"
        return Rows(
            [_closure(base, further, mod, columns, r, q)],
            variables={
                "*a": Value(form, f"{q}.a", f"{q}.at" if wide else None),
                "*b": Value(form, f"{q}.b", f"{q}.bt" if wide else None),
            },
        )

    def _every_node(self, scope: PatternScope) -> str:
        """Return a SELECT of each subject and object, twice."""
        rows = self._one("*s", rdflib.Variable("*p"), "*o", scope)
        selects = []
        for name in ("*s", "*o"):
            node = as_term(rows.variables[name], self.namespace)
            selects.append(rows.select((node, node)))
        return " UNION ".join(selects)


def _closure(base: str, step: str, mod: str, columns: str, r: str, q: str) -> str:
    """Return a table q of what a base has and, unless at most once, steps from it in r add."""
    if mod != "?":
        base = f"WITH RECURSIVE {r} ({columns}) AS ({base} UNION {step}) SELECT {columns} FROM {r}"
    return f"LATERAL ({base}) {q} ({columns})"
