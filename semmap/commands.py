"""The commands of `semmap`: its own, and those of other packages, loaded when they are asked for.

A package adds a command by an entry point of the group ``semmap.commands``: its name is that of the
command, what it names is the command's function, or a `typer.Typer` with several below it.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

import typer
from typer.core import TyperGroup

from semmap.terminal import visible

__all__ = ["GROUP", "Commands"]

GROUP = "semmap.commands"


class Commands(TyperGroup):
    """What the command line has; asking who is where loads no library for costmaps."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The names of all, its own first."""
        own = super().list_commands(ctx)
        return own + sorted({point.name for point in entry_points(group=GROUP)} - {*own})

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a name; of an unknown one all are loaded, for one that is meant."""
        if cmd_name not in self.commands:
            for point in entry_points(group=GROUP, name=cmd_name) or entry_points(group=GROUP):
                self.commands.setdefault(point.name, _command(point.name, point.load()))
        return super().get_command(ctx, cmd_name)

    def invoke(self, ctx: Any) -> Any:
        """Run a command; the message of a usage error, in which names are, is shown, not obeyed."""
        try:
            return super().invoke(ctx)
        except Exception as error:  # Typer's usage errors, which it prints by itself
            if isinstance(message := getattr(error, "message", None), str):
                error.message = visible(message)  # type: ignore[attr-defined]
            raise


def _command(name: str, said: object) -> Any:
    around = typer.Typer(add_completion=False)
    around.callback()(lambda: None)
    if isinstance(said, typer.Typer):
        around.add_typer(said, name=name)
    elif callable(said):
        around.command(name)(said)
    else:
        raise TypeError(f"{GROUP}: {name} is {said!r}, neither a function nor a typer.Typer")
    group = typer.main.get_command(around)
    assert isinstance(group, TyperGroup)
    return group.commands[name]
