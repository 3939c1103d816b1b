"""The commands of `semmap`: those of the table of operations, and those of other packages.

A package adds a command by an entry point of the group ``semmap.commands``: its name is that of the
command, what it names is the command's function, or a `typer.Typer` with several below it.
"""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import typer
from typer.core import TyperGroup

from semmap.api.operations import COMMANDS
from semmap.cli.operation_command import NumbersCommand
from semmap.cli.texts import with_options
from semmap.error import Error
from semmap.terminal import visible

GROUP = "semmap.commands"


class PluginGroup(TyperGroup):
    """A group of commands to which other packages add; its own are loaded when they are called.

    Typer makes a command by inspecting a function. That takes time, so it waits for a call.
    """

    @cached_property
    def added(self) -> dict[str, EntryPoint]:
        """The commands that other packages add, by name."""
        found = {point.name: point for point in entry_points(group=GROUP)}
        return {name: found[name] for name in sorted(found.keys() - COMMANDS.keys())}

    def list_commands(self, ctx: Any) -> list[str]:
        """The names of all commands, its own first."""
        return [*COMMANDS, *self.added]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a name; for an unknown name all are made, to find a similar one."""
        known = cmd_name in COMMANDS or cmd_name in self.added
        for name in [cmd_name] if known else self.list_commands(ctx):
            if name not in self.commands:
                self.commands[name] = self._command(name)
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each command with the first line of its help."""
        rows = [(name, each.help) for name, each in COMMANDS.items()]
        rows += [(name, self._command(name).get_short_help_str()) for name in self.added]
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

    def _command(self, name: str) -> Any:
        around = typer.Typer(add_completion=False, rich_markup_mode=None)
        around.callback()(lambda: None)
        found = _own(name) if name in COMMANDS else self.added[name].load()
        if isinstance(found, typer.Typer):
            found.rich_markup_mode = None
            if name in COMMANDS:
                found.info.help = COMMANDS[name].help
            around.add_typer(found, name=name)
        elif callable(found):
            around.command(name)(found)
        elif isinstance(getattr(found, "help", None), str):  # a `OperationCommand`
            around.command(name, help=found.help, cls=NumbersCommand)(found.function)
        else:
            raise TypeError(f"{GROUP}: {name} is {found!r}, neither a function nor a typer.Typer")
        group = typer.main.get_command(around)
        assert isinstance(group, TyperGroup)
        return group.commands[name]


def _own(name: str) -> Any:
    module = import_module(f"semmap.cli.{COMMANDS[name].module}")
    return getattr(module, f"{name}_command")
