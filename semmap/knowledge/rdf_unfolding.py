"""What pyoxigraph reads whole before its first fact: JSON-LD, and elements that nest.

Its time and memory grow by the square of the depth, and by the names that a context unfolds.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from xml.parsers import expat

import numpy as np

from semmap.ingest.world import WorldError
from semmap.limits import NESTING, RDF_CHARACTERS

FLATTER = "Make it flatter."
STRING = re.compile(r'"(?:[^"\\]|\\.)*+"?', re.DOTALL)

IRI = re.compile(r'"([^\s"]++)"')
"""All that may be one: the context may be anywhere."""


def refuse_unfolding(text: str, format_: str, source: Path) -> None:
    """Raise WorldError where elements or objects nest, or a context unfolds, beyond the limit."""
    if format_ == "json-ld":
        bare = np.frombuffer(STRING.sub("", text).encode(errors="replace"), np.uint8)
        steps = np.isin(bare, [*b"[{"]).astype(np.int32) - np.isin(bare, [*b"]}"])
        depth = int(steps.cumsum().max(initial=0))
        where = partial(WorldError, source, "file")
        NESTING.check(depth, where, FLATTER, "nests")
        longest = max(map(len, IRI.findall(text)), default=0)
        RDF_CHARACTERS.check(
            longest * (text.count('"') // 2), where, "Shorten its IRIs.", "unfolds to"
        )
    elif format_ == "xml":
        _refuse_deep_xml(text, source)


def _refuse_deep_xml(text: str, source: Path) -> None:
    depth = 0
    most = NESTING.value

    def begin(name: str, _: object) -> None:
        nonlocal depth
        depth += 1
        if depth > most:
            NESTING.check(depth, partial(WorldError, source, f"<{name}>"), FLATTER, "nests")

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        problem = f"is not well-formed XML ({str(error).split(':')[0]})"
        where = f"line {error.lineno}, column {error.offset + 1}"
        raise WorldError(source, where, problem, "Fix the XML at this place.") from error
