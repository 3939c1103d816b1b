"""The program `semmap`: its commands are thin layers over the Python API."""

from __future__ import annotations

import gc
import os
import sys

import typer
from typer import Option

from semmap.cli.chosen import CliOptions
from semmap.cli.plugin_group import PluginGroup
from semmap.error import Error
from semmap.terminal import guard_streams


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"semmap {version('semmap')}")
        raise typer.Exit


def _main(
    db: str | None = Option(
        None, envvar="SEMMAP_DB", help="Database URL; by default the embedded one."
    ),
    version: bool = Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print it and end."
    ),
) -> None:
    CliOptions.url = db
    guard_streams()


app = typer.Typer(
    cls=PluginGroup,
    callback=_main,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="One semantic map in PostGIS: what is where, what it means, how to get there.",
)


_NEW_OBJECTS = 10_000
"""Between looks for cycles; Python's 700 make dozens of them while modules are imported."""


def main() -> None:
    """Run the command line; an expected error is one line and exit code 2."""
    guard_streams()
    # loading it takes a tenth of a second of the processor on two cores, for threads that wait
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(_NEW_OBJECTS)
    try:
        app()
    except Exception as error:
        message = _expected(error)
        if message is None:
            raise
        from semmap.cli.output import err

        err.print(f"error: {message}", style="red")
        sys.exit(2)
    finally:
        if "ompl" not in sys.modules:  # whose bindings report what is left as leaks
            gc.freeze()  # the end of a process frees all: looking for cycles takes a tenth of it


def _expected(error: Exception) -> str | None:
    """The message for the user of an error that bad input or a missing database causes."""
    import psycopg

    cause = getattr(error, "orig", error)  # SQLAlchemy keeps the driver's error there
    if isinstance(cause, psycopg.Error):
        from semmap.query.refusal import refusal_text

        message = refusal_text(cause)
        if isinstance(cause, psycopg.errors.ReadOnlySqlTransaction):
            message += ". Add --write to let the statement change the map"
        return message
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, LookupError) and error.args:
        return str(error.args[0])
    if isinstance(error, (Error, LookupError, ValueError)):
        return str(error)
    return None
