"""morph-kgc, a processor of R2RML by others, in an environment of its own: it needs old libraries.

The environment is that of `SEMMAP_R2RML_PYTHON`, or of `scripts/setup test`.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pyoxigraph
import pytest
from sqlalchemy import URL

from semmap import Map
from semmap.knowledge.whole_graph import serialized

_MADE = Path(sys.prefix) / "r2rml/bin/python"
_PYTHON = os.environ.get("SEMMAP_R2RML_PYTHON") or (str(_MADE) if _MADE.exists() else "")

needs_processor = pytest.mark.skipif(
    not _PYTHON,
    reason="no morph-kgc: scripts/setup test installs it, SEMMAP_R2RML_PYTHON names another Python",
)

_SETTINGS = """
[CONFIGURATION]
output_file = {made}
output_format = N-QUADS
na_values = None
number_of_processes = 1

[Database]
mappings = {document}
db_url = {url}
"""
"""None is how it writes nulls before it leaves them out."""


def facts_of(made: Map, *, inferences: bool = False) -> set[pyoxigraph.Quad]:
    """Return what `semmap rdf export` writes of a map."""
    text = serialized(made.graph(inferences=inferences), "nquads")
    return set(pyoxigraph.parse(text.encode(), format=pyoxigraph.RdfFormat.N_QUADS))


def materialized(document: Path, database: URL) -> set[pyoxigraph.Quad]:
    """Return the triples that a document makes of a database, for a login that only reads."""
    made, settings = document.with_suffix(".nq"), document.with_suffix(".ini")
    path = {"options": "-csearch_path=semmap,public -crole=semmap_reader"}
    url = database.set(drivername="postgresql+psycopg").update_query_dict(path)
    text = url.render_as_string(hide_password=False).replace("$", "$$")
    settings.write_text(_SETTINGS.format(made=made, document=document, url=text))
    command = [_PYTHON, "-m", "morph_kgc", str(settings)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr + done.stdout
    return set(pyoxigraph.parse(made.read_bytes(), format=pyoxigraph.RdfFormat.N_QUADS))
