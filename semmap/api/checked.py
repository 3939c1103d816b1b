"""The door of the API: arguments are checked, and all that is refused is a `semmap.Error`.

Why: docs/decisions/arguments_are_checked_by_their_annotations.md
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

import psycopg

from semmap.api.argument_forms import WRONG, Form, forms_of
from semmap.error import Error, InvalidArgumentError, UnknownNameError
from semmap.query.refusal import refused

Checked = TypeVar("Checked", bound=Callable[..., Any])
Class = TypeVar("Class", bound=type)

SHOWN = 60
"""Characters of a refused value that a message shows."""


def checked(function: Checked) -> Checked:
    """Let a function be called with arguments of their annotated forms only (`argument_forms`).

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
                args = (*(_taken(n, forms, v) for n, v in named), *args[len(positional) :])
                kwargs = {name: _taken(name, forms, value) for name, value in kwargs.items()}
            return function(*args, **kwargs)
        except Exception as error:
            told = _for_users(error)
            if told is None:
                raise
            cause = error if isinstance(error, psycopg.Error) else error.__cause__
            raise told.with_traceback(error.__traceback__) from cause

    return cast("Checked", call)


def checked_class(made: Class) -> Class:
    """Let all public methods and properties of a class, inherited ones too, be `checked`."""
    for name in dir(made):
        member = inspect.getattr_static(made, name)
        if name.startswith("_") and name != "__getitem__":
            continue
        if inspect.isfunction(member) and not hasattr(member, "__wrapped__"):
            setattr(made, name, checked(member))
        elif isinstance(member, property) and not hasattr(member.fget, "__wrapped__"):
            assert member.fget is not None
            write = None if member.fset is None else checked(member.fset)
            setattr(made, name, property(checked(member.fget), write, None, member.__doc__))
    return made


def _taken(name: str, forms: dict[str, Form], value: Any) -> Any:
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
