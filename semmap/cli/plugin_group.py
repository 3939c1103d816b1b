"""The commands of `semmap`: its own, and those of other packages, made when one is called.

A package adds a command by an entry point of the group ``semmap.commands``: its name is that of the
command, what it names is the command's function, or a `typer.Typer` with several below it.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import typer
from typer.core import TyperGroup

from semmap.api.operations import COMMANDS
from semmap.cli.texts import with_options
from semmap.error import Error
from semmap.terminal import visible

GROUP = "semmap.commands"


class PluginGroup(TyperGroup):
    """A group of commands to which other packages add; a list of them imports no other package.

    Typer makes a command by inspecting a function. That takes time, so it waits for a call. `own`
    are the functions and the groups (`typer.Typer`) of the program itself, in the order of help.
    """

    own: ClassVar[Mapping[str, object]] = {}

    @cached_property
    def added(self) -> dict[str, EntryPoint]:
        """The commands of the table of operations, and those that other packages add, by name."""
        known = {name: EntryPoint(name, home, GROUP) for name, home in COMMANDS.items()}
        return {point.name: point for point in entry_points(group=GROUP)} | known

    def list_commands(self, ctx: Any) -> list[str]:
        """The names of all commands, its own first."""
        return [*self.own, *sorted(self.added.keys() - self.own.keys())]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a name; for an unknown name all are made, to find a similar one."""
        known = cmd_name in self.own or cmd_name in self.added
        for name in [cmd_name] if known else self.list_commands(ctx):
            if name not in self.commands:
                added = self.own[name] if name in self.own else self.added[name].load()
                self.commands[name] = _command(name, added)
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each command with the first line of its help."""
        rows = [
            (name, _help(self.own[name]) if name in self.own else help_line(self.added[name]))
            for name in self.list_commands(ctx)
        ]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def invoke(self, ctx: Any) -> Any:
        """Run a command; the message of an error names its options, without control codes."""
        try:
            return super().invoke(ctx)
        except Exception as error:  # Typer's usage errors, which it prints by itself
            if isinstance(message := getattr(error, "message", None), str):
                error.message = visible(message)  # type: ignore[attr-defined]
            if isinstance(error, Error | LookupError | ValueError):
                error.args = tuple(with_options(a) if isinstance(a, str) else a for a in error.args)
            raise


def _help(command: object) -> str:
    whole = command.info.help if isinstance(command, typer.Typer) else command.__doc__
    return (whole or "").partition("\n")[0]


def help_line(point: EntryPoint) -> str:
    """The first line of a command's help, read from the source of its module, not by an import.

    It is the docstring of the function, or the `help` of the `typer.Typer`, that the entry point
    names; empty where the source does not show it.
    """
    path = _source(point.module)
    for node in [] if path is None else _statement(path.read_text("utf-8"), point.attr):
        if isinstance(node, ast.FunctionDef) and node.name == point.attr:
            return (ast.get_docstring(node) or "").partition("\n")[0]
        targets = node.targets if isinstance(node, ast.Assign) else []
        if any(isinstance(t, ast.Name) and t.id == point.attr for t in targets):
            call = getattr(node, "value", None)
            for keyword in getattr(call, "keywords", []):
                if keyword.arg == "help" and isinstance(keyword.value, ast.Constant):
                    return str(keyword.value.value).partition("\n")[0]
    return ""


def _statement(source: str, name: str) -> list[ast.stmt]:
    """The statement of a module that defines a name: parsing the whole module takes much longer.

    It ends where another begins: at a line that is neither indented nor closes a bracket. Where
    that is within a string, all statements are returned.
    """
    found = re.search(rf"^(?:def )?{name}\b.*(?:\n(?![^\s)\]}}]).*)*", source, re.MULTILINE)
    try:
        return ast.parse(found[0] if found else "").body
    except SyntaxError:
        return ast.parse(source).body


def _source(module: str) -> Path | None:
    """The file of a module, found from its top package, which is the only one that is looked up."""
    top, *names = module.split(".")
    spec = find_spec(top)
    if spec is None:
        return None
    folders = list(spec.submodule_search_locations or [])
    if not names:
        return Path(spec.origin) if spec.origin else None
    for folder in folders:
        base = Path(folder, *names)
        for path in (base.with_suffix(".py"), base / "__init__.py"):
            if path.is_file():
                return path
    return None


def _command(name: str, added: object) -> Any:
    around = typer.Typer(add_completion=False, rich_markup_mode=None)
    around.callback()(lambda: None)
    if isinstance(added, typer.Typer):
        added.rich_markup_mode = None
        around.add_typer(added, name=name)
    elif callable(added):
        around.command(name)(added)
    else:
        raise TypeError(f"{GROUP}: {name} is {added!r}, neither a function nor a typer.Typer")
    group = typer.main.get_command(around)
    assert isinstance(group, TyperGroup)
    return group.commands[name]
