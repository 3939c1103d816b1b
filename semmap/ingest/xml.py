"""XML files that are not trusted: no entities, no DTD, and an error that names line and mend."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import parse

from semmap.ingest.world import WorldError
from semmap.limits import TEXT_BYTES

__all__ = ["read_xml"]


def read_xml(path: Path, roots: Collection[str] | None = None) -> Element:
    """The root element of an XML file.

    Parameters
    ----------
    path : the file
    roots : names that the root element may have; None allows any

    Raises
    ------
    WorldError
        The file is absent, is not well-formed XML, declares a DTD or entities (an XML bomb), or has
        another root.
    """
    try:
        TEXT_BYTES.check(path.stat().st_size, partial(WorldError, path, "file"), "Split the file.")
        root: Element | None = parse(path, forbid_dtd=True).getroot()
    except OSError as error:
        raise WorldError(
            path, "file", f"cannot be read ({error.strerror})", "Check path and permissions."
        ) from error
    except ParseError as error:
        line, column = error.position
        raise WorldError(
            path,
            f"line {line}, column {column + 1}",
            f"is not well-formed XML ({str(error).split(':')[0]})",
            "The file may be truncated: restore it, or mend the XML at this place.",
        ) from error
    except DefusedXmlException as error:
        raise WorldError(
            path,
            "DOCTYPE",
            "declares a document type or entities, which can blow up in memory or read other files",
            "Remove the <!DOCTYPE ...> declaration and write out what its entities stand for.",
        ) from error
    except (ValueError, LookupError) as error:
        raise WorldError(
            path, "line 1", f"is not readable XML ({error})", "Save it as UTF-8 XML."
        ) from error
    if root is None or (roots is not None and root.tag not in roots):
        found = "nothing" if root is None else f"<{root.tag}>"
        raise WorldError(
            path,
            found,
            f"is not the root that is expected here, <{'> or <'.join(roots or ())}>",
            "Give a file of this format.",
        )
    return root
