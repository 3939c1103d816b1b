"""Data sets and labels in CSV files."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from semmap.interlinking.error import InterlinkingError
from semmap.interlinking.files import read_text
from semmap.interlinking.records import Records

KEYS = ("id", "key", "rec_id", "uri")
"""Names of the column of keys; else the first column has them."""

ANSWERS = dict.fromkeys(("1", "yes", "true", "same"), True) | dict.fromkeys(
    ("0", "no", "false", "different"), False
)
HEADER = ["left", "right", "same"]


def read_csv_records(path: Path) -> Records:
    """Return the rows of a CSV file as records; the first row has the names of the properties.

    A column named id, key, rec_id or uri has the keys, else the first one.
    """
    rows = _rows(path)
    header = [name.strip() for name in rows[0]] if rows else []
    if len(header) < 2 or len(set(header)) < len(header) or not all(header):
        raise InterlinkingError(
            f"{path}: line 1: is not a header of two or more different column names: add one"
        )
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise InterlinkingError(
                f"{path}: row {number}: has {len(row)} cells, the header {len(header)}: quote "
                "commas within cells"
            )
    place = next((i for i, name in enumerate(header) if name.lower() in KEYS), 0)
    columns = {name: [row[i].strip() for row in rows[1:]] for i, name in enumerate(header)}
    keys = columns.pop(header[place])
    if "" in keys:
        raise InterlinkingError(
            f"{path}: row {keys.index('') + 2}: has no {header[place]}: add one"
        )
    return Records(
        str(path),
        keys,
        {name: [(cell,) if cell else () for cell in cells] for name, cells in columns.items()},
    )


def read_csv_labels(path: Path) -> dict[tuple[str, str], bool]:
    """Return whether pairs of a left and a right key are the same: columns left, right, same."""
    found: dict[tuple[str, str], bool] = {}
    for number, row in enumerate(_rows(path), 1):
        if number == 1 and [cell.strip().lower() for cell in row] == HEADER:
            continue
        answer = ANSWERS.get(row[2].strip().lower()) if len(row) == 3 else None
        if answer is None:
            raise InterlinkingError(
                f"{path}: row {number}: {','.join(row)!r} is not LEFT,RIGHT,yes or LEFT,RIGHT,no"
            )
        pair = (row[0].strip(), row[1].strip())
        if found.setdefault(pair, answer) != answer:
            raise InterlinkingError(
                f"{path}: row {number}: {pair[0]} and {pair[1]} are labelled yes and no: keep one"
            )
    return found


def append_label(path: Path, left: str, right: str, same: bool) -> None:
    """Add a label to a file, with a header where the file is new."""
    new = not path.exists() or not path.stat().st_size
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        rows: Iterable[list[str]] = [HEADER] if new else []
        writer.writerows([*rows, [left, right, "yes" if same else "no"]])


def _rows(path: Path) -> list[list[str]]:
    text = read_text(path)
    try:
        reader = csv.reader(text.splitlines(keepends=True), strict=True)
        return [row for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InterlinkingError(f"{path}: is not CSV ({error}): quote cells with commas") from error
