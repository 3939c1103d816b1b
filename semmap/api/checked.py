"""The door of the API: checks arguments, calls again after losses, tells errors to users.

What an argument may be is read from its annotation: one row of `FORMS` for each word in it. Why:
docs/decisions/arguments_are_checked_by_their_annotations.md
"""

from __future__ import annotations

import ast
import functools
import inspect
import json
import math
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from os import PathLike
from typing import Any, NamedTuple, TypeAlias, TypeVar, cast

import psycopg

from semmap.database.sure_connection import HAPPENED
from semmap.error import Error, InvalidArgumentError, UnknownNameError
from semmap.query.refusal import refused
from semmap.syntax_tree import parse_expression

EntityName: TypeAlias = "str | Any"
"""The name of an entity, or the entity itself: a method that `checked` wraps gets the name."""

Finite: TypeAlias = float
"""A finite number; `float` alone lets a method say itself which numbers it takes."""

Positive: TypeAlias = float
"""A finite number above 0."""

Properties: TypeAlias = Mapping[str, Any]
"""Values by name, as JSON has them."""

Checked = TypeVar("Checked", bound=Callable[..., Any])
Class = TypeVar("Class", bound=type)

ATTEMPTS = 5
"""How often a method is called whose connections to the database are lost."""

SHOWN = 60
"""Characters of a refused value that a message shows."""

WRONG = object()
"""What a form makes of a value that is none."""


class Form(NamedTuple):
    """One form of an argument: in words, and what a method gets for a value; else `WRONG`."""

    words: str
    take: Callable[[Any], Any]


def form_of(annotation: str) -> Form | None:
    """The form of an annotation; None for one that lets any value in.

    >>> form_of("float | None").words, form_of("float | None").take("3") is WRONG
    ('a number or None', True)
    """
    return _form(parse_expression(annotation))


def _form(node: ast.expr) -> Form | None:
    match node:
        case ast.BinOp(left, ast.BitOr(), right):
            return _either(_form(left), _form(right))
        case ast.Subscript(ast.Name(name), of):
            return _GENERIC[name](of) if name in _GENERIC else None
        case ast.Name(name) | ast.Attribute(attr=name):
            return FORMS[name] if name in FORMS else _instance(name)
        case ast.Constant(None):
            return FORMS["None"]
    return None


def _either(left: Form | None, right: Form | None) -> Form | None:
    if left is None or right is None:
        return None

    def take(value: Any) -> Any:
        found = left.take(value)
        return right.take(value) if found is WRONG else found

    words = left.words if right.words in left.words else f"{left.words} or {right.words}"
    return Form(words.replace(" or ", ", ", words.count(" or ") - 1), take)


def _that(words: str, is_one: Callable[[Any], bool]) -> Form:
    return Form(words, lambda value: value if is_one(value) else WRONG)


def _instance(name: str) -> Form:
    """An instance of a class of this name, which need not be imported to ask for it."""
    return _that(f"a {name}", lambda value: any(c.__name__ == name for c in type(value).__mro__))


def _is_number(value: Any) -> bool:
    return not isinstance(value, bool | str) and hasattr(value, "__float__")


def _is_finite(value: Any) -> bool:
    try:
        return _is_number(value) and math.isfinite(value)
    except OverflowError:
        return False


def _is_whole(value: Any) -> bool:
    return not isinstance(value, bool) and hasattr(value, "__index__")


def _is_json(value: Any) -> bool:
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError, RecursionError):
        return False
    return isinstance(value, Mapping)


def _entity_name(value: Any) -> Any:
    if isinstance(value, str):
        return value
    entity = _ENTITY.take(value)
    return WRONG if entity is WRONG else entity.name


def _literal(of: ast.expr) -> Form:
    values = ast.literal_eval(of)
    known = values if isinstance(values, tuple) else (values,)
    return _that(f"one of {', '.join(map(str, known))}", lambda value: value in known)


def _several(of: ast.expr) -> Form | None:
    """A sequence, of which each value is of a form; one text or entity is a sequence of one.

    Of numbers, the method itself says how many, and what they are.
    """
    each = _form(of)
    if each is None or each.take("") is WRONG:
        return _that("a sequence", lambda value: isinstance(value, Iterable))
    is_one = each.take

    def take(value: Any) -> Any:
        if isinstance(value, str | PathLike) or not isinstance(value, Iterable):
            one = is_one(value)
            return one if one is WRONG else (one,)
        found = tuple(map(is_one, value))
        return WRONG if any(each is WRONG for each in found) else found

    return Form(f"a sequence, each {each.words}", take)


def _tuple(of: ast.expr) -> Form | None:
    forms = [_form(each) for each in of.elts] if isinstance(of, ast.Tuple) else [_form(of)]
    if any(each is None for each in forms):
        return None
    known = [each for each in forms if each is not None]

    def take(value: Any) -> Any:
        if isinstance(value, str) or not isinstance(value, Iterable):
            return WRONG
        values = tuple(value)
        if len(values) != len(known):
            return WRONG
        found = tuple(form.take(each) for form, each in zip(known, values, strict=True))
        return WRONG if any(each is WRONG for each in found) else found

    return Form(f"({', '.join(each.words for each in known)})", take)


def _numbers(words: str, *counts: int) -> Form:
    def take(value: Any) -> Any:
        if isinstance(value, str) or not isinstance(value, Iterable):
            return WRONG
        values = tuple(value)
        return values if len(values) in counts and all(map(_is_finite, values)) else WRONG

    return Form(words, take)


_is_mapping = functools.partial(_that, "a mapping", lambda value: isinstance(value, Mapping))
_is_function = functools.partial(_that, "a function", callable)

_GENERIC: Mapping[str, Callable[[ast.expr], Form | None]] = {
    "Callable": lambda of: _is_function(),
    "Collection": _several,
    "Iterable": _several,
    "Literal": _literal,
    "Mapping": lambda of: _is_mapping(),
    "Sequence": _several,
    "dict": lambda of: _is_mapping(),
    "tuple": _tuple,
}

_PATH = _that("a path", lambda value: isinstance(value, PathLike))
_ENTITY = _instance("MapEntity")

FORMS: dict[str, Form | None] = {
    "None": _that("None", lambda value: value is None),
    "str": _that("a text", lambda value: isinstance(value, str)),
    "bool": _that("True or False", lambda value: not isinstance(value, str)),
    "int": _that("a whole number", _is_whole),
    "float": _that("a number", _is_number),
    "Finite": _that("a finite number", _is_finite),
    "Positive": _that("a finite number above 0", lambda value: _is_finite(value) and value > 0),
    "datetime": _that("a datetime", lambda value: isinstance(value, datetime)),
    "Path": _PATH,
    "Properties": _that("a mapping of names to values that JSON has", _is_json),
    "MapEntity": _ENTITY,
    "EntityName": Form("an entity or its name", _entity_name),
    "Polygon": _instance("Geometry"),
    "Progress": _is_function(),
    "Note": _is_function(),
    "Point": _numbers("a point (x, y) or (x, y, z)", 2, 3),
    "Bounds": _numbers("(x0, y0, x1, y1), finite numbers", 4),
    "Any": None,
    "object": None,
    "ArrayLike": None,
}
"""The words of annotations that do not name a class, and those of basic types; None: anything."""

ALIASES = {
    "Labels": "Mapping[Any, bool]",
    "LocationLike": "EntityName | Pose | Point | tuple[str, Pose] | LocatedEntity",
    "Near": "EntityName | Sequence[float]",
    "PlanarPose": "Sequence[float]",
    "RobotLike": "str | Path | RobotClass | Sequence[Part]",
}
"""Annotations that stand for others."""

FORMS |= {name: form_of(meaning) for name, meaning in ALIASES.items()}


@functools.cache
def forms_of(function: Callable[..., Any]) -> dict[str, Form]:
    """The forms of a function's arguments by name, without those that take anything."""
    found = {
        name: form_of(annotation)
        for name, annotation in function.__annotations__.items()
        if name != "return" and isinstance(annotation, str)
    }
    return {name: form for name, form in found.items() if form is not None}


def checked(function: Checked) -> Checked:
    """Let a function be called with arguments of their annotated forms only (`FORMS`).

    It gets names for entities, and tuples for sequences. A LookupError or ValueError that it
    raises, and what PostgreSQL refuses, is raised as a `semmap.Error` of the same kind.
    """
    code = function.__code__
    positional = code.co_varnames[: code.co_argcount]

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            forms = forms_of(function)
            if forms:
                named = zip(positional, args, strict=False)
                args = (*(taken(n, forms, v) for n, v in named), *args[len(positional) :])
                kwargs = {name: taken(name, forms, value) for name, value in kwargs.items()}
            return _through_losses(function, *args, **kwargs)
        except Exception as error:
            told = _for_users(error)
            if told is None:
                raise
            cause = error if isinstance(error, psycopg.Error) else error.__cause__
            raise told.with_traceback(error.__traceback__) from cause

    return cast("Checked", call)


def _through_losses(function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Call a function; again if a connection was lost, and what it did wrote nothing.

    Where a transaction is open, its owner calls again. What `function` does on connections in
    autocommit mode must be nothing that writes.
    """
    if HAPPENED.open:
        return function(*args, **kwargs)
    for attempt in range(ATTEMPTS):
        commits, losses = HAPPENED.commits, HAPPENED.losses
        try:
            return function(*args, **kwargs)
        except Exception:
            if HAPPENED.losses == losses or HAPPENED.commits != commits:
                raise
            if attempt == ATTEMPTS - 1:
                HAPPENED.commits += 1  # so that a caller of this does not try as often again
                raise
    raise AssertionError("each attempt returns or raises")


def checked_class(made: Class) -> Class:
    """Let all public methods and properties of a class, inherited ones too, be `checked`."""
    for name in dir(made):
        member = inspect.getattr_static(made, name)
        if name.startswith("_") and name != "__getitem__":
            continue
        if inspect.isfunction(member) and not hasattr(member, "__wrapped__"):
            member.__qualname__ = f"{made.__name__}.{name}"  # the one in Python's own errors
            setattr(made, name, checked(member))
        elif isinstance(member, property) and not hasattr(member.fget, "__wrapped__"):
            assert member.fget is not None
            write = None if member.fset is None else checked(member.fset)
            setattr(made, name, property(checked(member.fget), write, None, member.__doc__))
    return made


def taken(name: str, forms: dict[str, Form], value: Any) -> Any:
    """What a method gets for a value of an argument; InvalidArgumentError for one of no form."""
    form = forms.get(name)
    if form is None:
        return value
    found = form.take(value)
    if found is WRONG:
        shown = repr(value)
        shown = shown if len(shown) <= SHOWN else f"{shown[:SHOWN]}..."
        raise InvalidArgumentError(f"{name.rstrip('_')} is {shown}: give {form.words}")
    return found


def _for_users(error: Exception) -> Error | None:
    """The error that a user sees in place of one; None: the same."""
    driver = getattr(error, "orig", error)  # SQLAlchemy keeps the driver's error there
    if isinstance(driver, psycopg.Error):
        return refused(driver)
    if isinstance(error, KeyError | IndexError) or type(error).__module__ != "builtins":
        return None  # a fault of the program, an `Error`, or one of a caller's function
    words = error.args if len(error.args) == 1 else (str(error),)
    if isinstance(error, LookupError):
        return UnknownNameError(*words)
    return InvalidArgumentError(*words) if isinstance(error, ValueError) else None
