"""The command `semmap import`."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from typer import Argument

from semmap import cli
from semmap.cli.operation_command import MethodCall, command_of
from semmap.cli.options import Json, MapName
from semmap.cli.output import StageBars, print_json

if TYPE_CHECKING:
    from semmap.api.database import Database
    from semmap.ingest.importer import ImportSummary


@command_of(
    "Database.import_file",
    path=None,
    map=None,
    mesh_as="--as",
    strict="--strict/--no-strict",
    define="--define/--no-define",
    find_rooms="--find-rooms/--no-find-rooms",
)
def import_command(
    call: MethodCall,
    files: list[Path] = Argument(help="SDF, building.yaml, IFC, IndoorGML, GeoJSON, meshes, ..."),
    map_name: MapName = None,
    json_: Json = False,
) -> None:
    """Read world files into the map: each in one transaction, repeatable."""
    summaries: list[ImportSummary] = []
    find_rooms = call.values.pop("find_rooms")
    for path in files:
        last = find_rooms and path is files[-1]
        with StageBars() as bars:
            summary = call(path=path, map=map_name, progress=bars.report, find_rooms=last)
        summaries.append(summary)
        map_name = map_name or summary.map
    if not find_rooms:
        _name_roomless(call.handle, {summary.map for summary in summaries})
    if json_:
        print_json([summary.as_json() for summary in summaries])
        return
    for summary in summaries:
        print_summary(summary)


def _name_roomless(db: Database, maps: Iterable[str]) -> None:
    for name in sorted(maps):
        if not db.map(name).rooms:
            cli.err.print(
                f"map {name} has no rooms: semmap rooms find --map {name} finds them in walls"
            )


def print_summary(s: ImportSummary) -> None:
    """Print what came in, and what was left out and why."""
    from rich.text import Text

    from semmap.ingest.naming import SURE

    kinds = ", ".join(f"{n} {kind}{'' if n == 1 else 's'}" for kind, n in s.kinds.items())
    bold = partial(Text, style="bold")
    cli.out.print(
        Text.assemble(bold(Path(s.source).name), " -> map ", bold(s.map), ": ", kinds or "nothing")
    )
    cli.out.print(
        f"  {s.added} added, {s.changed} changed, {s.removed} removed, {s.unchanged} unchanged; "
        f"{s.models} new meshes, {s.triangles:,} triangles; {s.holders} holders derived; "
        f"{s.seconds:.1f} s"
    )
    if s.guessed:
        unsure = [f"{g['name']} {g['type']}" for g in s.guessed if g["confidence"] < SURE]
        some = f", {len(unsure)} of them uncertain ({', '.join(unsure[:3])})" if unsure else ""
        text = f"{len(s.guessed)} types guessed from names{some}; to list them: semmap ls --guessed"
        cli.out.print(f"  {text}")
    for note in s.notes:
        cli.out.print(f"  note: {note}", style="dim")
    if s.skipped:
        cli.out.print(f"  left out: {len(s.skipped)}", style="yellow")
        for skipped in s.skipped:
            text = f"    {skipped.element}: {skipped.problem}. {skipped.fix}"
            cli.out.print(text, style="yellow")
