"""The table of operations says what the face can do: no method and no command is left out."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import pytest
import typer
from typer.testing import CliRunner

import semmap
from semmap import cli
from semmap.api.operations import COMMANDS, OPERATIONS, Operation
from semmap.api.signatures import REQUIRED
from semmap.api.spatial_fields import SpatialFields
from semmap.cli.operation_command import OperationCommand

ROOT = Path(__file__).parents[2]

OWNERS = (semmap.Map, semmap.Database, semmap.MapEntity, semmap.Door, SpatialFields)

HANDLES = {
    "is_usable",
    "address",
    "close",
    "connection",
    "engine",
    "entity",
    "fields",
    "in_transaction",
    "reading",
    "reading_engine",
    "session",
    "snapshot",
    "transaction",
    "with_voxel_size",
}
"""What opens, closes and lends connections, or leads to other operations."""

OWN = {"demo", "mcp", "serve", "view", "db"}
"""Commands of the program itself: the demo, and the database's server and schema."""


OPEN = {inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD}
"""Arguments without a name, which no other face can give."""


def leaves(group: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Each command without commands below it, by its words."""
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if isinstance(command, click.Group) or hasattr(command, "list_commands"):
            yield from leaves(command, (*words, name))
        else:
            yield " ".join((*words, name)), command


def commands() -> dict[str, Any]:
    """The commands of the program, by their words."""
    return dict(leaves(typer.main.get_command(cli.app)))


def test_each_command_is_an_operation() -> None:
    listed = {operation.command for operation in OPERATIONS}
    known = {words for words in commands() if words.split()[0] not in OWN}
    assert known - listed == set()
    assert listed - known == {None}


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda each: each.method)
def test_an_operation_is_described(operation: Operation) -> None:
    owner, method = operation.method.split(".")
    found = inspect.getattr_static({each.__name__: each for each in OWNERS}[owner], method)
    function = found.fget if isinstance(found, property) else found
    assert (inspect.getdoc(function) or "").partition("\n")[0].endswith((".", ":"))
    signature = inspect.signature(function)
    for name, one in signature.parameters.items():
        assert name == "self" or one.annotation is not inspect.Parameter.empty, name
    assert signature.return_annotation is not inspect.Signature.empty


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda each: each.method)
def test_the_source_says_what_the_method_takes(operation: Operation) -> None:
    owner, method = operation.method.split(".")
    found = inspect.getattr_static({each.__name__: each for each in OWNERS}[owner], method)
    found = getattr(found, "fget", None) or getattr(found, "func", None) or found
    signature = inspect.signature(getattr(found, "__func__", found))
    kept = [each for each in signature.parameters.values() if each.kind not in OPEN]
    given = operation.arguments
    assert [each.name for each in given] == [each.name for each in kept if each.name != "self"]
    for read, each in zip(given, (each for each in kept if each.name != "self"), strict=True):
        assert read.annotation == each.annotation
        if each.default is inspect.Parameter.empty:
            assert read.default is REQUIRED
        elif not callable(each.default):
            assert read.default == each.default
    assert operation.result == signature.return_annotation
    assert operation.help == (inspect.getdoc(found) or "").partition("\n")[0]


@pytest.mark.parametrize("owner", OWNERS, ids=lambda each: each.__name__)
def test_each_public_method_is_an_operation(owner: type) -> None:
    listed = {each.method for each in OPERATIONS}
    own = vars(owner) if owner is semmap.Door else dir(owner)
    public = {name for name in own if not name.startswith("_")} - HANDLES
    missing = {name for name in public if f"{owner.__name__}.{name}" not in listed}
    assert missing == set()


def test_no_operation_is_listed_twice() -> None:
    rows = [(each.method, each.command) for each in OPERATIONS]
    assert len(set(rows)) == len(rows)


MOST_LINES = 40


def test_a_command_is_short() -> None:
    """A command parses, calls a method and prints: in at most 40 lines, its options included."""
    folder = ROOT / "semmap/cli"
    long = [
        f"{file.name}: {node.name}, {lines} lines"
        for file in [*sorted(folder.glob("*.py")), folder / "demo/command.py"]
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.FunctionDef)
        if (lines := (node.end_lineno or 0) - node.lineno + 1) > MOST_LINES
    ]
    assert long == []


def made_commands() -> Iterator[OperationCommand]:
    """The commands that are made of a method, in all modules of the command line."""
    for module in {command.module for command in COMMANDS.values()}:
        for each in vars(import_module(f"semmap.cli.{module}")).values():
            if isinstance(each, OperationCommand):
                yield each
            elif isinstance(each, typer.Typer):
                functions = (one.callback for one in each.registered_commands)
                yield from (one.made_of for one in functions if hasattr(one, "made_of"))


def test_a_made_command_is_the_command_of_its_operation() -> None:
    known, seen = commands(), set()
    for made in made_commands():
        if made.operation.command in seen:
            continue
        seen.add(made.operation.command)
        arguments = {argument.name for argument in made.operation.arguments}
        assert made.rows.keys() <= arguments | {"voxel_size"}, made.method
        options = {one.name for one in known[made.operation.command].params}
        assert options == set(inspect.signature(made.function).parameters), made.method
        assert made.options.keys() <= options & arguments, made.method
    assert len(seen) > 50


@pytest.mark.parametrize("words", commands())
def test_each_command_has_a_help(words: str) -> None:
    done = CliRunner().invoke(cli.app, [*words.split(), "--help"])
    assert done.exit_code == 0
    assert f"Usage: semmap {words}" in done.output.replace("root", "semmap")
