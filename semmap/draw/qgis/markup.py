"""Elements of QGIS's project and style files, as QGIS 3.22 writes them and later ones read them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element

Option = str | bool | Mapping[str, "Option"]


def element(tag: str, *children: Element, text: str | None = None, **attributes: Any) -> Element:
    """Return an element with attributes, a text and children."""
    made = Element(tag, {key: str(value) for key, value in attributes.items()})
    made.text = text
    made.extend(children)
    return made


def option_map(values: Mapping[str, Option], name: str | None = None) -> Element:
    """Return the element of a dictionary of options."""
    children = []
    for key, value in values.items():
        if isinstance(value, bool):
            children.append(element("Option", name=key, value=str(value).lower(), type="bool"))
        elif isinstance(value, str):
            children.append(element("Option", name=key, value=value, type="QString"))
        else:
            children.append(option_map(value, key))
    made = element("Option", *children, type="Map")
    if name is not None:
        made.set("name", name)
    return made


def colour(code: str, alpha: float = 1.0) -> str:
    """Return ``#rrggbb`` as ``r,g,b,a``.

    >>> colour("#ff8000", 0.5)
    '255,128,0,128'
    """
    red, green, blue = (int(code[k : k + 2], 16) for k in (1, 3, 5))
    return f"{red},{green},{blue},{round(255 * alpha)}"


def sql_text(text: str) -> str:
    """Return a text as a literal of SQL."""
    return "'" + text.replace("'", "''") + "'"


def quoted(text: str) -> str:
    """Return a text as a literal of QGIS's expressions."""
    return sql_text(text.replace("\\", "\\\\"))


def one_of(column: str, values: Sequence[str]) -> str:
    """Return the expression that a column has one of the values."""
    return f'"{column}" IN ({", ".join(map(quoted, values))})'
