"""Untrusted XML files, without entities and DTD; what TinyXML2 accepts is read as it reads it."""

from __future__ import annotations

import re
from collections.abc import Collection
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from semmap.ingest.text_file import read_bytes
from semmap.ingest.world import WorldError
from semmap.limits import ELEMENTS

TOKEN = re.compile(
    rb"<!--.*?(?:-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)|<\?.*?(?:\?>|\Z)|<[^<>]*>?|[^<]+", re.DOTALL
)
"""A comment, a CDATA section, an instruction, a tag, or text; found in linear time."""

BARE = re.compile(rb"&(?!#?\w{1,31};)")
"""An ampersand that begins no entity."""

PREFIX = re.compile(rb"[</\s]([A-Za-z_][\w.-]*):[A-Za-z_]")
"""The namespace prefix of an element or an attribute in a tag."""

QUOTED = re.compile(rb"\"[^\"]*\"|'[^']*'")


def read_xml(path: Path, roots: Collection[str] | None = None) -> Element:
    """Return the root element of an XML file, one of `roots`; a WorldError refuses a DTD, too."""
    data = read_bytes(path)
    elements = data.count(b"<") - data.count(b"</")
    ELEMENTS.check(elements, partial(WorldError, path, "file"), "Split it into several files.")
    try:
        try:
            root: Element = fromstring(data, forbid_dtd=True)
        except ParseError:
            root = fromstring(_as_tinyxml_reads(data), forbid_dtd=True)
    except ParseError as error:
        line, column = error.position
        where = f"line {line}, column {column + 1}"
        problem = f"is not well-formed XML ({str(error).split(':')[0]})"
        fix = "The file may be truncated: restore it, or fix the XML at this place."
        raise WorldError(path, where, problem, fix) from error
    except DefusedXmlException as error:
        raise WorldError(
            path,
            "DOCTYPE",
            "declares a document type or entities, which can blow up in memory or read other files",
            "Remove the <!DOCTYPE ...> declaration and write out what its entities stand for.",
        ) from error
    except (ValueError, LookupError) as error:
        problem = f"is not readable XML ({error})"
        raise WorldError(path, "line 1", problem, "Save it as UTF-8 XML.") from error
    if roots is not None and root.tag not in roots:
        problem = f"is not the expected root, <{'> or <'.join(roots)}>"
        raise WorldError(path, f"<{root.tag}>", problem, "Give a file of this format.")
    return root


def _as_tinyxml_reads(data: bytes) -> bytes:
    """Return a text with what TinyXML2 accepts written as the standard wants it; lines stay.

    Comments may contain ``--`` and stand before ``<?xml``, a namespace prefix needs no declaration,
    and an ampersand may stand alone.
    """
    prefixes: set[bytes] = set()

    def rewritten(token: re.Match[bytes]) -> bytes:
        found = token[0]
        if found.startswith(b"<!--"):
            return b"\n" * found.count(b"\n")
        if found.startswith((b"<!", b"<?")):
            return found
        if found.startswith(b"<"):
            prefixes.update(PREFIX.findall(QUOTED.sub(b"", found)))
        return BARE.sub(b"&amp;", found)

    text = TOKEN.sub(rewritten, data.removeprefix(b"\xef\xbb\xbf"))
    before, declaration, after = text.partition(b"<?xml")
    if declaration and not before.strip():
        rest, end, after = after.partition(b"?>")
        text = declaration + rest + end + before + after  # the lines of `before` still count
    undeclared = sorted(p for p in prefixes - {b"xml", b"xmlns"} if b"xmlns:" + p not in text)
    declared = b"".join(b' xmlns:%b="%b"' % (p, p) for p in undeclared)
    return re.sub(rb"<[A-Za-z_][\w.:-]*", lambda tag: tag[0] + declared, text, count=1)
