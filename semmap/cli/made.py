"""Commands made of operations: the arguments of a method are the options of its command.

A command prints what the method returns. It is a format, the columns of a table, or a function that
gets a `MethodCall` and may have options of its own::

    printed("Database.undo_links", "{0} links taken back")
    printed("Map.list_regions", ("name", "type", "origin"))

    @made("Map.contradictions")
    def contradictions(call: MethodCall, json_: Json = False) -> None: ...

The rest says how an option differs from its argument: ``keep_as="--keep"`` has another name,
``base="X,Y"`` a metavar, ``name="[NAME]"`` is an argument of the command, ``check="--unchecked"``
makes it False, and ``progress=None`` is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property, partial
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints

import typer

from semmap.api.operations import OPERATIONS, Operation
from semmap.api.signatures import REQUIRED, Argument
from semmap.cli.chosen import chosen_fields, chosen_map, open_database
from semmap.cli.options import Json, MapName
from semmap.cli.output import show_table
from semmap.cli.texts import kind_of

Command = Callable[..., None]


class MethodCall:
    """The method of a command, with the values that the user gave.

    Attributes
    ----------
    values : by argument; those that were not given are left to the method
    texts : what Typer read, also of options that were not given
    """

    def __init__(
        self, method: str, values: dict[str, Any], texts: dict[str, Any], opened: Callable[[], Any]
    ) -> None:
        self._name, self._opened = method.partition(".")[2], opened
        self.values, self.texts = values, texts

    @cached_property
    def handle(self) -> Any:
        """The map, the database or the fields with the method, open until the command ends."""
        return self._opened()

    def __call__(self, **others: Any) -> Any:
        """What the method returns."""
        found = getattr(self.handle, self._name)
        return found(**self.values, **others) if callable(found) else found


def made(method: str, **rows: str | None) -> Callable[[Command], Command]:
    """Return a decorator: of a function that prints it makes a command for Typer."""
    return partial(_made, method, rows)


def printed(method: str, how: str | Sequence[str], **rows: str | None) -> Command:
    """Return a command that prints a result by a format, or as a table with these columns."""
    return _made(method, rows, _format(how) if isinstance(how, str) else _table(how))


def _made(method: str, rows: Mapping[str, str | None], show: Command) -> Command:
    operation = next(each for each in OPERATIONS if each.method == method)
    options = {
        each.name: found
        for each in operation.arguments
        if (found := _option(each, rows.get(each.name, ""))) is not None
    }
    parameters = [each.parameter for each in options.values()]
    if not method.startswith("Database."):
        parameters.append(_parameter("map_name", None, MapName))
    hints = get_type_hints(show, include_extras=True)
    own = [*signature(show).parameters.values()][1:]
    parameters += [_parameter(each.name, each.default, hints[each.name]) for each in own]

    def command(**given: Any) -> None:
        texts = {name: given.pop(name) for name in options}
        opened = _opened(operation, given.pop("map_name", None), given)
        values = _values(options, texts)
        with ExitStack() as stack:
            show(MethodCall(method, values, texts, lambda: stack.enter_context(opened)), **given)

    command.__name__ = str(operation.command).rpartition(" ")[2]
    command.__doc__ = show.__doc__ or _sentence(operation.help)
    command.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    return command


def _values(options: Mapping[str, _Option], texts: Mapping[str, Any]) -> dict[str, Any]:
    """The values of what was given, by argument."""
    given = {name: read for name, read in texts.items() if read is not None and read != []}
    try:
        return {name: options[name].value(read) for name, read in given.items()}
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def group(*commands: Command, help: str) -> typer.Typer:
    """Return a group of commands that `made` returned."""
    found = typer.Typer(no_args_is_help=True, help=help)
    for each in commands:
        found.command(each.__name__)(each)
    return found


@dataclass(frozen=True)
class _Option:
    """An argument as Typer reads it, and what becomes of what was read."""

    parameter: Parameter
    value: Callable[[Any], Any]


def _option(argument: Argument, row: str | None) -> _Option | None:
    """The option of an argument; None where the row is None, or where no text has its type."""
    if row is None:
        return None
    words = row.split()
    names = [word for word in words if word.startswith("-")]
    metavar = next((word for word in words if not word.startswith("-")), None)
    kind = kind_of(argument.annotation, metavar or argument.help)
    if kind is None:
        return None
    required = argument.default is REQUIRED
    off = argument.default is True and names != [] and "/" not in names[0]
    default: Any = ... if required else False if off else argument.default
    told: dict[str, Any] = {"metavar": metavar or kind.metavar}
    told["help"] = _sentence(f"do not {argument.help}" if off else argument.help)
    word = argument.name.strip("_").replace("_", "-")
    if names == [] and (required or row.startswith("[")):
        found, title = typer.Argument(default, **told), word.upper()
    else:
        no = f"/--no-{word}" if kind.type is bool and argument.default is not False else ""
        names = names or [f"--{word}{no}"]
        found, title = typer.Option(default, *names, **told), names[0]
    type_ = kind.type if argument.default not in (None, ()) else kind.type | None
    parameter = _parameter(argument.name, found, type_)
    return _Option(parameter, lambda read: not read if off else kind.value(read, title))


def _parameter(name: str, default: Any, annotation: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _sentence(text: str) -> str:
    """A line of a docstring as help: it begins with a capital, without marks, and ends."""
    plain = text.replace("`", "")
    return f"{plain[:1].upper()}{plain[1:]}" + ("." if plain and plain[-1] not in ".:" else "")


def _opened(operation: Operation, map_name: str | None, options: Mapping[str, Any]) -> Any:
    """What opens the map, the database or the fields with the method."""
    owner = operation.method.partition(".")[0]
    if owner == "Map":
        return chosen_map(map_name)
    if owner == "SpatialFields":
        return chosen_fields(map_name, options.get("voxel_size", 0.05))
    return open_database()


def _format(form: str) -> Command:
    def say(call: MethodCall) -> None:
        if text := form.format(call(), **call.values):
            print(text)

    return say


def _table(columns: Sequence[str]) -> Command:
    def table(call: MethodCall, json_: Json = False) -> None:
        show_table(call(), json_, columns)

    return table
