"""Commands made of operations: the arguments of a method are the options of its command.

A command prints what the method returns. It is a format, the columns of a table, or a function that
gets a `MethodCall` and may have options of its own, or data classes of options::

    printed("Database.undo_links", "{0} links taken back")
    printed("Map.list_regions", ("name", "type", "origin"))

    @command_of("Map.contradictions")
    def contradictions(call: MethodCall, json_: Json = False) -> None: ...

The rest says how an option differs from its argument: ``keep_as="--keep"`` has another name,
``base="X,Y"`` a metavar, ``name="[NAME]"`` is an argument of the command that may be left out,
``check="--unchecked"`` makes it False, and ``progress=None`` is no option.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property, partial
from inspect import Parameter, Signature, signature
from typing import Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from semmap.api.operations import COMMANDS, OPERATIONS, Operation
from semmap.api.signatures import REQUIRED, Argument
from semmap.cli.chosen import chosen_fields, chosen_map, open_database
from semmap.cli.options import Json, MapName, VoxelSize
from semmap.cli.output import show_rows
from semmap.cli.texts import kind_of

Print = Callable[..., None]
How = str | tuple[str, ...] | Callable[[Any], object]


class MethodCall:
    """The method of a command, with the values that the user gave.

    Attributes
    ----------
    values : by argument; those that were not given are left to the method
    texts : what Typer read, also of options that were not given
    """

    def __init__(
        self, name: str, values: dict[str, Any], texts: dict[str, Any], opened: Callable[[], Any]
    ) -> None:
        self._name, self._opened, self.values, self.texts = name, opened, values, texts

    @cached_property
    def handle(self) -> Any:
        """The map, the database or the fields with the method, open until the command ends."""
        return self._opened()

    def __call__(self, **others: Any) -> Any:
        """What the method returns."""
        found = getattr(self.handle, self._name)
        return found(**self.values, **others) if callable(found) else found


@dataclass(frozen=True)
class OperationCommand:
    """A row of the command line: a method, how options differ from arguments, what prints."""

    method: str
    rows: Mapping[str, str | None]
    show: Print

    @cached_property
    def operation(self) -> Operation:
        """The operation, which has the command's words."""
        return next(each for each in OPERATIONS if each.method == self.method)

    @property
    def help(self) -> str:
        """What its function says, else the table of operations, else the method."""
        words = str(self.operation.command)
        known = COMMANDS[words].help if words in COMMANDS else _sentence(self.operation.help)
        return self.show.__doc__ or known

    @cached_property
    def options(self) -> dict[str, _Option]:
        """The options that are arguments of the method; its source is read when they are needed."""
        given = {each.name: each for each in self.operation.arguments}
        found = {name: _option(each, self.rows.get(name, "")) for name, each in given.items()}
        return {name: option for name, option in found.items() if option is not None}

    @property
    def function(self) -> Print:
        """The command as Typer takes it."""
        parameters = [*(each.parameter for each in self.options.values()), *self._own()]

        def command(**given: Any) -> None:
            self.run(given)

        command.made_of = self  # type: ignore[attr-defined]
        command.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        command.__annotations__ = {each.name: each.annotation for each in parameters}
        return command

    def run(self, given: dict[str, Any]) -> None:
        """Call the method with what Typer read, and print."""
        texts = {name: given.pop(name) for name in self.options}
        values = {
            name: self.options[name].value(read)
            for name, read in texts.items()
            if read is not None and read != []
        }
        opened = self._opened(given)
        for name, kind in self._groups.items():
            given[name] = kind(**{one.name: given.pop(one.name) for one in fields(kind)})
        with ExitStack() as stack:
            name = self.method.partition(".")[2]
            call = MethodCall(name, values, texts, lambda: stack.enter_context(opened))
            self.show(call, **given)

    def _own(self) -> list[Parameter]:
        """The options that are no arguments: which map, and those of the function."""
        found = []
        if not self.method.startswith("Database."):
            found.append(_parameter("map_name", None, MapName))
        if self.method.startswith("SpatialFields.") and "voxel_size" not in self.rows:
            found.append(_parameter("voxel_size", 0.05, VoxelSize))
        hints = get_type_hints(self.show, include_extras=True)
        for each in [*signature(self.show).parameters.values()][1:]:
            if (kind := self._groups.get(each.name)) is None:
                found.append(_parameter(each.name, each.default, hints[each.name]))
            else:
                types = get_type_hints(kind, include_extras=True)
                found += [
                    _parameter(one.name, one.default, types[one.name]) for one in fields(kind)
                ]
        return found

    @cached_property
    def _groups(self) -> dict[str, Any]:
        """The parameters of the function that are data classes: each field is an option."""
        hints = get_type_hints(self.show)
        return {name: kind for name, kind in hints.items() if is_dataclass(kind)}

    def _opened(self, given: dict[str, Any]) -> Any:
        """What opens the map, the database or the fields with the method, by what was given."""
        owner = self.method.partition(".")[0]
        if owner == "Map":
            return chosen_map(given.pop("map_name"))
        if owner == "SpatialFields":
            return chosen_fields(given.pop("map_name"), given.pop("voxel_size", 0.05))
        if self.operation.right == "none":
            from semmap.api.database import Database

            return nullcontext(Database)
        return open_database(migrate=self.method == "Database.import_file")


def command_of(method: str, **rows: str | None) -> Callable[[Print], OperationCommand]:
    """Return a decorator: of a function that prints it makes a command."""
    return partial(OperationCommand, method, rows)


def printed(method: str, how: How, **rows: str | None) -> OperationCommand:
    """Return a command that prints a result: by a format, a function, or as a table's columns."""
    return OperationCommand(method, rows, _table(how) if isinstance(how, tuple) else _told(how))


def group(*commands: OperationCommand, cls: type[TyperGroup] = TyperGroup) -> typer.Typer:
    """Return a group of commands, which are named as the table of operations does."""
    found = typer.Typer(no_args_is_help=True, cls=cls)
    for each in commands:
        name = str(each.operation.command).rpartition(" ")[2]
        found.command(name, help=each.help, cls=NumbersCommand)(each.function)
    return found


class NumbersCommand(TyperCommand):
    """A command in which -1 and -1,2,3 are numbers, not options."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As words that begin with a negative number are no options."""
        ctx.ignore_unknown_options |= any(re.match(r"-\.?\d", word) for word in args)
        return super().parse_args(ctx, args)


@dataclass(frozen=True)
class _Option:
    """An argument as Typer reads it, and what becomes of what was read."""

    parameter: Parameter
    value: Callable[[Any], Any]


def _option(argument: Argument, row: str | None) -> _Option | None:
    """The option of an argument; None where the row is None, or where no text has its type."""
    if row is None:
        return None
    words = (row.strip("[]") if row.startswith("[-") else row).split()
    names = [word for word in words if word.startswith("-")]
    metavar = next((word for word in words if not word.startswith("-")), None)
    kind = kind_of(argument.annotation, metavar or argument.help)
    if kind is None:
        return None
    default: Any = argument.default
    if default is REQUIRED:
        default = None if row.startswith("[") else ...
    if isinstance(default, tuple) and kind.type is str:
        default = ",".join(map(str, default))
    word = argument.name.strip("_").replace("_", "-")
    placed = not names and (default is ... or row.startswith("["))
    off = default is True and names != [] and "/" not in names[0]
    many = "; repeatable" if kind.type == list[str] and not placed else ""
    told: dict[str, Any] = {"metavar": metavar or kind.metavar}
    told["help"] = _sentence(f"{'do not ' if off else ''}{argument.help}{many}")
    if placed:
        found, title = typer.Argument(default, **told), word.upper()
    else:
        no = f"/--no-{word}" if kind.type is bool and default is not False else ""
        names = names or [f"--{word}{no}"]
        found, title = typer.Option(False if off else default, *names, **told), names[0]
    type_ = kind.type | None if default in (None, ()) else kind.type
    parameter = _parameter(argument.name, found, type_)
    return _Option(parameter, lambda read: not read if off else kind.value(read, title))


def _parameter(name: str, default: Any, annotation: Any) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _sentence(text: str) -> str:
    """A line of a docstring as help: it begins with a capital, without marks, and ends."""
    plain = text.replace("`", "")
    return f"{plain[:1].upper()}{plain[1:]}" + ("." if plain and plain[-1] not in ".:" else "")


def _told(how: str | Callable[[Any], object]) -> Print:
    def tell(call: MethodCall) -> None:
        found = call()
        if not isinstance(how, str):
            how(found)
        elif how:
            print(how.format(found, **call.values))

    return tell


def _table(columns: tuple[str, ...]) -> Print:
    def table(call: MethodCall, json_: Json = False) -> None:
        rows = [
            row if isinstance(row, tuple) else tuple(row[name] for name in columns)
            for row in call()
        ]
        show_rows(list(columns), rows, json_)

    return table
