"""Alignments in the Alignment format, as OAEI publishes reference links."""

from __future__ import annotations

from pathlib import Path

from semmap.interlinking.csv_file import read_csv_labels
from semmap.interlinking.error import InterlinkingError

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
