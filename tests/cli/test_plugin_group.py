"""Commands of other packages are loaded when they are asked for."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest
import typer
from typer.testing import CliRunner

import semmap
from semmap import cli
from semmap.api.operations import COMMANDS
from semmap.cli import plugin_group

HEAVY = ("scipy", "trimesh", "rdflib", "clingo", "networkx")


def modules_loaded_by(*words: str) -> set[str]:
    """The packages that a process has loaded once the command line is done."""
    call = (
        f"import sys; sys.argv = ['semmap', *{words!r}]; from semmap.cli import app\n"
        "try: app()\n"
        "finally: print('loaded', *{name.partition('.')[0] for name in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", call], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("command", ["ls", "show", "sql", "maps", "changes"])
def test_asking_the_map_loads_no_library_of_grids_and_plans(command: str) -> None:
    assert not modules_loaded_by(command, "--help") & {*HEAVY, "navgrid", "planner"}


@pytest.mark.parametrize("command", ["ls", "maps", "types", "changes", "show mug"])
def test_short_commands_load_neither_sqlalchemy_nor_numpy(database: str, command: str) -> None:
    with semmap.connect(database) as db:
        db.create_map("flat").add_object("mug", size=(0.1, 0.1, 0.1), pose=(0, 0, 0))
    loaded = modules_loaded_by("--db", database, *command.split())
    assert not loaded & {*HEAVY, "sqlalchemy", "numpy", "shapely", "pydantic", "alembic"}


def test_help_loads_no_other_package() -> None:
    heavy = {*HEAVY, "sqlalchemy", "numpy", "psycopg", "rich", "navgrid", "planner"}
    assert not modules_loaded_by("--help") & heavy


def test_all_are_listed_each_with_its_help() -> None:
    said = CliRunner().invoke(cli.app, ["--help"], env={"COLUMNS": "200"}).stdout
    assert {"route", "plan", "costmap", "regions", "fields"} <= COMMANDS.keys()
    rows = [line.split() for line in said.partition("Commands:")[2].splitlines()]
    helps = {row[0]: row[1:] for row in rows if row}
    for name in COMMANDS:
        assert len(helps[name]) > 3


def test_a_typo_gets_a_suggestion() -> None:
    done = CliRunner().invoke(cli.app, ["topologie"])
    assert done.exit_code == 2
    assert "Did you mean 'topology'?" in done.output


def test_a_package_adds_a_function_or_a_group(monkeypatch: pytest.MonkeyPatch) -> None:
    group = typer.Typer()
    group.command("sing")(lambda: print("la"))
    group.command("hum")(lambda: print("mm"))
    added = {"shout": lambda: print("HA"), "voice": group, "odd": 7}
    monkeypatch.setattr(EntryPoint, "load", lambda point: added[point.name])

    def points(group: str, name: str | None = None) -> list[EntryPoint]:
        return [EntryPoint(n, "there:it", group) for n in added if name in (None, n)]

    monkeypatch.setattr(plugin_group, "entry_points", points)
    for words, says in (
        (["shout"], "HA\n"),
        (["voice", "sing"], "la\n"),
        (["voice", "hum"], "mm\n"),
    ):
        assert CliRunner().invoke(cli.app, words, catch_exceptions=False).stdout == says
    with pytest.raises(TypeError, match="odd is 7, neither a function nor"):
        CliRunner().invoke(cli.app, ["odd"], catch_exceptions=False)
