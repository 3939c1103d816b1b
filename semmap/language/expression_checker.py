"""Checks expressions: from rdflib's syntax tree to typed expressions (SPARQL 1.1, section 17)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import rdflib
from rdflib.plugins.sparql.parserutils import CompValue
from rdflib.term import Identifier

from semmap.language import algebra
from semmap.language.algebra import Expression
from semmap.language.schema import SPARQL_FUNCTIONS, ValueKind, with_article
from semmap.language.terms import name_of, number_of, position_of

if TYPE_CHECKING:
    from semmap.language.checker import Checker

MIRRORED = {"<": ">", ">": "<", "<=": ">=", ">=": "<=", "=": "=", "!=": "!="}
"""For each comparison the one with exchanged sides."""


Operand = Expression | Identifier
"""A name in the text is an entity where it is compared with one, otherwise a text."""


def check_expression(tree: Any, scope: Checker) -> Expression:
    """Return an expression with its kind; raises QueryError."""
    operand = _operand(tree, scope)
    if isinstance(operand, Expression):
        return operand
    return (_entity if isinstance(operand, rdflib.URIRef) else _text)(operand, scope)


def check_condition(tree: Any, scope: Checker) -> Expression:
    """Return an expression as a truth value (SPARQL 1.1, section 17.2.2); raises QueryError."""
    expression = check_expression(tree, scope)
    if expression.kind == "boolean":
        return expression
    if expression.kind in ("number", "text"):
        return _call("boolean", "boolean", expression)
    raise scope.error(
        f"{with_article(expression.kind)} is neither true nor false: compare it", tree
    )


def conjuncts(tree: Any) -> Iterator[Any]:
    """Yield the parts of a condition that must all be true."""
    if isinstance(tree, CompValue) and tree.name == "ConditionalAndExpression":
        for each in (tree.expr, *tree.other):
            yield from conjuncts(each)
    else:
        yield tree


def _operand(tree: Any, scope: Checker) -> Operand:
    position = position_of(tree) or 0
    if isinstance(tree, rdflib.Variable):
        kind, range_ = scope.variable(tree)
        return algebra.VariableValue(kind, position, range_, str(tree))
    if isinstance(tree, rdflib.Literal):
        if tree.datatype == rdflib.XSD.boolean and tree.value is not None:
            return algebra.Constant("boolean", position, None, bool(tree.value))
        number = number_of(tree)
        if number is not None:
            return algebra.Constant("number", position, None, number)
        if name_of(tree) is None:
            raise scope.error("this is neither a number nor a name", tree)
    if isinstance(tree, Identifier):
        return tree
    if isinstance(tree, CompValue):
        check = _CHECKS.get(tree.name)
        if check is not None:
            return check(tree, scope)
        raise scope.error(f"{tree.name.removeprefix('Builtin_')} is not supported", tree)
    raise scope.error("this is not supported here", position)


def _entity(term: Identifier, scope: Checker) -> Expression:
    """Return the one entity that an IRI stands for."""
    entities = scope.entities(term, None)
    own = name_of(term)
    if len(entities) == 1:
        (own,) = entities
    elif own not in entities:
        raise scope.error(f"this stands for {len(entities)} entities: name one of them", term)
    return algebra.Constant("entity", position_of(term) or 0, None, str(own))


def _text(operand: Operand, scope: Checker) -> Expression:
    if isinstance(operand, Expression):
        if operand.kind == "text":
            return operand
        fix = ": write STR(...)" if operand.kind == "entity" else ""
        raise scope.error(f"{with_article(operand.kind)} is not a text{fix}", operand.position)
    if isinstance(operand, rdflib.URIRef):
        raise scope.error('an IRI is not a text: write "..."', operand)
    return algebra.Constant("text", position_of(operand) or 0, None, str(operand))


def _call(kind: ValueKind, function: str, *arguments: Expression) -> algebra.Call:
    return algebra.Call(kind, arguments[0].position, None, function, arguments)


def _number(tree: Any, scope: Checker) -> Expression:
    operand = _operand(tree, scope)
    if isinstance(operand, Identifier):
        raise scope.error("this is not a number", tree)
    if operand.kind != "number":
        raise scope.error(f"{with_article(operand.kind)} is not a number", tree)
    return operand


def _arithmetic(tree: Any, scope: Checker) -> Expression:
    operands = tuple(_number(each, scope) for each in (tree.expr, *tree.other))
    operators = tuple(str(each) for each in tree.op)
    return algebra.Arithmetic("number", operands[0].position, None, operands, operators)


def _signed(tree: Any, scope: Checker) -> Expression:
    return _call("number", tree.name, _number(tree.expr, scope))


def _relational(tree: Any, scope: Checker) -> Expression:
    if tree.op in ("IN", "NOT IN"):
        return _in(tree, scope)
    return _compared(_operand(tree.expr, scope), tree.op, _operand(tree.other, scope), tree, scope)


def _compared(a: Operand, operator: str, b: Operand, tree: Any, scope: Checker) -> Expression:
    if isinstance(a, Identifier):
        if isinstance(b, Identifier):
            raise scope.error("both sides are constants: one has to be a variable", tree)
        return _compared(b, MIRRORED[operator], a, tree, scope)
    if isinstance(b, Identifier):
        if a.kind == "entity":
            if operator not in ("=", "!="):
                raise scope.error("an entity has no order: compare STR(...)", tree)
            entities = scope.entities(b, a.range)
            return algebra.Membership("boolean", a.position, None, a, entities, operator == "!=")
        if a.kind != "text":
            raise scope.error(f"{with_article(a.kind)} cannot be compared with a name", tree)
        b = _text(b, scope)
    if a.kind != b.kind:
        raise scope.error(
            f"{with_article(a.kind)} cannot be compared with {with_article(b.kind)}", tree
        )
    if a.kind in ("voxel", "entity") and operator not in ("=", "!="):
        fix = "STR(...)" if a.kind == "entity" else ":x(...), :y(...) or :z(...)"
        raise scope.error(f"{with_article(a.kind)} has no order: compare {fix}", tree)
    return _call("boolean", operator, a, b)


def _in(tree: Any, scope: Checker) -> Expression:
    items = [] if tree.other == rdflib.RDF.nil else list(tree.other)
    a = _operand(tree.expr, scope)
    each = [_compared(a, "=", _operand(item, scope), item, scope) for item in items]
    found: Expression = algebra.Constant("boolean", position_of(tree) or 0, None, False)
    if each:
        found = _call("boolean", "||", *each)
    return _call("boolean", "!", found) if tree.op == "NOT IN" else found


def _logical(operator: str) -> Any:
    def check(tree: Any, scope: Checker) -> Expression:
        parts = [check_condition(each, scope) for each in (tree.expr, *tree.other)]
        return _call("boolean", operator, *parts)

    return check


def _not(tree: Any, scope: Checker) -> Expression:
    return _call("boolean", "!", check_condition(tree.expr, scope))


def _bound(tree: Any, scope: Checker) -> Expression:
    scope.variable(tree.arg)
    return algebra.Bound("boolean", position_of(tree) or 0, None, str(tree.arg))


def _of_one_kind(trees: Iterable[Any], scope: Checker) -> list[Expression]:
    expressions = [check_expression(each, scope) for each in trees]
    first = expressions[0].kind
    for each in expressions:
        if each.kind != first:
            raise scope.error(
                f"all of these must be of one kind, but the first is {with_article(first)} and "
                f"this is {with_article(each.kind)}",
                each.position,
            )
    return expressions


def _if(tree: Any, scope: Checker) -> Expression:
    test = check_condition(tree.arg1, scope)
    yes, no = _of_one_kind((tree.arg2, tree.arg3), scope)
    return _call(yes.kind, "IF", test, yes, no)


def _coalesce(tree: Any, scope: Checker) -> Expression:
    expressions = _of_one_kind(tree.arg, scope)
    return _call(expressions[0].kind, "COALESCE", *expressions)


def _str(tree: Any, scope: Checker) -> Expression:
    operand = _operand(tree.arg, scope)
    if isinstance(operand, Identifier) or operand.kind == "text":
        return _text(operand, scope)
    if operand.kind != "entity":
        raise scope.error(f"{with_article(operand.kind)} has no name", tree)
    return _call("text", "STR", operand)


def _constant_text(tree: Any, scope: Checker) -> str:
    if not (isinstance(tree, rdflib.Literal) and name_of(tree) is not None):
        raise scope.error('this has to be a constant: write "..."', tree)
    return str(tree)


def _regex(tree: Any, scope: Checker) -> Expression:
    import regex  # most queries have none

    letters = _constant_text(tree.flags, scope) if tree.flags is not None else ""
    flags = regex.V0
    for letter in letters:
        if letter not in "imsx":
            raise scope.error(f"the flag {letter} is not one of i, m, s, x", tree.flags)
        flags |= {"i": regex.I, "m": regex.M, "s": regex.S, "x": regex.X}[letter]
    written = _constant_text(tree.pattern, scope)
    try:
        pattern = regex.compile(written, flags)
    except (regex.error, ValueError, OverflowError, RecursionError) as error:
        raise scope.error(f"this is not a regular expression: {error}", tree.pattern) from None
    text = _text(_operand(tree.text, scope), scope)
    return algebra.RegexMatch("boolean", text.position, None, text, pattern)


def _of_sparql(tree: Any, scope: Checker) -> Expression:
    """Check a function of one number, of one text, or of a text and a constant."""
    function = SPARQL_FUNCTIONS[tree.name.removeprefix("Builtin_")]
    if function.arguments == ("number",):
        return _call(function.result, function.name, _number(tree.arg, scope))
    if len(function.arguments) == 1:
        return _call(function.result, function.name, _text(_operand(tree.arg, scope), scope))
    part = algebra.Constant(
        "text", position_of(tree.arg2) or 0, None, _constant_text(tree.arg2, scope)
    )
    return _call(function.result, function.name, _text(_operand(tree.arg1, scope), scope), part)


def _function(tree: Any, scope: Checker) -> Expression:
    function = scope.function(tree.iri)
    name, takes, given = function.name, len(function.arguments), list(tree.expr or ())
    if len(given) != takes:
        ending = "" if takes == 1 else "s"
        raise scope.error(f"{name} takes {takes} argument{ending}, not {len(given)}", tree)
    arguments = tuple(check_expression(each, scope) for each in given)
    for argument, kind in zip(arguments, function.arguments, strict=True):
        if argument.kind != kind:
            raise scope.error(
                f"{name} takes {with_article(kind)}, and this is {with_article(argument.kind)}",
                argument.position,
            )
    return algebra.ExtensionCall(function.result, position_of(tree) or 0, None, function, arguments)


_CHECKS: Mapping[str, Callable[[Any, Checker], Expression]] = {
    "RelationalExpression": _relational,
    "ConditionalAndExpression": _logical("&&"),
    "ConditionalOrExpression": _logical("||"),
    "AdditiveExpression": _arithmetic,
    "MultiplicativeExpression": _arithmetic,
    "UnaryNot": _not,
    "UnaryMinus": _signed,
    "UnaryPlus": _signed,
    "Builtin_BOUND": _bound,
    "Builtin_IF": _if,
    "Builtin_COALESCE": _coalesce,
    "Builtin_sameTerm": lambda tree, scope: _compared(
        _operand(tree.arg1, scope), "=", _operand(tree.arg2, scope), tree, scope
    ),
    "Builtin_STR": _str,
    "Builtin_REGEX": _regex,
    "Builtin_EXISTS": lambda tree, scope: scope.exists(tree),
    "Builtin_NOTEXISTS": lambda tree, scope: scope.exists(tree),
    "Function": _function,
    **{f"Builtin_{name}": _of_sparql for name in SPARQL_FUNCTIONS},
}
