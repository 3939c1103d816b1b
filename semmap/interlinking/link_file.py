"""Files of labels and links: CSV, the Alignment format in which OAEI publishes, and owl:sameAs."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote, urlsplit

from semmap.interlinking.data_set_file import csv_rows
from semmap.interlinking.records import InterlinkingError, Records
from semmap.whole_file import write_whole

ANSWERS = dict.fromkeys(("1", "yes", "true", "same"), True) | dict.fromkeys(
    ("0", "no", "false", "different"), False
)
HEADER = ["left", "right", "same"]


def read_csv_labels(path: Path) -> dict[tuple[str, str], bool]:
    """Return whether pairs of a left and a right key are the same: columns left, right, same.

    Of several answers about a pair, most decide.
    """
    votes: dict[tuple[str, str], int] = {}
    for number, row in enumerate(csv_rows(path), 1):
        if number == 1 and [cell.strip().lower() for cell in row] == HEADER:
            continue
        answer = ANSWERS.get(row[2].strip().lower()) if len(row) == 3 else None
        if answer is None:
            raise InterlinkingError(
                f"{path}: row {number}: {','.join(row)!r} is not LEFT,RIGHT,yes or LEFT,RIGHT,no"
            )
        pair = (row[0].strip(), row[1].strip())
        votes[pair] = votes.get(pair, 0) + (1 if answer else -1)
    for pair, count in votes.items():
        if not count:
            raise InterlinkingError(
                f"{path}: {pair[0]} and {pair[1]} are labelled yes and no equally often: keep one"
            )
    return {pair: count > 0 for pair, count in votes.items()}


def append_label(path: Path, left: str, right: str, same: bool) -> None:
    """Add a label to a file, with a header where the file is new."""
    new = not path.exists() or not path.stat().st_size
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        rows: Iterable[list[str]] = [HEADER] if new else []
        writer.writerows([*rows, [left, right, "yes" if same else "no"]])


ABOUT = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}resource"


def read_alignment(path: Path) -> dict[tuple[str, str], float]:
    """Return the pairs that an alignment says are equal, with measures in [0, 1]."""
    from semmap.ingest.world import WorldError
    from semmap.ingest.xml_file import read_xml

    try:
        root = read_xml(path)
    except WorldError as error:
        raise InterlinkingError(str(error)) from error
    cells = [e for e in root.iter() if _tag(e.tag) == "Cell"]
    if not cells:
        raise InterlinkingError(f"{path}: has no <Cell>: give a file in the Alignment format")
    found: dict[tuple[str, str], float] = {}
    for number, cell in enumerate(cells, 1):
        parts = {_tag(e.tag): e for e in cell}
        keys = [parts[n].get(ABOUT) if n in parts else None for n in ("entity1", "entity2")]
        relation = (parts["relation"].text or "").strip() if "relation" in parts else "="
        text = (parts["measure"].text or "").strip() if "measure" in parts else "1"
        try:
            measure = float(text)
        except ValueError:
            measure = -1.0
        if None in keys or relation != "=" or not 0 <= measure <= 1:
            raise InterlinkingError(
                f"{path}: cell {number}: has the entities {keys}, the relation {relation!r} and "
                f"the measure {text!r}: give two rdf:resource, =, and a number in [0, 1]"
            )
        found[str(keys[0]), str(keys[1])] = measure
    return found


def read_labels(path: Path) -> dict[tuple[str, str], bool]:
    """Return the labels of a CSV file, or the pairs of an alignment, which are all the same."""
    if path.suffix.lower() in (".rdf", ".xml"):
        return dict.fromkeys(read_alignment(path), True)
    return read_csv_labels(path)


def _tag(name: str) -> str:
    return name.rpartition("}")[2]


def same_as(left: Records, right: Records, links: Iterable[tuple[str, str]]) -> str:
    """Return links as Turtle; a key that is not an absolute IRI becomes ``urn:semmap:SET:KEY``."""
    lines = [f"<{iri(a, left)}> owl:sameAs <{iri(b, right)}> ." for a, b in links]
    return "\n".join(["@prefix owl: <http://www.w3.org/2002/07/owl#> .", "", *lines, ""])


def write_same_as(
    path: Path, left: Records, right: Records, links: Iterable[tuple[str, str]]
) -> None:
    """Write links as Turtle, the whole file or nothing."""
    write_whole(path, same_as(left, right, links))


def iri(key: str, records: Records) -> str:
    """Return the IRI of a record."""
    if urlsplit(key).scheme and "/" in key:
        return quote(key, safe=":/?#[]@!$&'()*+,;=%~")
    name = Path(records.name).stem or records.name
    return f"urn:semmap:{quote(name, safe='')}:{quote(key, safe='')}"
