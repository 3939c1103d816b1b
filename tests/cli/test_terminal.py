"""No name controls the terminal: through the real command line, as a table, an error, a print."""

from __future__ import annotations

import io
import json
import os
import pty
import subprocess
import sys
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table
from rich.text import Text
from sqlalchemy import Engine, text

from semmap.cli.console import SafeConsole
from semmap.terminal import visible
from tests.command_line import semmap
from tests.forked import semmap_process
from tests.ingest.worlds_by_hand import box_world

HOSTILE = "mug\x1b[2J\x1b]0;owned\x07\r\x9b31m\u202egnp.\u2066\x7f\x08"
SHOWN = "mug\\x1b[2J\\x1b]0;owned\\x07\\r\\x9b31m\\u202egnp.\\u2066\\x7f\\x08"


def controls(text: str) -> set[str]:
    """What of a text controls a terminal, by the Unicode database."""
    bidi = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
    return {
        c
        for c in text
        if (unicodedata.category(c) in ("Cc", "Cs") and c not in "\n\t")
        or unicodedata.bidirectional(c) in bidi
    }


@pytest.fixture(scope="module")
def office(module_engine: Engine) -> str:
    """A map with a hostile name, in which there is a room and a thing of hostile names."""
    with module_engine.begin() as connection:
        connection.execute(
            text(
                "WITH m AS (INSERT INTO map (name) VALUES (:name) RETURNING id) "
                "INSERT INTO entity (map_id, kind, name, label, type, properties) "
                "SELECT id, k, k || :name, :name, k, jsonb_build_object('k', CAST(:name AS text)) "
                "FROM m, unnest(ARRAY['object', 'room']) k"
            ),
            {"name": HOSTILE},
        )
    return module_engine.url.render_as_string(hide_password=False)


@pytest.mark.parametrize(
    "words",
    [
        ("ls",),
        ("show", f"object{HOSTILE}"),
        ("maps",),
        ("changes",),
        ("sql", "SELECT name FROM entity ORDER BY 1"),
        ("sql", 'SELECT 1 AS "' + HOSTILE + '"'),
        ("show", f"object{HOSTILE}x"),
        ("ls", HOSTILE),
        ("ls", "--map", HOSTILE + "x"),
        ("sql", f"SELECT '{HOSTILE}'::int"),
        ("import", HOSTILE),
        ("ls", "--near", HOSTILE),
        (HOSTILE,),
        ("ls", f"--{HOSTILE}"),
        ("drop", HOSTILE + "x", "--yes"),
        ("route", HOSTILE, HOSTILE),
        ("topology", "--format", "dot"),
    ],
)
def test_no_name_controls_the_terminal(office: str, words: tuple[str, ...]) -> None:
    done = semmap_process(office, *words)
    said = done.stdout + done.stderr
    assert "Traceback" not in said
    assert controls(said) == set()


def test_names_are_shown(office: str) -> None:
    names = ("sql", "SELECT name FROM entity ORDER BY 1")
    assert f"object{SHOWN}" in semmap_process(office, *names).stdout
    assert f"object{SHOWN}" in semmap(office, *names).stdout
    assert (
        f"did you mean object{SHOWN}" in semmap_process(office, "show", f"object{HOSTILE}x").stderr
    )
    told = json.loads(semmap_process(office, *names, "--json").stdout)
    assert [row["name"] for row in told] == [f"object{HOSTILE}", f"room{HOSTILE}"]


def test_element_of_a_file(office: str, tmp_path: Path) -> None:
    folder = tmp_path / "a\x1b[2Jb\u202e"
    folder.mkdir()
    world = box_world(folder, {"mug\u202e": (0, 0, 0), "cup\u202e": (0, 0, float("nan"))})
    said = semmap(office, "import", world, "--map", "filed").output
    assert "left out: 1" in said
    assert "cup\\u202e" in said
    assert controls(said) == set(), repr(said)


PRINTS = """
import sys, warnings
from semmap import cli
name = sys.argv.pop()
@cli.app.command()
def prints():
    print(name, flush=True)
    print(name, file=sys.stderr)
    warnings.warn(name)
    raise RuntimeError(name)
sys.argv = ["semmap", "prints"]
cli.main()
"""


def test_prints_warnings_and_tracebacks() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PRINTS, HOSTILE], capture_output=True, text=True, check=False
    )
    assert done.stdout == SHOWN + "\n"
    assert done.stderr.count(SHOWN) >= 3
    assert controls(done.stdout + done.stderr) == set()


def test_on_a_terminal_the_colours_are_our_own(office: str) -> None:
    """The table's own control sequences are obeyed, those of names are not."""
    for words in (["ls"], ["--help"], ["ls", "--help"]):
        said = on_a_terminal(office, *words)
        assert ("\x1b[1m" in said) == ("--help" not in words)
        assert "\\x1b[1m" not in said
        assert "\x1b[2J" not in said
        assert "\x07" not in said
    assert SHOWN in on_a_terminal(office, "sql", "SELECT name FROM map")


def on_a_terminal(url: str, *words: str) -> str:
    """What `semmap WORDS` writes to a terminal that is 300 columns wide."""
    ours, theirs = pty.openpty()
    call = "import sys; sys.argv[0] = 'semmap'; from semmap.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", call, "--db", url, *words],
        stdout=theirs,
        stderr=theirs,
        stdin=theirs,
        env={**os.environ, "COLUMNS": "300", "TERM": "xterm-256color", "SEMMAP_MAP": HOSTILE},
    )
    os.close(theirs)
    said = b"".join(chunks(ours))
    assert process.wait() == 0
    os.close(ours)
    return said.decode()


def chunks(terminal: int) -> Iterator[bytes]:
    while True:
        try:
            yield os.read(terminal, 1 << 16)
        except OSError:  # nobody has it open any more
            return


@given(st.text(st.characters()))
def test_visible(text: str) -> None:
    shown = visible(text)
    assert controls(shown) == set()
    shown.encode()
    if not controls(text):
        assert shown == text


@given(st.text(st.characters(codec="utf-8")), st.text(st.characters(codec="utf-8")))
def test_console(a: str, b: str) -> None:
    file = io.StringIO()
    console = SafeConsole(file=file, markup=False, emoji=False, highlight=False, width=200)
    table = Table(a, title=b)
    table.add_row(b)
    console.print(a, Text(b), table)
    assert controls(file.getvalue()) == set()
