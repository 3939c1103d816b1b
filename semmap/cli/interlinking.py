"""The command `semmap interlink`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer import Option
from typer.core import TyperGroup

from semmap.cli.chosen import open_database
from semmap.cli.operation_command import MethodCall, command_of, group, printed
from semmap.cli.options import Json, MapName
from semmap.cli.output import StageBars, print_json, show_table

# NumPy, SciPy and rdflib are slow to import: the functions below import what they use.
if TYPE_CHECKING:
    from collections.abc import Callable

    from semmap.api.database import Database
    from semmap.api.map import Map
    from semmap.interlinking.interlink import Interlinking, PairQuestion


class _FilesOrCommand(TyperGroup):
    """`semmap interlink A B` is short for `semmap interlink link A B`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in (*self.commands, "--help", "-h"):
            args = ["link", *args]
        return super().parse_args(ctx, args)


@command_of("Database.interlink", left="A", right="B", labels="--labels", store="--dry-run")
def _link(
    call: MethodCall,
    ask: bool = Option(False, "--ask", help="Ask for the labels that tell most: y, n; q ends."),
    turtle: Path | None = Option(None, help="Write the links as owl:sameAs to it."),
    reference: Path | None = Option(
        None, help="All true links (CSV or alignment): show precision, recall."
    ),
    map_name: MapName = None,
    json_: Json = False,
) -> None:
    """Find which records of two data sets are the same, and store the links.

    A and B are an RDF or CSV file, map[:NAME], or models. --ask adds to a CSV file of labels.
    Without labels, a threshold is chosen that makes the links one to one.

    semmap interlink people.rdf clients.csv --labels labels.csv --ask
    """
    from semmap.interlinking.link_file import read_labels, write_same_as

    given = call.texts
    labels = None if given["labels"] is None else Path(given["labels"])
    if ask and labels is not None and labels.suffix.lower() in (".rdf", ".xml"):
        raise typer.BadParameter("--ask adds to a CSV file; give --labels FILE.csv")
    known = read_labels(labels) if labels and (labels.exists() or not ask) else {}
    truth = {pair for pair, same in read_labels(reference).items() if same} if reference else None
    with StageBars() as bar:
        asked: Any = {"ask": _asker(labels, bar) if ask else None, "questions": given["questions"]}
        asked |= {"store": call.values["store"], "progress": bar.report}
        found = _linked((given["left"], given["right"]), known, map_name, given["type"], **asked)
    if turtle is not None:
        write_same_as(turtle, found.left, found.right, found.links())
    _show(found, truth, json_)


def _linked(
    given: tuple[str, str], known: Any, map_name: str | None, type_: str | None, **asked: Any
) -> Interlinking:
    """Link two data sets; no database is opened for files whose links are not stored."""
    from semmap.api.database_interlinking import link_records
    from semmap.interlinking.data_set_file import read_records

    files = [_is_file(each) for each in given]
    store = asked.pop("store")
    if all(files) and not store:
        left, right = (read_records(Path(each), type_) for each in given)
        return link_records(left, right, known, **asked)
    with open_database(migrate=all(files)) as db:
        one, other = (
            Path(each) if is_file else _stored_set(db, each, map_name)
            for each, is_file in zip(given, files, strict=True)
        )
        return db.interlink(one, other, known, type=type_, store=store, **asked)


def _is_file(given: str) -> bool:
    """Whether a data set is a file, not one of the database."""
    from semmap.interlinking.data_set_file import SUFFIXES

    kind, colon, _ = given.partition(":")
    if given in ("map", "models") or (kind == "map" and colon):
        return False
    if Path(given).suffix.lower() not in SUFFIXES:
        names = ", ".join(f"FILE{suffix}" for suffix in SUFFIXES)
        raise typer.BadParameter(f"{given}: is not one of map, map:NAME, models, {names}")
    return True


def _stored_set(db: Database, given: str, map_name: str | None) -> Map | str:
    if given == "models":
        return given
    try:
        return db.map(given.partition(":")[2] or map_name)
    except LookupError as error:
        raise typer.BadParameter(str(error)) from None


def _show(found: Interlinking, truth: set[tuple[str, str]] | None, json_: bool) -> None:
    from semmap.interlinking.interlink import known_pairs

    known = known_pairs(truth, found.left, found.right) if truth else set()
    unknown = len(truth or ()) - len(known)
    quality = found.quality(known) if known else None
    if json_:
        summary: dict[str, Any] = {
            "link_set": found.link_set,
            "links": len(found.pairs),
            "candidates": found.candidates,
            "labels": len(found.labels),
            "pattern": found.pattern,
            "correspondences": [vars(c) for c in found.correspondences],
            "unexplained": [list(pair) for pair in found.unexplained],
            "doubted": [list(pair) for pair in found.doubted],
            "dropped_labels": found.dropped,
            "dropped_reference": unknown,
            "quality": vars(quality) if quality else None,
        }
        print_json(summary)
        return
    for c in found.correspondences:
        print(f"{c.left} = {c.right} ({c.measure})")
    print(f"link if {found.pattern}")
    for a, b in found.unexplained:
        print(f"{a} and {b} are labelled the same, but no pattern separates them from others")
    for a, b in found.doubted:
        given = "the same" if found.labels[a, b] else "different"
        print(f"{a} and {b} are labelled {given}: probably wrong, and left out; look again")
    for count, kind in ((found.dropped, "labels"), (unknown, "reference links")):
        if count:
            print(f"{count} {kind} left out: the data sets do not have their records")
    if quality:
        print(f"precision {quality.precision:.3f}, recall {quality.recall:.3f}, F {quality.f:.3f}")
    stored = "nothing stored" if found.link_set is None else f"link set {found.link_set}"
    print(f"{len(found.pairs)} links of {len(found.labels)} labels: {stored}")


@command_of("Database.merged_records", link_set="ID")
def _merged(
    call: MethodCall,
    all_: bool = Option(False, "--all", help="Also records without a link."),
    json_: Json = False,
) -> None:
    """Show both data sets of a link set as one."""
    columns = ("resource", "left_keys", "right_keys", "confidence") + ("properties",) * json_
    show_table([r for r in call() if all_ or r["resource"] is not None], json_, columns)


def _asker(labels: Path | None, bar: StageBars) -> Callable[[PairQuestion], bool | None]:
    """Asks a person about pairs, and keeps the answers in the file of labels."""
    from semmap.interlinking.link_file import append_label
    from semmap.terminal import visible

    def answer(pair: PairQuestion) -> bool | None:
        bar.stop()
        rows = [("", pair.left, pair.right)] + [
            (name, ", ".join(left), ", ".join(right)) for name, left, right in pair.values
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
                    append_label(labels, pair.left, pair.right, said.startswith("y"))
                return said.startswith("y")
            if said in ("", "q", "quit"):
                return None

    return answer


interlink_command = group(
    _link,
    printed("Database.list_link_sets", ("id", "left", "right", "links", "labels", "by", "at")),
    _merged,
    printed("Database.undo_links", "{0} links taken back", link_set="ID"),
    cls=_FilesOrCommand,
)
