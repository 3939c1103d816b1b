"""Data sets in files, by the suffix."""

from __future__ import annotations

from pathlib import Path

from semmap.interlinking.csv_file import read_csv_records
from semmap.interlinking.error import InterlinkingError
from semmap.interlinking.rdf_file import FORMATS, read_rdf_records
from semmap.interlinking.records import Records

SUFFIXES = (".csv", *FORMATS)


def read_records(path: Path, type_name: str | None = None) -> Records:
    """Return the records of a CSV or RDF file, by its suffix; of an RDF file, those of a type."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InterlinkingError(
            f"{path}: ends in {suffix or 'no suffix'}: give a file that ends in one of "
            f"{', '.join(SUFFIXES)}"
        )
    return read_csv_records(path) if suffix == ".csv" else read_rdf_records(path, type_name)
