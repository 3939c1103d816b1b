"""The command `semmap interlink`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from semmap import cli

# NumPy, SciPy and rdflib are slow to import: the functions below import what they use.
if TYPE_CHECKING:
    from semmap.interlinking.interlink import Ask, Workbench
    from semmap.interlinking.records import Records

__all__ = ["interlink"]

QUESTIONS = 25


class _FilesOrCommand(TyperGroup):
    """`semmap interlink A B` is short for `semmap interlink link A B`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in (*self.commands, "--help", "-h"):
            args = ["link", *args]
        return super().parse_args(ctx, args)


interlink = typer.Typer(
    cls=_FilesOrCommand,
    no_args_is_help=True,
    help="Find which records of two data sets are the same, and store the links.",
)


@interlink.command()
def link(
    left: Annotated[
        str, typer.Argument(metavar="A", help="RDF or CSV file, map[:NAME], or models.")
    ],
    right: Annotated[str, typer.Argument(metavar="B", help="The same.")],
    labels: Annotated[
        Path | None,
        typer.Option(help="CSV of LEFT,RIGHT,yes|no, or an alignment; --ask adds to a CSV file."),
    ] = None,
    ask: Annotated[
        bool, typer.Option("--ask", help="Ask for the labels that tell most; y, n, or q to end.")
    ] = False,
    questions: Annotated[int, typer.Option(min=1, help="The most questions.")] = QUESTIONS,
    turtle: Annotated[
        Path | None, typer.Option("--turtle", help="Write the links as owl:sameAs to this file.")
    ] = None,
    reference: Annotated[
        Path | None, typer.Option(help="All true links (CSV or alignment): show precision, recall.")
    ] = None,
    type_name: Annotated[
        str | None, typer.Option("--type", help="Of the resources in RDF files.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Store nothing.")] = False,
    map_name: cli.MapName = None,
    json_: cli.Json = False,
) -> None:
    """Find which records of two data sets are the same, and store the links.

    semmap interlink people.rdf clients.csv --labels labels.csv --ask
    """
    from semmap.interlinking.alignment_file import read_labels
    from semmap.interlinking.interlink import Workbench
    from semmap.interlinking.same_as import write_same_as
    from semmap.interlinking.store import store_links

    if labels is None and not ask:
        raise typer.BadParameter("give --labels FILE, or --ask, or both")
    if ask and labels is not None and labels.suffix.lower() in (".rdf", ".xml"):
        raise typer.BadParameter("--ask adds to a CSV file; give --labels FILE.csv")
    known = read_labels(labels) if labels and (labels.exists() or not ask) else {}
    truth = {pair for pair, same in read_labels(reference).items() if same} if reference else None
    sets = (_records(left, type_name, map_name), _records(right, type_name, map_name))
    with _progress() as report:
        work = Workbench(*sets, known, report)
    if ask:
        work.ask(_asker(work, labels), questions)
    found = work.interlink()
    number = None
    if not dry_run:
        with cli.engine(migrate=True).begin() as connection:
            number = store_links(connection.connection.driver_connection, found)  # type: ignore[arg-type]
    if turtle is not None:
        write_same_as(turtle, found.left, found.right, found.links())
    summary: dict[str, Any] = {
        "link_set": number,
        "links": len(found.pairs),
        "candidates": found.candidates,
        "labels": len(found.labels),
        "pattern": found.pattern,
        "correspondences": [vars(c) for c in found.correspondences],
        "unexplained": [list(pair) for pair in found.unexplained],
        "quality": vars(found.quality(truth)) if truth else None,
    }
    if json_:
        cli.print_json(summary)
        return
    for c in found.correspondences:
        print(f"{c.left} = {c.right} ({c.measure})")
    print(f"link if {found.pattern}")
    for a, b in found.unexplained:
        print(f"{a} and {b} are labelled the same, but no pattern separates them from others")
    if truth:
        quality = found.quality(truth)
        print(f"precision {quality.precision:.3f}, recall {quality.recall:.3f}, F {quality.f:.3f}")
    stored = "nothing stored" if number is None else f"link set {number}"
    print(f"{len(found.pairs)} links of {len(found.labels)} labels: {stored}")


@interlink.command()
def ls(json_: cli.Json = False) -> None:
    """List the stored link sets, the newest first."""
    from semmap.interlinking.store import link_sets

    with cli.database() as engine, engine.connect() as connection:
        rows = link_sets(connection.connection.driver_connection)  # type: ignore[arg-type]
    cli.show_table(rows, json_, ("id", "left", "right", "links", "labels", "by", "at"))


@interlink.command()
def show(
    link_set: Annotated[int, typer.Argument(metavar="ID", help="As ls lists them.")],
    all_: Annotated[bool, typer.Option("--all", help="Also records without a link.")] = False,
    json_: cli.Json = False,
) -> None:
    """Show both data sets of a link set as one."""
    from semmap.interlinking.store import merged_records

    with cli.database() as engine, engine.connect() as connection:
        rows = merged_records(connection.connection.driver_connection, link_set)  # type: ignore[arg-type]
    columns = ("resource", "left_keys", "right_keys", "confidence") + ("properties",) * json_
    cli.show_table([r for r in rows if all_ or r["resource"] is not None], json_, columns)


@interlink.command()
def undo(link_set: Annotated[int, typer.Argument(metavar="ID")]) -> None:
    """Take a link set back."""
    from semmap.interlinking.store import undo_links

    with cli.engine().begin() as connection:
        count = undo_links(connection.connection.driver_connection, link_set)  # type: ignore[arg-type]
    print(f"{count} links taken back")


def _records(given: str, type_name: str | None, map_name: str | None) -> Records:
    """The data set that an argument names."""
    from semmap.interlinking.csv_file import read_csv_records
    from semmap.interlinking.rdf_file import FORMATS, read_rdf_records
    from semmap.interlinking.reader import read_map_objects, read_object_models

    kind, colon, name = given.partition(":")
    if given in ("map", "models") or (kind == "map" and colon):
        with cli.database() as engine, engine.connect() as connection:
            session: Any = connection.connection.driver_connection
            if given == "models":
                return read_object_models(session)
            return read_map_objects(session, cli.show_map(session, name or map_name))
    path = Path(given)
    if path.suffix.lower() == ".csv":
        return read_csv_records(path)
    if path.suffix.lower() in FORMATS:
        return read_rdf_records(path, type_name)
    raise typer.BadParameter(
        f"{given}: is not one of map, map:NAME, models, FILE.csv, FILE{', FILE'.join(FORMATS)}"
    )


def _asker(work: Workbench, labels: Path | None) -> Ask:
    """Asks a person about pairs, and keeps the answers in the file of labels."""
    from semmap.interlinking.csv_file import append_label
    from semmap.terminal import visible

    def answer(a: str, b: str) -> bool | None:
        left, right = (s.record(s.number[k]) for s, k in ((work.left, a), (work.right, b)))
        rows = [("", a, b)] + [
            (c.left, ", ".join(left.get(c.left, ())), ", ".join(right.get(c.right, ())))
            for c in work.correspondences
        ]
        widths = [max(len(visible(row[i])) for row in rows) for i in range(2)]
        for row in rows:
            print(
                f"{visible(row[0]):{widths[0]}}  {visible(row[1]):{widths[1]}}  {visible(row[2])}",
                file=sys.stderr,
            )
        while True:
            print("the same? [y/n/q] ", end="", file=sys.stderr, flush=True)
            said = sys.stdin.readline().strip().lower()
            if said in ("y", "yes", "n", "no"):
                if labels is not None:
                    append_label(labels, a, b, said.startswith("y"))
                return said.startswith("y")
            if said in ("", "q", "quit"):
                return None

    return answer


def _progress() -> Any:
    """A bar on standard error while records are compared."""
    from contextlib import contextmanager

    @contextmanager
    def shown() -> Any:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        from rich.progress import TimeElapsedColumn as Elapsed

        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Elapsed())
        with Progress(*columns, console=cli.err, transient=True) as bars:
            task = bars.add_task("compare", total=None)
            yield lambda stage, done, total: bars.update(
                task, description=stage, completed=done, total=total
            )

    return shown()
