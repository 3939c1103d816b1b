"""The arguments of operations as JSON has them: a schema for each annotation."""

from __future__ import annotations

import ast
from typing import Any

from semmap.api.checked import ALIASES
from semmap.api.signatures import REQUIRED, Argument
from semmap.syntax_tree import parse_expression

Schema = dict[str, Any]

_NUMBERS: Schema = {"type": "array", "items": {"type": "number"}}

SCHEMAS: dict[str, Schema] = {
    "str": {"type": "string"},
    "EntityName": {"type": "string"},
    "bool": {"type": "boolean"},
    "int": {"type": "integer"},
    "float": {"type": "number"},
    "Finite": {"type": "number"},
    "Positive": {"type": "number", "exclusiveMinimum": 0},
    "datetime": {"type": "string", "format": "date-time"},
    "Properties": {"type": "object"},
    "Any": {},
    "Point": {**_NUMBERS, "minItems": 2, "maxItems": 3},
    "Bounds": {**_NUMBERS, "minItems": 4, "maxItems": 4},
}
"""What JSON has for the words of annotations; what it has nothing for is no argument."""

_LISTS = ("Sequence", "Iterable", "Collection", "list")
_OBJECTS = ("Mapping", "dict")

NAMED = ("robot", "gripper", "costmap")
"""Arguments that name something stored, or else a file; all others with a path are files."""


def schema_of(argument: Argument) -> Schema | None:
    """The JSON schema of an argument; None for one that JSON cannot give: a function, a file.

    >>> schema_of(Argument("limit", "int | None", 5, "How many"))
    {'type': 'integer', 'description': 'How many', 'default': 5}
    """
    parsed = parse_expression(argument.annotation)
    words = {node.id for node in ast.walk(parsed) if isinstance(node, ast.Name)}
    is_file = "Path" in words and argument.name not in NAMED
    found = _schema(parsed, is_file)
    if found is None:
        return None
    told = {**found, "description": argument.help} if argument.help else {**found}
    if argument.default is not REQUIRED and argument.default is not None:
        is_tuple = isinstance(argument.default, tuple)
        told["default"] = [*argument.default] if is_tuple else argument.default
    return told


def _schema(node: ast.expr, is_file: bool) -> Schema | None:
    match node:
        case ast.BinOp(left, ast.BitOr(), right):
            return _either(_schema(left, is_file), _schema(right, is_file))
        case ast.Subscript(ast.Name("Literal"), of):
            values = ast.literal_eval(of)
            return {"enum": [*values] if isinstance(values, tuple) else [values]}
        case ast.Subscript(ast.Name("tuple"), ast.Tuple(elts)):
            each = [_schema(one, is_file) for one in elts]
            return None if None in each else {"type": "array", "prefixItems": each}
        case ast.Subscript(ast.Name(name), of) if name in _LISTS:
            items = _schema(of, is_file)
            return None if items is None else {"type": "array", "items": items}
        case ast.Subscript(ast.Name(name)) if name in _OBJECTS:
            return {"type": "object"}
        case ast.Name(name) if name in ALIASES:
            return _schema(parse_expression(ALIASES[name]), is_file)
        case ast.Name("str") if is_file:
            return None
        case ast.Name(name):
            return SCHEMAS.get(name)
    return None


def _either(left: Schema | None, right: Schema | None) -> Schema | None:
    if left is None or right is None or left == right:
        return right if left is None else left
    forms = [*left.get("anyOf", [left]), *right.get("anyOf", [right])]
    return {"anyOf": [form for i, form in enumerate(forms) if form not in forms[:i]]}
