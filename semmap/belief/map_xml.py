"""The Map.xml of the thesis (appendix A.1): its knowledge as the plain data of a teaching.

A field is an attribute or an element below. Capitals, underscores and hyphens do not matter.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from semmap.belief.error import BeliefError
from semmap.ingest.xml_file import read_xml

LENGTH_UNIT = 0.01
"""Metres; the thesis states no unit. Its numbers are of the order of centimetres."""

ELEMENTS = {
    "knowledge": ("knowledge", ("name", "properties")),
    "knowledgeinstance": ("knowledge", ("name", "properties")),
    "instance": ("knowledge", ("name", "properties")),
    "relation": ("relations", ("master", "action", "slave", "subject", "relation", "object")),
    "drelation": ("relations", ("master", "action", "slave", "subject", "relation", "object")),
    "directedrelation": ("relations", ("master", "action", "slave")),
    "action": ("actions", ("action", "name", "instance1", "instance2", "cause", "effect")),
    "object": ("objects", ("name", "clas", "class", "base_area", "volume", "mobility")),
    "fobject": ("objects", ("name", "clas", "class", "base_area", "volume", "mobility")),
    "obj": ("objects", ("name", "clas", "class", "base_area", "volume", "mobility")),
}
"""The part of a teaching that an element belongs to, and its fields."""

OCCURRENCE = ("place", "x", "y", "time")


def read_map_xml(path: Path) -> dict[str, Any]:
    """Return the data of a Map.xml, for `semmap.belief.teaching.parse_teaching`.

    Areas and volumes are converted from `LENGTH_UNIT`; x and y are metres. `BeliefError` for an
    element or a field that a teaching does not have.
    """
    found: dict[str, Any] = {}
    for element in _leaves(read_xml(path), path):
        part, fields = ELEMENTS[_plain(element.tag)]
        row = _fields(element, fields, path)
        if part == "actions" and "name" in row:
            row["action"] = row.pop("name")
        if part == "objects":
            row["occurrences"] = [
                _fields(below, OCCURRENCE, path)
                for below in element.iter()
                if _plain(below.tag) == "occurrence"
            ]
            for key, power in (("base_area", 2), ("volume", 3)):
                if key in row:
                    row[key] = _scaled(row[key], power, f"{path}: {key} of {row.get('name')}")
        found.setdefault(part, []).append(row)
    return found


def _leaves(element: Element, path: Path) -> Iterator[Element]:
    """The elements that are a row of a teaching; others are groups of them."""
    for below in element:
        if not isinstance(below.tag, str):
            continue  # a comment
        is_group = len(below) and not below.attrib and _is_group(below)
        if is_group:
            yield from _leaves(below, path)
        elif _plain(below.tag) in ELEMENTS:
            yield below
        else:
            raise BeliefError(
                f"{path}: <{below.tag}> is not a part of a teaching: use "
                f"{', '.join(sorted(ELEMENTS))}"
            )


def _is_group(element: Element) -> bool:
    return all(_plain(below.tag) in ELEMENTS and (len(below) or below.attrib) for below in element)


def _fields(element: Element, known: tuple[str, ...], path: Path) -> dict[str, Any]:
    names = {_plain(name): name for name in known}
    given = [(key, value) for key, value in element.attrib.items()]
    given += [
        (below.tag, (below.text or "").strip())
        for below in element
        if _plain(below.tag) not in ("occurrence", "occurrences")
    ]
    row = {}
    for key, value in given:
        if _plain(key) not in names:
            raise BeliefError(
                f"{path}: <{element.tag}> has {key}, which is not one of {', '.join(known)}"
            )
        row[names[_plain(key)]] = _time(value) if _plain(key) == "time" else value
    return row


def _plain(tag: str) -> str:
    return tag.rpartition("}")[2].replace("_", "").replace("-", "").lower()


def _time(value: str) -> float | str:
    try:
        return float(value)
    except ValueError:
        return value


def _scaled(value: str, power: int, where: str) -> float:
    try:
        return float(value) * LENGTH_UNIT**power
    except ValueError:
        raise BeliefError(f"{where} is {value!r}: give a number") from None
