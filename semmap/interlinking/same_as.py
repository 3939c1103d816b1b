"""Links as owl:sameAs in Turtle."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote, urlsplit

from semmap.interlinking.records import Records


def same_as(left: Records, right: Records, links: Iterable[tuple[str, str]]) -> str:
    """Return links as Turtle; a key that is not an absolute IRI becomes ``urn:semmap:SET:KEY``."""
    lines = [f"<{iri(a, left)}> owl:sameAs <{iri(b, right)}> ." for a, b in links]
    return "\n".join(["@prefix owl: <http://www.w3.org/2002/07/owl#> .", "", *lines, ""])


def write_same_as(
    path: Path, left: Records, right: Records, links: Iterable[tuple[str, str]]
) -> None:
    """Write links as Turtle, the whole file or nothing."""
    part = path.with_name(path.name + ".part")
    part.write_text(same_as(left, right, links), encoding="utf-8")
    part.replace(path)


def iri(key: str, records: Records) -> str:
    """Return the IRI of a record."""
    if urlsplit(key).scheme and "/" in key:
        return quote(key, safe=":/?#[]@!$&'()*+,;=%~")
    name = Path(records.name).stem or records.name
    return f"urn:semmap:{quote(name, safe='')}:{quote(key, safe='')}"
