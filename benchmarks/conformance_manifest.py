"""The manifests of the W3C's tests of SPARQL."""

from __future__ import annotations

from collections.abc import Iterator, Set
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import rdflib
from rdflib.collection import Collection
from rdflib.namespace import RDF

__all__ = ["MF", "Entry", "entries", "file_of"]

MF = rdflib.Namespace("http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#")

Entry = tuple[rdflib.Graph, Any, Path]
"""A manifest, a test in it, and the manifest's file."""


def entries(folder: Path, kinds: Set[Any]) -> Iterator[Entry]:
    """Yield the tests of some kinds of all manifests below a folder."""
    for path in sorted(folder.rglob("manifest.ttl")):
        manifest = rdflib.Graph().parse(path, publicID=path.as_uri())
        for listed in manifest.objects(None, MF.entries):
            for test in dict.fromkeys(Collection(manifest, listed)):
                if set(manifest.objects(test, RDF.type)) & kinds:
                    yield manifest, test, path


def file_of(iri: Any) -> Path:
    """Return the file that an IRI of a manifest names."""
    return Path(unquote(urlsplit(str(iri)).path))
