"""The command line, in this process: what would be an error's line is raised."""

from __future__ import annotations

from typer.testing import CliRunner, Result

from semmap import cli


def semmap(url: str, *words: object) -> Result:
    """What `semmap WORDS` says of a database."""
    said = ["--db", url, *map(str, words)]
    return CliRunner().invoke(cli.app, said, catch_exceptions=False)
