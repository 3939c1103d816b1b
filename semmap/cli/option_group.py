"""Options that belong together as one parameter of a command: a data class, each field an option.

A command passes what a group holds to a method as ``**vars(group)``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """A command for Typer: in the place of a parameter that is a data class stand its fields."""
    options: list[Parameter] = []
    groups: dict[str, tuple[Any, list[str]]] = {}
    hints = get_type_hints(command, include_extras=True)
    for name, one in signature(command).parameters.items():
        if is_dataclass(kind := hints[name]):
            types = get_type_hints(kind, include_extras=True)
            groups[name] = kind, [each.name for each in fields(kind)]
            defaults = {each.name: each.default for each in fields(kind)}
        else:
            types, defaults = hints, {name: one.default}
        options += [
            Parameter(key, Parameter.KEYWORD_ONLY, default=default, annotation=types[key])
            for key, default in defaults.items()
        ]

    @wraps(command)
    def run(**given: Any) -> None:
        for name, (kind, keys) in groups.items():
            given[name] = kind(**{key: given.pop(key) for key in keys})
        command(**given)

    run.__signature__ = Signature(options)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in options}
    return run
