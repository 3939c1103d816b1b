"""The database and the map that the user chose. No command but an import changes a schema."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from semmap.api.database import Database
    from semmap.api.map import Map
    from semmap.api.spatial_fields import SpatialFields


class CliOptions:
    """What the options before the command say."""

    url: str | None = None


def chosen_url() -> str | None:
    """The database of the option `--db`; None for that of `SEMMAP_DB`, or the embedded one."""
    return CliOptions.url


@contextmanager
def open_database(*, migrate: bool = False) -> Iterator[Database]:
    """The database that the user chose, through the public API, while it lasts."""
    from semmap.api.database import connect

    with connect(CliOptions.url, migrate=migrate) as chosen:
        yield chosen


@contextmanager
def chosen_map(name: str | None, *, migrate: bool = False) -> Iterator[Map]:
    """The map of a name, else the chosen one, else the only one, while it lasts.

    typer.BadParameter if there is no such map, none at all, or several and none is chosen.
    """
    with open_database(migrate=migrate) as chosen:
        try:
            found = chosen.map(name)
        except LookupError as error:
            raise typer.BadParameter(str(error)) from None
        yield found


@contextmanager
def chosen_fields(map_name: str | None, voxel_size: float) -> Iterator[SpatialFields]:
    """The fields of the chosen map; its database is opened where no service answers."""
    from semmap.api.spatial_fields import SpatialFields

    with ExitStack() as stack:
        yield SpatialFields(
            chosen_url(),
            map_name,
            cache(lambda: stack.enter_context(chosen_map(map_name))),
            voxel_size,
            _note,
        )


def _note(text: str) -> None:
    if text.startswith("left out: "):
        from semmap.cli.output import err

        err.print(text, style="yellow")
    else:
        print(text, file=sys.stderr)
