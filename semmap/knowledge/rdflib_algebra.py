"""Corrects how rdflib evaluates GRAPH, BNODE and REPLACE, and gives it our functions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import MethodType, SimpleNamespace
from typing import Any

import rdflib
from rdflib.plugins.sparql import operators
from rdflib.plugins.sparql.parserutils import CompValue, Expr
from rdflib.plugins.sparql.sparql import SPARQLError

from semmap.knowledge.sparql.geosparql import FUNCTIONS
from semmap.language.named_graphs import require_graphs
from semmap.language.syntax_tree import nodes_in

EXISTS, NOT_EXISTS = "Builtin_EXISTS", "Builtin_NOTEXISTS"


Call = Callable[[CompValue], Any]
"""The value of a call of a function with constant arguments; None for an error."""


def correct(algebra: Any, call: Call) -> None:
    """Give an algebra of rdflib the meaning that SPARQL has, with the functions of `call`."""
    require_graphs(algebra)
    for node in list(nodes_in(algebra)):
        name = getattr(node, "name", "")
        if name == "Extend" and node.p.name != "Extend":
            node["expr"] = Expr("NewSolution", evalfn=_of_new_solution, of=node.expr)
        elif name == "Builtin_REPLACE":
            node._evalfn = MethodType(_replaced, node)
        elif name in (EXISTS, NOT_EXISTS) and "graph" in vars(node):
            correct(node.graph, call)  # rdflib has it apart
        elif name == "Function" and str(node.iri) in FUNCTIONS:
            node._evalfn = MethodType(partial(_called, call), node)
        elif name == "Filter" and type(node.expr) is CompValue:  # of `require_graphs`
            pattern, node["expr"] = node.expr.graph, Expr(EXISTS, operators.Builtin_EXISTS)
            node.expr.graph = pattern


def _of_new_solution(expression: Any, solution: Any) -> Any:
    """Return the value of the first expression of a solution: its labels are new nodes."""
    solution.ctx.bnodes.clear()
    return expression.of


def _called(call: Call, node: Any, _: Any) -> Any:
    """Return the value of a function for the arguments of a solution."""
    value = call(CompValue("Function", iri=node.iri, expr=list(node.expr)))
    if value is None:
        raise SPARQLError(f"{node.iri} has no value")
    return value


def _replaced(call: Any, _: Any) -> rdflib.Literal:
    """Return the value of REPLACE, whose flags rdflib takes for a number of matches."""
    flags = f"(?{call.flags})" if call.flags else ""
    pattern = rdflib.Literal(flags + operators.string(call.pattern))
    given: Any = SimpleNamespace(
        arg=call.arg, pattern=pattern, replacement=call.replacement, flags=None
    )
    return operators.Builtin_REPLACE(given, None)
